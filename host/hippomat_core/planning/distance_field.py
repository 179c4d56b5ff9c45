"""Shortest drivable distance from every cell to one goal. Kept per task until the task or the map changes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra

from hippomat_core.planning.costmap import Costmap, nearest_free
from hippomat_core.planning.graph import STRAIGHT


def distance_field(costmap: Costmap, cell: tuple[int, int]) -> NDArray[np.float64]:
    """(H, W) [m] along free cells to (ix, iy), exact; inf where there is no way or the cell is not free."""
    field = np.full(costmap.free.shape, math.inf)
    if not costmap.is_free(cell):
        return field
    graph = costmap.graph
    steps = dijkstra(graph.weights, directed=True, indices=[int(graph.node_of[cell[1], cell[0]])])[0]
    field[graph.cells[:, 1], graph.cells[:, 0]] = steps * (costmap.grid.resolution_m / STRAIGHT)
    return field


def distance_at(costmap: Costmap, field: NDArray[np.float64], x_m: float, y_m: float) -> float:
    """Drivable metres from (x, y) to the field's goal; inf where unreachable."""
    return float(distances_at(costmap, [field], x_m, y_m)[0])


def distances_at(
    costmap: Costmap, fields: Sequence[NDArray[np.float64]], x_m: float, y_m: float
) -> NDArray[np.float64]:
    """(K,) [m] from (x, y) to each field's goal; inf where unreachable.

    A point inside the inflation counts from the nearest free cell, plus the straight way to it.
    """
    cell = nearest_free(costmap, x_m, y_m)
    if cell is None:
        return np.full(len(fields), math.inf)
    extra_m = 0.0
    if cell != costmap.grid.cell_of(x_m, y_m):
        centre_x, centre_y = costmap.grid.centre_of(*cell)
        extra_m = math.hypot(centre_x - x_m, centre_y - y_m)
    return np.array([field[cell[1], cell[0]] for field in fields], np.float64) + extra_m
