"""The point of a path to steer for: as far ahead as the look-ahead, but in sight over free cells.

Knows a path, a place and which cells are free; no speed, no heading.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.planning.costmap import Costmap


def pursued_point(
    ahead: NDArray[np.float64], x_m: float, y_m: float, look_m: float, costmap: Costmap
) -> tuple[float, float]:
    """Where the path leaves the circle of look_m around (x, y), or the last place before that is in sight.

    ahead: (n, 2) [m], n >= 1; its first point where none is in sight
    """
    grid = costmap.grid
    ahead = np.ascontiguousarray(ahead)
    x, y = _pursued(
        ahead, x_m, y_m, look_m, costmap.free, grid.origin_x_m, grid.origin_y_m, grid.resolution_m
    )
    return float(x), float(y)


@njit(cache=True, nogil=True)
def _pursued(
    ahead: NDArray[np.float64],
    x: float,
    y: float,
    look_m: float,
    free: NDArray[np.bool_],
    origin_x: float,
    origin_y: float,
    resolution: float,
) -> tuple[float, float]:
    chosen_x, chosen_y = ahead[0, 0], ahead[0, 1]
    if math.hypot(chosen_x - x, chosen_y - y) > look_m:
        return chosen_x, chosen_y
    for k in range(1, len(ahead)):
        next_x, next_y = ahead[k, 0], ahead[k, 1]
        beyond = math.hypot(next_x - x, next_y - y) > look_m
        if beyond:
            share = _leaves_circle(chosen_x - x, chosen_y - y, next_x - x, next_y - y, look_m)
            next_x = chosen_x + share * (next_x - chosen_x)
            next_y = chosen_y + share * (next_y - chosen_y)
        if not _in_sight(x, y, next_x, next_y, free, origin_x, origin_y, resolution):
            break
        chosen_x, chosen_y = next_x, next_y
        if beyond:
            break
    return chosen_x, chosen_y


@njit(cache=True, nogil=True)
def _leaves_circle(ax: float, ay: float, bx: float, by: float, radius: float) -> float:
    """The share of the way from a (inside the circle around 0) to b (outside) at which it is crossed."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    along = ax * dx + ay * dy
    inside = max(along * along - square * (ax * ax + ay * ay - radius * radius), 0.0)
    return min(max((math.sqrt(inside) - along) / square, 0.0), 1.0)


@njit(cache=True, nogil=True)
def _in_sight(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    free: NDArray[np.bool_],
    origin_x: float,
    origin_y: float,
    resolution: float,
) -> bool:
    """True where the straight way from a to b touches free cells only (Amanatides & Woo 1987)."""
    height, width = free.shape
    fx, fy = (ax - origin_x) / resolution, (ay - origin_y) / resolution
    dx, dy = (bx - ax) / resolution, (by - ay) / resolution
    ix, iy = math.floor(fx), math.floor(fy)
    steps = abs(math.floor(fx + dx) - ix) + abs(math.floor(fy + dy) - iy)
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    # The share of the way at which the next border is crossed, and from one border to the next.
    next_x = ((ix + (dx > 0)) - fx) / dx if dx != 0.0 else math.inf
    next_y = ((iy + (dy > 0)) - fy) / dy if dy != 0.0 else math.inf
    every_x = step_x / dx if dx != 0.0 else math.inf
    every_y = step_y / dy if dy != 0.0 else math.inf
    for _ in range(steps + 1):
        if not (0 <= ix < width and 0 <= iy < height and free[iy, ix]):
            return False
        if next_x < next_y:
            ix, next_x = ix + step_x, next_x + every_x
        else:
            iy, next_y = iy + step_y, next_y + every_y
    return True
