"""From the best pose on a grid to the best pose: Newton steps on the interpolated field, and how sharp it is.

Climbs the mean value itself. The usual sum of (1 - value)^2 (Hector SLAM) is of fourth order at a perfect
match and leaves the pose loose by a centimetre. Knows no search window: it starts on the answer's slopes.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

ITERATIONS = 15
SMALL_CELLS = 1e-3  # a step below it ends the search
MAX_STEP_CELLS = 1.0


@njit(cache=True, nogil=True)
def value_at(values: NDArray[np.float32], u: float, v: float) -> tuple[float, float, float]:
    """Bilinear value, and its slopes [1/cell]; u, v in cells from the field's corner. 0 outside."""
    height, width = values.shape
    u, v = u - 0.5, v - 0.5  # a value belongs to its cell's centre
    if not (0.0 <= u < width - 1 and 0.0 <= v < height - 1):
        return 0.0, 0.0, 0.0
    ix, iy = int(u), int(v)
    a, b = u - ix, v - iy
    v00, v01 = float(values[iy, ix]), float(values[iy, ix + 1])
    v10, v11 = float(values[iy + 1, ix]), float(values[iy + 1, ix + 1])
    below, above = v00 + a * (v01 - v00), v10 + a * (v11 - v10)
    return below + b * (above - below), (1.0 - b) * (v01 - v00) + b * (v11 - v10), above - below


@njit(cache=True, nogil=True)
def climb(
    values: NDArray[np.float32],
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    inverse: NDArray[np.float64],
    lever: float,
    guess: NDArray[np.float64],
    pull: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(3,) the pose uphill of `pose` where the mean value less the pull is highest. Lengths in cells.

    inverse: (3, 3) of the curvature, positive definite
    guess, pull: (3,) what is climbed is the mean value - 0.5 * sum(pull * (pose - guess)^2)
    lever: typical distance of the points; it makes a rotation comparable with a translation
    """
    best, slope = _pulled(values, points, pose, guess, pull)
    share = 1.0
    for _ in range(ITERATIONS):
        step = inverse @ slope * share
        length = math.sqrt(step[0] ** 2 + step[1] ** 2 + (step[2] * lever) ** 2)
        if length > MAX_STEP_CELLS:
            step *= MAX_STEP_CELLS / length
        value, slope_there = _pulled(values, points, pose + step, guess, pull)
        if value > best:
            pose, best, slope, share = pose + step, value, slope_there, 1.0
        else:
            share *= 0.3
        if length < SMALL_CELLS:
            break
    return pose


@njit(cache=True, nogil=True)
def _pulled(
    values: NDArray[np.float32],
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    guess: NDArray[np.float64],
    pull: NDArray[np.float64],
) -> tuple[float, NDArray[np.float64]]:
    value, slope = _mean_and_slope(values, points, pose)
    away = pose - guess
    return value - 0.5 * (pull * away * away).sum(), slope - pull * away


@njit(cache=True, nogil=True)
def _mean_and_slope(
    values: NDArray[np.float32], points: NDArray[np.float64], pose: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    """The mean value, and its slope (3,) along x, y [1/cell] and yaw [1/rad]."""
    slope = np.zeros(3)
    total = 0.0
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(points.shape[0]):
        east, north = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        value, along_u, along_v = value_at(values, pose[0] + east, pose[1] + north)
        total += value
        slope[0] += along_u
        slope[1] += along_v
        slope[2] += east * along_v - north * along_u
    count = max(points.shape[0], 1)
    return total / count, slope / count


@njit(cache=True, nogil=True)
def mean_value(values: NDArray[np.float32], points: NDArray[np.float64], pose: NDArray[np.float64]) -> float:
    """The mean of the interpolated values at the points (n, 2), seen from the pose; lengths in cells."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total = 0.0
    for k in range(points.shape[0]):
        u = pose[0] + c * points[k, 0] - s * points[k, 1]
        v = pose[1] + s * points[k, 0] + c * points[k, 1]
        total += value_at(values, u, v)[0]
    return total / max(points.shape[0], 1)


@njit(cache=True, nogil=True)
def curvature(
    values: NDArray[np.float32],
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    shift: float,
    lever: float,
) -> NDArray[np.float64]:
    """(3, 3) how fast the mean value falls: minus its second differences in x, y, yaw.

    Differences and not derivatives: on the ridge of a wall every slope is 0, yet the match is sharp. The
    mixed ones go half as far each way, so that a slanting wall is as sharp as an upright one. Lengths in
    cells, yaw in radians; rotations are by shift / lever.
    """
    step = np.array([shift, shift, shift / lever])
    here = mean_value(values, points, pose)
    bent = np.empty((3, 3))
    for i in range(3):
        bent[i, i] = 2.0 * here
        for side in (-1.0, 1.0):
            bent[i, i] -= mean_value(values, points, _moved(pose, i, side * step[i], i, 0.0))
        for j in range(i):
            total = 0.0
            for side_i in (-0.5, 0.5):
                for side_j in (-0.5, 0.5):
                    moved = _moved(pose, i, side_i * step[i], j, side_j * step[j])
                    total += math.copysign(1.0, side_i * side_j) * mean_value(values, points, moved)
            bent[i, j] = bent[j, i] = -total
    return bent / np.outer(step, step)


@njit(cache=True, nogil=True)
def _moved(pose: NDArray[np.float64], i: int, by_i: float, j: int, by_j: float) -> NDArray[np.float64]:
    moved = pose.copy()
    moved[i] += by_i
    moved[j] += by_j
    return moved
