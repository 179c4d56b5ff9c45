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
