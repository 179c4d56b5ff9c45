"""Our own map for demonstrations: a room of 5 x 5 m with nine obstacles, as ROS pgm + yaml.

The files are what `draw_demo_room` draws; a test holds them equal. To change the room, change the drawing
and save it again with hippomat_logs.map_files.save_map.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hippomat_core.maps.occupancy_grid import FREE, OCCUPIED, OccupancyGrid

DEMO_ROOM = Path(__file__).with_name("demo_room.yaml")

RESOLUTION_M = 0.05
INNER_M = 5.0  # free side; two cells of wall around it
PILLAR_M = 0.15  # radius
CRATE_M = 0.15  # half side
PITCH_M = 1.25  # between obstacle centres
CHAMFER_M = 0.6  # the room's corners are cut off


def draw_demo_room() -> OccupancyGrid:
    """Round pillars and square crates in turn on a 3 x 3 lattice, centre of the room at (0, 0)."""
    side = round(INNER_M / RESOLUTION_M) + 4
    low_m = -side * RESOLUTION_M / 2
    centres_m = low_m + (np.arange(side) + 0.5) * RESOLUTION_M
    x, y = np.meshgrid(centres_m, centres_m)
    half_m = INNER_M / 2
    occupied = (np.abs(x) > half_m) | (np.abs(y) > half_m) | (np.abs(x) + np.abs(y) > 2 * half_m - CHAMFER_M)
    for column in (-1, 0, 1):
        for row in (-1, 0, 1):
            dx, dy = x - column * PITCH_M, y - row * PITCH_M
            if (column + row) % 2:
                occupied |= np.maximum(np.abs(dx), np.abs(dy)) <= CRATE_M
            else:
                occupied |= np.hypot(dx, dy) <= PILLAR_M
    cells = np.where(occupied, OCCUPIED, FREE).astype(np.int8)
    return OccupancyGrid(cells, RESOLUTION_M, low_m, low_m)
