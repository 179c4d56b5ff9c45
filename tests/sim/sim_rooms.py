"""Small maps for the simulation's tests."""

from __future__ import annotations

import numpy as np

from hippomat_core.maps.occupancy_grid import OccupancyGrid


def box_room(width_m: float = 4.0, height_m: float = 3.0, resolution_m: float = 0.05) -> OccupancyGrid:
    """A rectangular room with walls one cell thick; the inside begins at (0, 0)."""
    width, height = round(width_m / resolution_m) + 2, round(height_m / resolution_m) + 2
    cells = np.zeros((height, width), np.int8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    return OccupancyGrid(cells, resolution_m, -resolution_m, -resolution_m)


def odd_room(width_m: float = 5.0, height_m: float = 3.0, resolution_m: float = 0.05) -> OccupancyGrid:
    """A room that looks different from every place, and a chamber beside it that nobody drives into.

    An inner wall and a box in a corner tell places apart; the chamber is x > width_m - 1.2.
    """
    grid = box_room(width_m, height_m, resolution_m)
    cells = grid.cells.copy()
    cells[1 : round(1.1 / resolution_m), round(1.6 / resolution_m)] = 100
    cells[:, round((width_m - 1.2) / resolution_m)] = 100
    cells[-round(1.4 / resolution_m) :, -round(0.6 / resolution_m) :] = 100
    cells[-round(0.7 / resolution_m) :, : round(0.5 / resolution_m)] = 100
    return OccupancyGrid(cells, grid.resolution_m, grid.origin_x_m, grid.origin_y_m)
