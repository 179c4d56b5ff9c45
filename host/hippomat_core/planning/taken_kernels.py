"""The loops over a peer's intent and the discs that others have taken, compiled: they run at every tick.

Knows numbers, no peers.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

TOLERANCE_M = 0.002

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True)
def intent_cells(ix: int, iy: int, steps: NDArray[np.uint8]) -> NDArray[np.int32]:
    """reservations.decode_intent."""
    cells = np.empty((len(steps) + 1, 2), np.int32)
    cells[0, 0], cells[0, 1] = ix, iy
    for k in range(len(steps)):
        cells[k + 1, 0] = cells[k, 0] + steps[k] % 3 - 1
        cells[k + 1, 1] = cells[k, 1] + steps[k] // 3 % 3 - 1
    return cells


@njit(cache=True, nogil=True)
def intent_steps(cells: NDArray[np.int32]) -> NDArray[np.uint8]:
    """The moves between the cells (K, 2), as reservations.encode_intent has them."""
    steps = np.empty(len(cells) - 1, np.uint8)
    for k in range(len(steps)):
        dx, dy = cells[k + 1, 0] - cells[k, 0], cells[k + 1, 1] - cells[k, 1]
        steps[k] = np.uint8(dx + 1 + 3 * (dy + 1) + 9)
    return steps


@njit(cache=True, nogil=True)
def discs_from(
    table: Floats, x_m: float, y_m: float
) -> tuple[Floats, Floats, Floats, NDArray[np.int32], NDArray[np.bool_], NDArray[np.bool_]]:
    """The fields of Taken, in their order, of discs (T, 6) x, y, radius, from_s, robot, intended.

    Seen from (x, y): inside a taken disc we may still move away from its middle, never nearer.
    """
    count = len(table)
    xy, radius_m, from_s = table[:, :2].copy(), table[:, 2].copy(), table[:, 3].copy()
    robot, intended = np.empty(count, np.int32), np.empty(count, np.bool_)
    inside = np.zeros(count, np.bool_)
    for k in range(count):
        robot[k], intended[k] = np.int32(table[k, 4]), table[k, 5] > 0.0
        distance_m = math.hypot(xy[k, 0] - x_m, xy[k, 1] - y_m)
        if distance_m < radius_m[k]:
            inside[k] = True
            radius_m[k] = max(distance_m - TOLERANCE_M, 0.0)
    return xy, radius_m, from_s, robot, intended, inside


@njit(cache=True, nogil=True)
def stretch(
    points: Floats,
    at_s: Floats,
    slack_s: float,
    xy: Floats,
    radius_m: Floats,
    from_s: Floats,
    robot: NDArray[np.int32],
) -> tuple[int, int]:
    """reservations.free_stretch, with the fields of Taken one by one."""
    for point in range(len(points)):
        for disc in range(len(xy)):
            late = at_s[point] + slack_s > from_s[disc]
            if late and _holds(xy[disc], radius_m[disc], points[point]):
                return _before(points, point, robot[disc], xy, radius_m, robot), robot[disc]
    return len(points), -1


@njit(cache=True, nogil=True)
def _before(
    points: Floats, first: int, owner: int, xy: Floats, radius_m: Floats, robot: NDArray[np.int32]
) -> int:
    """How many points lie before the crossing of the owner's discs that the first blocked one is in."""
    while first > 0:
        crosses = False
        for disc in range(len(xy)):
            crosses |= robot[disc] == owner and _holds(xy[disc], radius_m[disc], points[first - 1])
        if not crosses:
            break
        first -= 1
    return first


@njit(cache=True, nogil=True)
def _holds(middle: Floats, radius_m: float, point: Floats) -> bool:
    dx, dy = point[0] - middle[0], point[1] - middle[1]
    return bool(dx * dx + dy * dy < radius_m * radius_m)
