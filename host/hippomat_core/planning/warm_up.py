"""Plans in a tiny hall before the first map: what numba compiles of planning is compiled."""

from __future__ import annotations

import numpy as np

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.astar import shortest_path
from hippomat_core.planning.costmap import inflate
from hippomat_core.planning.distance_field import distance_field
from hippomat_core.planning.field_cache import Fields
from hippomat_core.planning.smoothing import smooth

START, GOAL = (1, 1), (6, 3)


def warm_up() -> None:
    """Each kernel once, with the kinds of arrays that a robot's map gives."""
    costmap = inflate(OccupancyGrid(np.zeros((5, 8), np.int8), 1.0, 0.0, 0.0), 0.0)
    walls = np.zeros((5, 8), np.int8)
    walls[:4, 4] = 100
    walled = inflate(OccupancyGrid(walls, 1.0, 0.0, 0.0), 0.0)
    nothing = np.zeros(costmap.free.shape, np.bool_)
    for blocked in (None, nothing):
        for field in (None, distance_field(walled, GOAL)):
            path = shortest_path(walled, START, GOAL, blocked, field)
            assert path is not None
            smooth(walled, path)
    fields = Fields({}).with_goals(walled.graph, {(0, 0): GOAL}, 1.0)
    fields.with_space(walled.graph, costmap.graph)
