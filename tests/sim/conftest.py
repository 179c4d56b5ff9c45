"""Fixtures of the simulation's tests: small worlds."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from hippomat_core.maps.occupancy_grid import OccupancyGrid

sys.path.insert(0, str(Path(__file__).parent))  # --import-mode=importlib leaves it out

from sim_rooms import box_room


@pytest.fixture
def room() -> OccupancyGrid:
    return box_room()


@pytest.fixture
def make_room() -> Callable[..., OccupancyGrid]:
    return box_room


@pytest.fixture
def data_directory() -> Path:
    """Recorded data that does not live in the repository; skips where it is absent."""
    beside = Path(__file__).resolve().parents[2] / ".." / "shared" / "data"
    path = Path(os.environ.get("HIPPOMAT_DATA", beside)).resolve()
    if not (path / "ros_maps").is_dir():
        pytest.skip(f"no recorded data in {path} (set HIPPOMAT_DATA)")
    return path
