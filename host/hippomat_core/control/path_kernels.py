"""Where along a path we are, compiled: it is asked for at every tick. Knows points, no cells and no robot."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Points = NDArray[np.float64]  # (n, 2) [m]


@njit(cache=True, nogil=True)
def nearest_point(points: Points, x_m: float, y_m: float) -> tuple[int, float]:
    """Which point is nearest to (x, y), the first of equals, and how far it is [m]. n >= 1.

    What is not a number is no point; where all are, the first is infinitely far.
    """
    nearest, away_m = 0, math.inf
    for k in range(len(points)):
        this_m = math.hypot(points[k, 0] - x_m, points[k, 1] - y_m)
        if this_m < away_m:
            nearest, away_m = k, this_m
    return nearest, away_m


@njit(cache=True, nogil=True)
def ways_m(points: Points, x_m: float, y_m: float) -> NDArray[np.float64]:
    """(n,) [m] from (x, y) along the points to each of them."""
    ways = np.empty(len(points), np.float64)
    along_m = 0.0
    for k in range(len(points)):
        next_x, next_y = points[k, 0], points[k, 1]
        along_m += math.hypot(next_x - x_m, next_y - y_m)
        x_m, y_m = next_x, next_y
        ways[k] = along_m
    return ways
