"""Where a simulated fleet begins."""

from __future__ import annotations

import numpy as np
import pytest
from sim_rooms import box_room

from hippomat_core.errors import MapError
from hippomat_core.planning.costmap import inflate, reachable
from hippomat_sim.start_poses import start_poses


@pytest.mark.parametrize("seed", range(5))
def test_starts_are_free_connected_apart_and_the_same_for_the_same_seed(seed: int) -> None:
    costmap = inflate(box_room(), 0.17)
    poses = start_poses(costmap, 6, 0.12, seed)
    assert np.array_equal(poses, start_poses(costmap, 6, 0.12, seed))
    area = reachable(costmap, *poses[0, :2])
    for x, y, _ in poses:
        ix, iy = costmap.grid.cell_of(x, y)
        assert area[iy, ix]
    apart = np.hypot(*(poses[:, None, :2] - poses[None, :, :2]).T) + 9 * np.eye(6)
    assert apart.min() >= 0.48


def test_another_seed_gives_other_starts() -> None:
    costmap = inflate(box_room(), 0.17)
    assert not np.array_equal(start_poses(costmap, 3, 0.12, 1), start_poses(costmap, 3, 0.12, 2))


def test_too_many_robots_for_the_room_are_refused_with_the_number_that_fits() -> None:
    with pytest.raises(MapError, match=r"room for \d+ robots of radius 0.12 m, 40 were asked for"):
        start_poses(inflate(box_room(1.5, 1.5), 0.17), 40, 0.12, 1)


def test_a_map_without_free_space_is_refused() -> None:
    grid = box_room(0.2, 0.2)
    with pytest.raises(MapError, match="no free place"):
        start_poses(inflate(grid, 0.17), 1, 0.12, 1)
