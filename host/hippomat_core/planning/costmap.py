"""Where a robot's centre may be: the inflated occupancy grid (names and costs are nav2's). Knows no peers.

Clearance is measured from a cell's centre to the nearest edge of an occupied cell, so that a robot in a free
cell really has that much room; nav2 measures from centre to centre, half a cell less careful.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.graph import CellPlane, cell_plane

INSCRIBED, LETHAL, NO_INFORMATION = 253, 254, 255
OCCUPIED_FROM = 65  # percent; map_server's occupied_thresh


@dataclass(frozen=True, slots=True, eq=False)
class Costmap:
    """Inflated map on the grid of `grid`. Arrays are (H, W) [iy, ix]."""

    grid: OccupancyGrid
    radius_m: float
    free: NDArray[np.bool_]  # the robot's centre may be here
    clearance_m: NDArray[np.float32]  # cell centre to the nearest occupied edge; 0 inside obstacles
    cost: NDArray[np.uint8]  # nav2: 254 lethal, 253 nearer than radius, then decaying, 255 unknown
    graph: CellPlane

    def centres(self, cells: NDArray[np.int32]) -> NDArray[np.float64]:
        """(n, 2) [m]: the middles of cells (n, 2) [ix, iy]."""
        grid = self.grid
        return _middles(cells, grid.resolution_m, grid.origin_x_m, grid.origin_y_m)

    def is_free(self, cell: tuple[int, int]) -> bool:
        """True where (ix, iy) lies in the grid and is free."""
        return self.grid.holds(*cell) and bool(self.free[cell[1], cell[0]])


@njit(cache=True, nogil=True)
def _middles(
    cells: NDArray[np.int32], resolution_m: float, origin_x_m: float, origin_y_m: float
) -> NDArray[np.float64]:
    middles = np.empty(cells.shape, np.float64)
    for k in range(len(cells)):
        middles[k, 0] = (cells[k, 0] + 0.5) * resolution_m + origin_x_m
        middles[k, 1] = (cells[k, 1] + 0.5) * resolution_m + origin_y_m
    return middles


def inflate(
    grid: OccupancyGrid, radius_m: float, scaling: float = 10.0, allow_unknown: bool = False
) -> Costmap:
    """The costmap in which cells nearer than radius_m to an occupied cell are not free.

    Unknown cells are free only with allow_unknown; as in nav2 they are not inflated.
    """
    occupied = grid.cells >= OCCUPIED_FROM
    unknown = (grid.cells < 0) | ((grid.cells > 0) & ~occupied)
    clearance_m = _clearance_m(occupied, grid.resolution_m)
    free = (clearance_m >= radius_m) & ~occupied & (True if allow_unknown else ~unknown)
    decayed = (INSCRIBED - 1) * np.exp(-scaling * np.maximum(clearance_m - radius_m, 0.0))
    cost = np.rint(decayed).astype(np.uint8)
    cost[clearance_m < radius_m] = INSCRIBED
    cost[unknown] = NO_INFORMATION
    cost[occupied] = LETHAL
    return Costmap(grid, radius_m, free, clearance_m, cost, cell_plane(free))


def _clearance_m(occupied: NDArray[np.bool_], resolution_m: float) -> NDArray[np.float32]:
    """Exact distance from each cell centre to the closed squares of the occupied cells [m]."""
    height, width = occupied.shape
    if not occupied.any():
        return np.full(occupied.shape, math.hypot(height, width) * resolution_m, np.float32)
    # On the lattice of half cells a square covers 3 x 3 points, and its point nearest to another cell's
    # centre is always one of them: an exact transform of the lattice is the exact distance to the squares.
    lattice = np.zeros((2 * height + 1, 2 * width + 1), np.uint8)
    lattice[1::2, 1::2] = occupied
    covered = cv2.dilate(lattice, np.ones((3, 3), np.uint8)) > 0
    half_cells = cv2.distanceTransform((~covered).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # Rounded to a micrometre: 0.05 m cells at 0.175 m must compare as >= 0.175 in float32.
    metres = np.round(half_cells[1::2, 1::2].astype(np.float64) * (resolution_m / 2), 6)
    return metres.astype(np.float32)


def reachable(costmap: Costmap, x_m: float, y_m: float) -> NDArray[np.bool_]:
    """(H, W): the free cells that a robot at (x, y) can drive to; all False where it stands on none."""
    mask = np.zeros(costmap.free.shape, bool)
    cell = nearest_free(costmap, x_m, y_m)
    if cell is not None:
        part = parts(costmap.free)
        mask = part == part[cell[1], cell[0]]
    return mask


def parts(free: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(H, W) which connected part a free cell belongs to, 1 .. n; 0 where not free.

    Without corner cutting a diagonal step never leads where straight ones do not.
    """
    _, label = cv2.connectedComponents(free.astype(np.uint8), connectivity=4, ltype=cv2.CV_32S)
    return np.asarray(label, np.int32)


def nearest_free(costmap: Costmap, x_m: float, y_m: float, reach_m: float = 0.25) -> tuple[int, int] | None:
    """The free cell that holds (x, y), else the one with the nearest centre within reach_m, else None.

    A robot that stands slightly too near a wall still has a way out.
    """
    grid = costmap.grid
    ix, iy = grid.cell_of(x_m, y_m)
    if costmap.is_free((ix, iy)):
        return ix, iy
    k = math.ceil(reach_m / grid.resolution_m) + 1
    x0, y0 = max(ix - k, 0), max(iy - k, 0)
    window = costmap.free[y0 : max(iy + k + 1, 0), x0 : max(ix + k + 1, 0)]
    near_y, near_x = np.nonzero(window)
    if not len(near_x):
        return None
    centre_x, centre_y = grid.centre_of(x0, y0)
    distance_m = np.hypot(
        centre_x + near_x * grid.resolution_m - x_m, centre_y + near_y * grid.resolution_m - y_m
    )
    best = int(np.argmin(distance_m))
    if distance_m[best] > reach_m:
        return None
    return x0 + int(near_x[best]), y0 + int(near_y[best])
