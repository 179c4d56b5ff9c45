"""A path of cells pulled straight: fewer, longer legs in any direction, as safe as the path of cells itself.

Why that is exact. The costmap promises the robot's radius at the centres of its free cells. Take the square
between the centres of 2 x 2 free cells: the distance to an occupied cell, itself a square of the same
lattice, grows or falls along x and along y without a minimum in between, so over the square it is least at
one of its four corners, and these are free. The same holds on the line between two free neighbours. So a leg
keeps the radius everywhere if every square it crosses has four free corners (where it runs along the lattice,
every centre it meets). It may refuse a leg that would just pass; it never allows one that does not. A
diagonal step without corner cutting is such a leg, so every path can be smoothed.

Knows cells, not peers or time: whoever drives a smoothed path reserves its own cells.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.planning.astar import Path
from hippomat_core.planning.costmap import Costmap


def smooth(costmap: Costmap, path: Path) -> NDArray[np.float64]:
    """(K, 2) [m] corners of a polyline from the path's first cell centre to its last, never longer.

    path: (n, 2) [ix, iy], free and without cut corners, as from shortest_path
    """
    return costmap.centres(smoothed_cells(costmap.free, path))


def smoothed_cells(free: NDArray[np.bool_], path: Path) -> Path:
    """(K, 2) those cells of the path at which the smoothed one turns, its ends included."""
    if len(path) < 3:
        return path
    return path[_pulled(free, np.ascontiguousarray(path, np.int32))]


@njit(cache=True, nogil=True)
def _pulled(free: NDArray[np.bool_], path: NDArray[np.int32]) -> NDArray[np.int64]:
    """Indices of the corners: each the farthest cell of the path in sight of the one before."""
    kept = np.empty(len(path), np.int64)
    kept[0], count, last = 0, 1, len(path) - 1
    while kept[count - 1] < last:
        anchor = kept[count - 1]
        reach = anchor + 1  # a step of the path is always in sight
        for index in range(anchor + 2, len(path)):
            if in_sight(free, path[anchor, 0], path[anchor, 1], path[index, 0], path[index, 1]):
                reach = index
            elif index > 2 * reach - anchor + 8:
                break  # long out of sight
        kept[count] = reach
        count += 1
    return kept[:count]


@njit(cache=True, nogil=True)
def in_sight(free: NDArray[np.bool_], ax: int, ay: int, bx: int, by: int) -> bool:
    """Whether a robot may drive straight from the centre of cell (ax, ay) to that of (bx, by).

    free: (H, W); both cells are inside. Exact, in whole numbers.
    """
    if abs(by - ay) > abs(bx - ax):
        return _sees(free.T, ay, ax, by, bx)
    return _sees(free, ax, ay, bx, by)


@njit(cache=True, nogil=True)
def _sees(free: NDArray[np.bool_], ax: int, ay: int, bx: int, by: int) -> bool:
    """The same where x changes at least as much as y: column by column of the squares between the centres."""
    if ax > bx:
        ax, ay, bx, by = bx, by, ax, ay
    run, rise = bx - ax, by - ay
    for ix in range(ax, bx):
        # The leg's heights at both sides of this column, times run; it covers the rows between.
        one, other = ay * run + (ix - ax) * rise, ay * run + (ix + 1 - ax) * rise
        low, high = min(one, other) // run, -(-max(one, other) // run)
        for iy in range(low, high + 1):
            if not (free[iy, ix] and free[iy, ix + 1]):
                return False
    return bool(free[ay, ax])
