"""Everything derived once from a map: costmap, reachable cells, task sites, the largest travel cost.

The same map and settings give the same values on every robot. Knows no tasks' generations and no claims.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import Config
from hippomat_core.errors import MapError
from hippomat_core.fleet.sites import task_sites
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.motion.lattice import Lattice, lattice_of
from hippomat_core.planning.costmap import Costmap, inflate, parts
from hippomat_core.planning.distance_field import distance_field
from hippomat_core.planning.reservations import keep_out_m
from hippomat_core.wire.frames import MAX_INTENT_STEPS

OFF_PATH_M = 0.05  # nodes of the lattice are so much farther apart than robots keep out of each other


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """A map as the robot uses it. Arrays are (H, W) [iy, ix]."""

    epoch: int
    costmap: Costmap
    drivable: NDArray[np.bool_]  # the largest connected part of the costmap's free cells
    sites: NDArray[np.int16]  # (S, 3) [cm], where tasks may stand
    c_max_s: float
    lattice: Lattice | None = None  # given where the fleet plans its moves together


def ground_of(grid: OccupancyGrid, epoch: int, config: Config) -> Ground:
    """Raises MapError where the map has no room for the robot or its tasks."""
    costmap = inflate(
        grid,
        config.planning.inflation_radius,
        config.planning.cost_scaling_factor,
        config.planning.allow_unknown,
    )
    drivable = _largest_part(costmap)
    sites = task_sites(drivable, grid.resolution_m, grid.origin_x_m, grid.origin_y_m, config.robot.radius_m)
    if not len(sites):
        raise MapError(
            f"the map has no free cell with {config.planning.inflation_radius} m clearance: lower "
            "[planning] inflation_radius or use a map with more room"
        )
    c_max_s = config.fleet.c_max_s or _longest_way_m(costmap, sites) / config.limits.speed_mps
    return Ground(epoch, costmap, drivable, sites, c_max_s, _lattice(costmap, config))


def _lattice(costmap: Costmap, config: Config) -> Lattice | None:
    if config.planning.planner == "replan":
        return None
    apart_m = keep_out_m(config) + OFF_PATH_M
    lattice = lattice_of(costmap, apart_m)
    if lattice is None or lattice.side > MAX_INTENT_STEPS - 1:
        why = f"cells of {costmap.grid.resolution_m} m" if lattice is not None else "this map's free space"
        raise MapError(
            f"[planning] planner = {config.planning.planner!r} cannot lay nodes {apart_m:.2f} m apart over "
            f"{why}: use a map with cells of about 0.05 m and room for two robots, or planner = 'replan'"
        )
    return lattice


def _largest_part(costmap: Costmap) -> NDArray[np.bool_]:
    part = parts(costmap.free)
    sizes = np.bincount(part.ravel())
    sizes[0] = 0
    mask: NDArray[np.bool_] = (part == np.argmax(sizes)) & costmap.free
    return mask


def _longest_way_m(costmap: Costmap, sites: NDArray[np.int16]) -> float:
    """The longest shortest path, estimated by going to the farthest cell twice, with a tenth to spare.

    Exact eccentricities would take a field per cell; a cost beyond this saturates and raises an alarm.
    """
    cell = costmap.grid.cell_of(float(sites[0, 0]) / 100, float(sites[0, 1]) / 100)
    longest_m = 0.0
    for _ in range(2):
        field = distance_field(costmap, cell)
        finite = np.where(np.isfinite(field), field, -1.0)
        iy, ix = np.unravel_index(int(np.argmax(finite)), field.shape)
        cell, longest_m = (int(ix), int(iy)), float(finite[iy, ix])
    return max(longest_m * 1.1, costmap.grid.resolution_m)
