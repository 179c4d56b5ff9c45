"""One made-up control step before the first real one: what numba compiles must not stall a moving robot."""

from __future__ import annotations

import numpy as np

from hippomat_core.config import Config
from hippomat_core.control.follower import Drive, Motion, follow
from hippomat_core.control.guard import guard
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.costmap import inflate


def warm_up(config: Config) -> None:
    """A path across an empty room, and something seen beside it."""
    costmap = inflate(OccupancyGrid(np.zeros((40, 40), np.int8), 0.05, 0.0, 0.0), 0.17)
    ahead = np.array([[1.0, 1.0], [1.1, 1.0], [1.9, 1.0]])
    drive = follow(ahead, 1.0, Motion(0.9, 1.0, 0.0), Drive(0.1), 0.05, config, costmap)
    seen, peers = np.array([[0.3, 0.3], [0.3, -0.3]]), np.array([[0.5, 0.0, config.robot.radius_m]])
    for v_mps, wz_radps in ((drive.v_mps, 0.1), (0.0, 0.5)):  # along an arc, and in place
        guard(seen, v_mps, wz_radps, peers, config)
