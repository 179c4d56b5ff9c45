"""Everything derived once from a map: costmap, reachable cells, task sites, the largest travel cost.

The same map and settings give the same values on every robot. Knows no tasks' generations and no claims.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from hippomat_core.config import Config
from hippomat_core.errors import MapError
from hippomat_core.fleet.sites import task_sites
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.motion.lattice import Lattice, lattice_of
from hippomat_core.planning.costmap import Costmap, inflate
from hippomat_core.planning.distance_field import distance_field
from hippomat_core.planning.reservations import keep_out_m
from hippomat_core.wire.frames import MAX_INTENT_STEPS

OFF_PATH_M = 0.05  # nodes of the lattice are so much farther apart than robots keep out of each other
FIELDS_KEPT = 4  # beside those of the open tasks: a claim keeps its destination when its slot turns


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
    mask = np.zeros(costmap.free.shape, bool)
    if len(costmap.graph.cells):
        _, label = connected_components(costmap.graph.weights, directed=False)
        cells = costmap.graph.cells[label == np.argmax(np.bincount(label))]
        mask[cells[:, 1], cells[:, 0]] = True
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


Key = tuple[int, int]  # slot, generation


@dataclass(frozen=True, slots=True, eq=False)
class Fields:
    """One distance field per task, kept until that task or the map changes."""

    by_task: dict[Key, NDArray[np.float64]]  # never written to after it is stored; newest last

    def with_tasks(self, ground: Ground, wanted: dict[Key, tuple[float, float]]) -> Fields:
        """Fields for all wanted tasks (key -> x, y in metres), computing only those that are missing."""
        missing = [key for key in wanted if key not in self.by_task]
        if not missing:
            return self
        old = {key: field for key, field in self.by_task.items() if key not in wanted}
        kept = dict(list(old.items())[-FIELDS_KEPT:])
        for key, (x_m, y_m) in wanted.items():
            held = self.by_task.get(key)
            cell = ground.costmap.grid.cell_of(x_m, y_m)
            kept[key] = distance_field(ground.costmap, cell) if held is None else held
        return Fields(kept)
