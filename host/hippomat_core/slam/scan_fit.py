"""Does what the lidar sees agree with the map at a pose? Judges return by return; searches nothing.

A return on a mapped wall speaks for the pose. One whose beam would have had to pass through a wall speaks
against it. One in free or unknown space is a thing that the map does not show - a person, a peer, a box - and
speaks against it half as much: a robot in a crowd knows where it is, one in the wrong room sees walls where
there are none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.planning.costmap import Costmap
from hippomat_core.slam.pose2 import Pose

NEAR_M = 0.10  # a return this near to an occupied cell is on it
BEHIND_M = 0.30  # a wall counts as passed through where the return lies further behind it
UNEXPLAINED = 0.5  # what a return without a mapped cause weighs
FEWEST = 12  # returns on walls below which no pose is believed: a robot in an open field sees none


@dataclass(frozen=True, slots=True)
class ScanFit:
    """How many returns lie on mapped walls, behind one, and where the map shows nothing."""

    on_walls: int
    through_walls: int
    unexplained: int

    @property
    def score(self) -> float:
        """0 .. 1: the share of the evidence that speaks for the pose."""
        if self.on_walls < FEWEST:
            return 0.0
        return self.on_walls / (self.on_walls + self.through_walls + UNEXPLAINED * self.unexplained)

    @property
    def share(self) -> float:
        """0 .. 1: returns on walls among all."""
        return self.on_walls / max(self.on_walls + self.through_walls + self.unexplained, 1)


def scan_fit(
    costmap: Costmap, points: NDArray[np.float64], pose: Pose, lidar: tuple[float, float]
) -> ScanFit:
    """points: (n, 2) [m] returns, base frame   pose: of the base in the map   lidar: x, y [m], base frame"""
    grid = costmap.grid
    counts = _counts(
        costmap.clearance_m, grid.resolution_m, grid.origin_x_m, grid.origin_y_m, points, *pose, *lidar
    )
    return ScanFit(*(int(count) for count in counts))


@njit(cache=True)
def _counts(  # type: ignore[no-untyped-def]
    clearance_m, resolution_m, origin_x_m, origin_y_m, points, x_m, y_m, yaw_rad, lidar_x_m, lidar_y_m
):
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    from_x = x_m + c * lidar_x_m - s * lidar_y_m
    from_y = y_m + s * lidar_x_m + c * lidar_y_m
    on_walls = through = unexplained = 0
    for k in range(len(points)):
        to_x = x_m + c * points[k, 0] - s * points[k, 1]
        to_y = y_m + s * points[k, 0] + c * points[k, 1]
        near = _clearance(clearance_m, resolution_m, origin_x_m, origin_y_m, to_x, to_y)
        if 0.0 <= near <= NEAR_M:
            on_walls += 1
        elif _passes_wall(clearance_m, resolution_m, origin_x_m, origin_y_m, from_x, from_y, to_x, to_y):
            through += 1
        else:
            unexplained += 1
    return on_walls, through, unexplained


@njit(cache=True)
def _clearance(clearance_m, resolution_m, origin_x_m, origin_y_m, x_m, y_m):  # type: ignore[no-untyped-def]
    """Of the cell that holds the point [m]; negative outside the map."""
    ix = math.floor((x_m - origin_x_m) / resolution_m)
    iy = math.floor((y_m - origin_y_m) / resolution_m)
    if ix < 0 or iy < 0 or iy >= clearance_m.shape[0] or ix >= clearance_m.shape[1]:
        return -1.0
    return clearance_m[iy, ix]


@njit(cache=True)
def _passes_wall(  # type: ignore[no-untyped-def]
    clearance_m, resolution_m, origin_x_m, origin_y_m, from_x, from_y, to_x, to_y
):
    """True where an occupied cell lies on the beam, well before its end. Strides as far as nothing can be."""
    length_m = math.hypot(to_x - from_x, to_y - from_y)
    along_m = resolution_m
    while along_m < length_m - BEHIND_M:
        x_m = from_x + (to_x - from_x) * along_m / length_m
        y_m = from_y + (to_y - from_y) * along_m / length_m
        clearance = _clearance(clearance_m, resolution_m, origin_x_m, origin_y_m, x_m, y_m)
        if clearance == 0.0:
            return True
        along_m += max(clearance - 0.75 * resolution_m, 0.5 * resolution_m)
    return False
