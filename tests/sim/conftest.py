"""Fixtures of the simulation's tests: small worlds."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from sim_rooms import box_room

from hippomat_core.maps.occupancy_grid import OccupancyGrid


@pytest.fixture
def room() -> OccupancyGrid:
    return box_room()


@pytest.fixture
def make_room() -> Callable[..., OccupancyGrid]:
    return box_room
