"""All that numba compiles is compiled before the ports open: a robot that moves must not wait for it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize("what", ["wheels", "slam", "pibt", "window"])
def test_a_fleet_that_drives_compiles_nothing_any_more(what: str) -> None:
    script = Path(__file__).with_name("late_kernels.py")
    told = subprocess.run(
        [sys.executable, str(script), what], capture_output=True, text=True, timeout=300, check=True
    )
    assert told.stderr.strip() == ""
