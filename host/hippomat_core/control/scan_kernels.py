"""The loops over a sweep's samples, compiled. Knows numbers; what they mean is in guard.py."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.control.stopping import Points

Floats = NDArray[np.float64]

_RAD_PER_DEGREE = math.pi / 180.0


@njit(cache=True, nogil=True)
def _came_back(range_m: float, least_m: float, most_m: float) -> bool:
    return range_m > 0.0 and least_m <= range_m <= most_m


@njit(cache=True, nogil=True)
def came_back(range_m: Floats, least_m: float, most_m: float) -> NDArray[np.bool_]:
    """(n,): which samples came back from something within these limits; 0 is no return."""
    kept = np.empty(len(range_m), np.bool_)
    for k in range(len(range_m)):
        kept[k] = _came_back(range_m[k], least_m, most_m)
    return kept


@njit(cache=True, nogil=True)
def kept_samples(
    range_m: Floats, clockwise_deg: Floats, least_m: float, most_m: float, yaw_rad: float
) -> tuple[Floats, Floats]:
    """Range [m] and angle [rad, counter-clockwise] of those that came back; yaw_rad: where 0 degrees is."""
    ranges_m, angles_rad, count = np.empty_like(range_m), np.empty_like(range_m), 0
    for k in range(min(len(range_m), len(clockwise_deg))):  # no loop of numba's looks at bounds
        if _came_back(range_m[k], least_m, most_m):
            ranges_m[count] = range_m[k]
            angles_rad[count] = yaw_rad - clockwise_deg[k] * _RAD_PER_DEGREE
            count += 1
    return ranges_m[:count], angles_rad[:count]


@njit(cache=True, nogil=True)
def placed(range_m: Floats, cosine: Floats, sine: Floats, x_m: float, y_m: float) -> Points:
    """(n, 2): seen from (x, y) in directions whose cosine and sine are given."""
    points = np.empty((len(range_m), 2), np.float64)
    for k in range(len(range_m)):
        points[k, 0] = x_m + range_m[k] * cosine[k]
        points[k, 1] = y_m + range_m[k] * sine[k]
    return points


@njit(cache=True, nogil=True)
def nearer_than(points: Points, x_m: float, y_m: float, limit_m: float) -> Points:
    """Those of the points that are nearer to (x, y)."""
    near, count = np.empty_like(points), 0
    for k in range(len(points)):
        if math.hypot(points[k, 0] - x_m, points[k, 1] - y_m) < limit_m:
            near[count, 0], near[count, 1] = points[k, 0], points[k, 1]
            count += 1
    return near[:count]


@njit(cache=True, nogil=True)
def widest_gap(angles: NDArray[np.uint16], turn: int) -> int:
    """Between neighbours of n >= 1 ascending angles on a circle of `turn`."""
    widest = turn - np.int64(angles[-1]) + np.int64(angles[0])
    for k in range(1, len(angles)):
        widest = max(widest, np.int64(angles[k]) - np.int64(angles[k - 1]))
    return int(widest)
