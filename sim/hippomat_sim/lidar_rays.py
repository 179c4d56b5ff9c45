"""Where the beams of spinning lidars go, and what they measure. Knows poses and angles, not bytes.

Angles run clockwise in the lidar's own frame, as an RPLIDAR's do; the lidar's pose in the base frame is
configuration. Every sample is taken from the pose at its own instant, so a sweep is skewed as a real one is.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import LidarConfig
from hippomat_sim.world import World


def poses_between(
    before: NDArray[np.float64], after: NDArray[np.float64], fraction: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n, N, 3) poses at `fraction` (n,) of the way from before (N, 3) to after (N, 3), yaw the short way."""
    turn = after - before
    turn[:, 2] = np.remainder(turn[:, 2] + math.pi, 2 * math.pi) - math.pi
    return before + fraction[:, None, None] * turn


def measure(
    world: World, poses: NDArray[np.float64], clockwise_rad: NDArray[np.float64], lidar: LidarConfig
) -> NDArray[np.float64]:
    """Exact ranges [m], (n, N): sample k of robot r at pose poses[k, r] and angle clockwise_rad[k].

    inf: nothing within the lidar's range. All robots' rays go in one batch.
    """
    yaw = poses[..., 2]
    cos, sin = np.cos(yaw), np.sin(yaw)
    starts = np.empty(poses.shape)
    starts[..., 0] = poses[..., 0] + cos * lidar.x_m - sin * lidar.y_m
    starts[..., 1] = poses[..., 1] + sin * lidar.x_m + cos * lidar.y_m
    starts[..., 2] = lidar.z_m
    direction = yaw + lidar.yaw_rad - clockwise_rad[:, None]
    ends = starts.copy()
    reach_m = min(lidar.max_range_m, world.extent_m)
    ends[..., 0] += reach_m * np.cos(direction)
    ends[..., 1] += reach_m * np.sin(direction)
    ranges = world.hit_distances(starts.reshape(-1, 3), ends.reshape(-1, 3)).reshape(yaw.shape)
    return np.where(ranges < lidar.min_range_m, np.inf, ranges)
