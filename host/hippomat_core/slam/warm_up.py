"""Localize once in a small room and find oneself anew in it, so that numba compiles before it matters."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import LidarConfig, SlamConfig
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.costmap import inflate
from hippomat_core.replaced import replace
from hippomat_core.slam.localizer import (
    LOST,
    Localizer,
    Seen,
    first_localizer,
    saved_map,
    with_sweep,
    with_work,
)
from hippomat_core.slam.pose2 import Pose

SIDE_M, CORNER_M = 3.0, 0.9  # a room with one corner built up looks different from every place
RESOLUTION_M = 0.05


def warm_up() -> Localizer:
    """Takes seconds to a minute where nothing was compiled yet; the robot found itself."""
    cells = np.zeros((round(SIDE_M / RESOLUTION_M),) * 2, np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    cells[: round(CORNER_M / RESOLUTION_M), : round(CORNER_M / RESOLUTION_M)] = 100
    saved = saved_map(inflate(OccupancyGrid(cells, RESOLUTION_M, 0.0, 0.0), 0.15), 0.1)
    pose = (1.7, 1.9, 0.3)
    seen = Seen(_returns(cells, pose), pose)
    place = first_localizer(saved, LidarConfig(), SlamConfig(), pose, True, 0)
    place = with_sweep(place, seen, 1)
    place = replace(place, phase=LOST, phase_ns=-(10**12))
    for now_ns in range(2, 1000):
        place = with_work(with_sweep(place, seen, now_ns), now_ns)
        if place.localized:
            break
    return place


def _returns(cells: NDArray[np.int8], pose: Pose) -> NDArray[np.float64]:
    """(n, 2) [m] what a lidar on the base sees."""
    bearing_rad = np.arange(180) * math.tau / 180
    along_m = np.arange(0.0, 2 * SIDE_M, RESOLUTION_M / 2)
    x = pose[0] + along_m * np.cos(bearing_rad + pose[2])[:, None]
    y = pose[1] + along_m * np.sin(bearing_rad + pose[2])[:, None]
    ix, iy = (np.clip((axis / RESOLUTION_M).astype(int), 0, len(cells) - 1) for axis in (x, y))
    range_m = along_m[(cells[iy, ix] > 0).argmax(axis=1)]
    return np.stack([range_m * np.cos(bearing_rad), range_m * np.sin(bearing_rad)], axis=1)
