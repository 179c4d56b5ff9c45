"""Where the robots of a simulated run stand at first: spread over the free space they can reach.

A pure function of map, number and seed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import MapError
from hippomat_core.planning.ground import Ground

APART_RADII = 4.0  # two starts are at least two diameters apart


def start_poses(ground: Ground, robots: int, robot_radius_m: float, seed: int) -> NDArray[np.float64]:
    """(robots, 3) x, y [m], yaw [rad] in one connected area, each as far from the others as there is room.

    The first lies anywhere, by the seed; each next one is one of the places far from all before it.
    Raises MapError where the map is too small for so many robots.
    """
    rng = np.random.default_rng([seed, 0x57A7])
    points = _places(ground)
    chosen = [points[rng.integers(len(points))]]
    distance = np.full(len(points), math.inf)
    for _ in range(robots - 1):
        distance = np.minimum(distance, np.hypot(*(points - chosen[-1]).T))
        # Among the far ones a random one: corners alone would make every run begin alike.
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


def _places(ground: Ground) -> NDArray[np.float64]:
    """(P, 2) [m]: drivable cell centres, those with some room to the walls where there are any."""
    costmap, grid = ground.costmap, ground.costmap.grid
    roomy = ground.drivable & (costmap.clearance_m >= 1.5 * costmap.radius_m)
    iy, ix = np.nonzero(roomy if roomy.any() else ground.drivable)
    corner = np.array([grid.origin_x_m, grid.origin_y_m])
    return np.asarray(np.round(corner + (np.column_stack([ix, iy]) + 0.5) * grid.resolution_m, 4))
