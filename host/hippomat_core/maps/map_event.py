"""A grid as the event that brings it into the core, and back."""

from __future__ import annotations

import numpy as np

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import MapDrawn, MapReceived


def map_event(grid: OccupancyGrid, stamp_ns: int = 0, epoch: int = 0) -> MapReceived:
    height, width = grid.cells.shape
    cells = np.ascontiguousarray(grid.cells).ravel()
    origin = (grid.origin_x_m, grid.origin_y_m)
    return MapReceived(stamp_ns, epoch, width, height, grid.resolution_m, *origin, cells)


def grid_in(event: MapReceived | MapDrawn) -> OccupancyGrid:
    cells = np.array(event.cells, np.int8).reshape(event.height, event.width)
    return OccupancyGrid(cells, event.resolution_m, event.origin_x_m, event.origin_y_m)
