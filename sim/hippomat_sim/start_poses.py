"""Where the robots of a simulated run stand at first: spread over the free space they can reach.

A pure function of map, number and seed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from hippomat_core.errors import MapError
from hippomat_core.planning.costmap import Costmap

APART_RADII = 4.0  # two starts are at least two diameters apart


def start_poses(costmap: Costmap, robots: int, robot_radius_m: float, seed: int) -> NDArray[np.float64]:
    """(robots, 3) x, y [m], yaw [rad] in one connected area, each as far from the others as there is room.

    The first lies anywhere, by the seed; each next one is the candidate farthest from all before it.
    Raises MapError where the map is too small for so many robots.
    """
    rng = np.random.default_rng([seed, 0x57A7])
    points = _area(costmap)
    if not len(points):
        raise MapError(f"the map has no free place for a robot of radius {robot_radius_m} m; check the map")
    chosen = [points[rng.integers(len(points))]]
    distance = np.full(len(points), math.inf)
    for _ in range(robots - 1):
        distance = np.minimum(distance, np.hypot(*(points - chosen[-1]).T))
        # Among the far half a random one: corners alone would make every run begin alike.
        far = np.flatnonzero(distance >= 0.75 * distance.max())
        pick = int(rng.choice(far))
        if distance[pick] < APART_RADII * robot_radius_m:
            raise MapError(
                f"the map has room for {len(chosen)} robots of radius {robot_radius_m} m, {robots} were "
                "asked for; use fewer robots or a larger map"
            )
        chosen.append(points[pick])
    yaw = rng.uniform(-math.pi, math.pi, robots)
    return np.column_stack([np.array(chosen), np.round(yaw, 3)])


def _area(costmap: Costmap) -> NDArray[np.float64]:
    """(P, 2) [m]: cell centres of the largest connected area, with some room to walls where there is any."""
    cells, grid = costmap.graph.cells, costmap.grid
    if not len(cells):
        return np.empty((0, 2))
    _, label = connected_components(costmap.graph.weights, directed=False)
    cells = cells[label == np.argmax(np.bincount(label))]
    roomy = costmap.clearance_m[cells[:, 1], cells[:, 0]] >= 1.5 * costmap.radius_m
    cells = cells[roomy] if roomy.any() else cells
    corner = np.array([grid.origin_x_m, grid.origin_y_m])
    return np.asarray(np.round(corner + (cells + 0.5) * grid.resolution_m, 4))
