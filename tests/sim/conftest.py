"""Fixtures of the simulation's tests: small worlds, and one short recorded run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from lockstep_lab import record
from sim_rooms import box_room

from hippomat_core.maps.occupancy_grid import OccupancyGrid


@pytest.fixture
def room() -> OccupancyGrid:
    return box_room()


@pytest.fixture
def make_room() -> Callable[..., OccupancyGrid]:
    return box_room


@pytest.fixture(scope="session")
def recorded_fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of three robots that lose a third of their frames."""
    return record(tmp_path_factory.mktemp("recorded"))
