"""Is this path drivable? An independent check that shares no code with the planners it judges.

On the ground cell by cell, in the air cell by cell, and for a polyline the true distance of the whole leg to
every occupied square.
"""

from __future__ import annotations

import math
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray


def path_fault(
    free: NDArray[np.bool_], path: NDArray[np.int32], start: tuple[int, int], goal: tuple[int, int]
) -> str:
    """What is wrong with the path, or "" if nothing is.

    free: (H, W) [iy, ix]   path: (K, 2) [ix, iy]
    """
    cells = [(int(ix), int(iy)) for ix, iy in path]
    if not cells:
        return "the path is empty"
    if cells[0] != start or cells[-1] != goal:
        return f"it leads from {cells[0]} to {cells[-1]}, not from {start} to {goal}"
    height, width = free.shape
    for ix, iy in cells:
        if not (0 <= ix < width and 0 <= iy < height):
            return f"cell {(ix, iy)} is outside the map"
        if not free[iy, ix]:
            return f"cell {(ix, iy)} is not free"
    for (ax, ay), (bx, by) in pairwise(cells):
        if max(abs(ax - bx), abs(ay - by)) != 1:
            return f"{(ax, ay)} and {(bx, by)} are not neighbours"
        if not (free[ay, bx] and free[by, ax]):
            return f"the step from {(ax, ay)} to {(bx, by)} cuts a corner"
    return ""


def path_fault_3d(
    free: NDArray[np.bool_],
    path: NDArray[np.int32],
    start: tuple[int, int, int],
    goal: tuple[int, int, int],
) -> str:
    """What is wrong with the path, or "" if nothing is.

    free: (Z, Y, X) [iz, iy, ix]   path: (K, 3) [ix, iy, iz]
    """
    cells = [(int(ix), int(iy), int(iz)) for ix, iy, iz in path]
    if not cells:
        return "the path is empty"
    if cells[0] != start or cells[-1] != goal:
        return f"it leads from {cells[0]} to {cells[-1]}, not from {start} to {goal}"
    layers, height, width = free.shape
    for ix, iy, iz in cells:
        if not (0 <= ix < width and 0 <= iy < height and 0 <= iz < layers):
            return f"cell {(ix, iy, iz)} is outside the map"
        if not free[iz, iy, ix]:
            return f"cell {(ix, iy, iz)} is not free"
    for one, other in pairwise(cells):
        if max(abs(a - b) for a, b in zip(one, other, strict=True)) != 1:
            return f"{one} and {other} are not neighbours"
        if not all(free[iz, iy, ix] for ix, iy, iz in product(*zip(one, other, strict=True))):
            return f"the step from {one} to {other} cuts a corner"
    return ""


def polyline_fault(
    occupied: NDArray[np.bool_], resolution_m: float, points: NDArray[np.float64], radius_m: float
) -> str:
    """Where a disc that follows the polyline comes nearer than its radius to an occupied cell, or "".

    occupied: (H, W) [iy, ix]   points: (K, 2) [m] from the lower left corner of cell (0, 0)
    The distance is that of the whole leg to the closed square of the cell, right to a micrometre.
    """
    squares = np.argwhere(occupied)[:, ::-1] * resolution_m  # (n, 2) lower left corners
    for (ax, ay), (bx, by) in pairwise(points.tolist()):
        reach_m = radius_m + resolution_m
        near = (squares[:, 0] <= max(ax, bx) + reach_m) & (squares[:, 0] >= min(ax, bx) - 2 * reach_m)
        near &= (squares[:, 1] <= max(ay, by) + reach_m) & (squares[:, 1] >= min(ay, by) - 2 * reach_m)
        for x, y in squares[near].tolist():
            distance_m = _leg_to_square_m((ax, ay), (bx, by), (x, y), resolution_m)
            if distance_m < radius_m - 1e-6:
                cell = (round(x / resolution_m), round(y / resolution_m))
                return (
                    f"the leg from ({ax:.3f}, {ay:.3f}) to ({bx:.3f}, {by:.3f}) passes cell {cell} at "
                    f"{distance_m:.4f} m, less than {radius_m} m"
                )
    return ""


Point = tuple[float, float]


def _leg_to_square_m(a: Point, b: Point, low: Point, side_m: float) -> float:
    """Distance between the leg a - b and the square with the lower left corner `low` [m]; 0 if they touch."""
    if _enters(a, b, low, side_m):
        return 0.0
    corners = [(low[0] + i * side_m, low[1] + j * side_m) for i, j in ((0, 0), (0, 1), (1, 0), (1, 1))]
    to_corners = min(_point_to_leg_m(corner, a, b) for corner in corners)
    to_ends = min(_point_to_square_m(point, low, side_m) for point in (a, b))
    return min(to_corners, to_ends)


def _enters(a: Point, b: Point, low: Point, side_m: float) -> bool:
    """Whether the leg has a point in the closed square (Liang and Barsky 1984)."""
    first, last = 0.0, 1.0
    for axis in (0, 1):
        change, one = b[axis] - a[axis], a[axis]
        if change == 0.0:
            if not low[axis] <= one <= low[axis] + side_m:
                return False
            continue
        times = sorted(((low[axis] - one) / change, (low[axis] + side_m - one) / change))
        first, last = max(first, times[0]), min(last, times[1])
    return first <= last


def _point_to_leg_m(point: Point, a: Point, b: Point) -> float:
    along_x, along_y = b[0] - a[0], b[1] - a[1]
    length2 = along_x**2 + along_y**2
    if length2 == 0.0:
        return math.dist(point, a)
    share = ((point[0] - a[0]) * along_x + (point[1] - a[1]) * along_y) / length2
    share = min(max(share, 0.0), 1.0)
    return math.dist(point, (a[0] + share * along_x, a[1] + share * along_y))


def _point_to_square_m(point: Point, low: Point, side_m: float) -> float:
    gaps = [max(low[axis] - point[axis], point[axis] - low[axis] - side_m, 0.0) for axis in (0, 1)]
    return math.hypot(*gaps)
