"""Occupied cells of a map as few axis-parallel boxes. Knows grids, not physics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.costmap import OCCUPIED_FROM


def wall_boxes(grid: OccupancyGrid) -> NDArray[np.float64]:
    """(B, 4) x_min, y_min, x_max, y_max [m]: disjoint boxes that cover the occupied cells exactly.

    Runs along x are merged with equal runs in the next rows. Unknown cells are no walls.
    """
    rectangles = _merged_runs(grid.cells >= OCCUPIED_FROM)
    origin = np.array([grid.origin_x_m, grid.origin_y_m, grid.origin_x_m, grid.origin_y_m])
    return origin + np.array(rectangles, dtype=np.float64).reshape(-1, 4) * grid.resolution_m


def _merged_runs(occupied: NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
    """Cell rectangles (ix0, iy0, ix1, iy1), upper bounds exclusive."""
    done: list[tuple[int, int, int, int]] = []
    open_runs: dict[tuple[int, int], int] = {}  # (ix0, ix1) -> first row
    for iy in range(occupied.shape[0] + 1):
        runs = _runs(occupied[iy]) if iy < occupied.shape[0] else set()
        for run in [run for run in open_runs if run not in runs]:
            done.append((run[0], open_runs.pop(run), run[1], iy))
        for run in sorted(runs):
            open_runs.setdefault(run, iy)
    return done


def _runs(row: NDArray[np.bool_]) -> set[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], row.astype(np.int8), [0]))))
    return {(int(a), int(b)) for a, b in edges.reshape(-1, 2)}
