"""A robot's install has no simulator's packages: the command says so in one line."""

from __future__ import annotations

import subprocess
import sys

import pytest


def test_a_missing_package_is_one_line_and_exit_code_1() -> None:
    hidden = "import sys; sys.modules['cffi'] = None; from hippomat_sim.entry import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", hidden, "run"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert done.stderr == "hippomat-sim: the package cffi is not installed: pip install 'hippomat[sim]'\n"


@pytest.mark.parametrize("package", ["hippomat_host", "hippomat_logs.replay_cli", "hippomat_logs.cli"])
def test_what_a_robot_runs_loads_without_the_workstations_packages(package: str) -> None:
    hidden = "import sys; sys.modules.update(dict.fromkeys(('pybullet', 'cffi', 'matplotlib', 'torch')));"
    daemon = "import hippomat_host.startup" if package == "hippomat_host" else f"import {package}"
    done = subprocess.run(
        [sys.executable, "-c", hidden + daemon], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
