"""Where a simulated fleet begins."""

from __future__ import annotations

import numpy as np
import pytest
from sim_rooms import box_room

from hippomat_core.config import Config
from hippomat_core.errors import MapError
from hippomat_core.planning.ground import Ground, ground_of
from hippomat_sim.start_poses import start_poses


def ground_in(width_m: float, height_m: float) -> Ground:
    return ground_of(box_room(width_m, height_m), 0, Config())


@pytest.mark.parametrize("seed", range(5))
def test_starts_are_free_connected_apart_and_the_same_for_the_same_seed(seed: int) -> None:
    ground = ground_in(4.0, 3.0)
    poses = start_poses(ground, 6, 0.12, seed)
    assert np.array_equal(poses, start_poses(ground, 6, 0.12, seed))
    for x, y, _ in poses:
        ix, iy = ground.costmap.grid.cell_of(x, y)
        assert ground.drivable[iy, ix]
    apart = np.hypot(*(poses[:, None, :2] - poses[None, :, :2]).T) + 9 * np.eye(6)
    assert apart.min() >= 0.48


def test_another_seed_gives_other_starts() -> None:
    ground = ground_in(4.0, 3.0)
    assert not np.array_equal(start_poses(ground, 3, 0.12, 1), start_poses(ground, 3, 0.12, 2))


def test_too_many_robots_for_the_room_are_refused_with_the_number_that_fits() -> None:
    with pytest.raises(MapError, match=r"room for \d+ robots of radius 0.12 m, 40 were asked for"):
        start_poses(ground_in(1.5, 1.5), 40, 0.12, 1)
