"""Is this path drivable? An independent check that shares no code with the planners it judges."""

from __future__ import annotations

from itertools import pairwise

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
