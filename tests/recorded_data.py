"""Where data recorded by others lies; it is not part of the repository."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


def data_folder() -> Path:
    """$HIPPOMAT_DATA, default ../shared/data beside the checkout; skips the test where it is absent."""
    repository = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get("HIPPOMAT_DATA", repository.parent / "shared" / "data"))
    if not (folder / "ros_maps").is_dir():
        pytest.skip(f"real data not found at {folder}; set HIPPOMAT_DATA")
    return folder
