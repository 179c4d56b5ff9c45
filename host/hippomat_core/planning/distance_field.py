"""Shortest drivable distance from every cell to one goal, exact. On the ground; field3d.py fills the air's.

Buckets as wide as the shortest step settle every cell in one pass (Dial 1969, Algorithm 360; Denardo and Fox
1979); most steps are never looked at (graph.ONWARD).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.planning.costmap import Costmap, nearest_free
from hippomat_core.planning.field3d import CellSpace, space_field
from hippomat_core.planning.graph import (
    LENGTHS,
    LONGEST,
    LOWEST,
    NO_STEP,
    ONWARD,
    STRAIGHT,
    UNREACHED,
    CellPlane,
)

_RING = 3  # buckets in use at once: a step from one ends at most two further on


@dataclass(frozen=True, slots=True, eq=False)
class DistanceField:
    """Exact in whole units; reads as an array of metres, float64, inf where there is no way.

    The array is (H, W) [iy, ix] on the ground, (Z, Y, X) [iz, iy, ix] in the air.
    """

    goal: tuple[int, ...]  # (ix, iy) or (ix, iy, iz)
    nodes: NDArray[np.int32]  # by node, with a border: [1 / STRAIGHT of a cell's side] or UNREACHED
    shape: tuple[int, ...]
    cell_m: float

    @property
    def units(self) -> NDArray[np.int32]:
        """The array in units: a view of nodes."""
        bordered = self.nodes.reshape([side + 2 for side in self.shape])
        return bordered[(slice(1, -1),) * len(self.shape)]

    def __getitem__(self, index: Any) -> Any:
        return in_metres(self.units[index], self.cell_m)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(in_metres(self.units, self.cell_m), dtype)


def in_metres(units: NDArray[np.int32], cell_m: float) -> Any:
    """Distances [m], inf where UNREACHED."""
    return np.where(units == UNREACHED, math.inf, units * (cell_m / STRAIGHT))[()]


def field_to(space: CellPlane | CellSpace, goal: tuple[int, ...], cell_m: float) -> DistanceField:
    """On the ground or in the air; no way from anywhere where the goal is not a free cell."""
    nodes = plane_field(space, goal) if isinstance(space, CellPlane) else space_field(space, goal)
    return DistanceField(goal, nodes, space.free.shape, cell_m)


def distance_field(costmap: Costmap, cell: tuple[int, int]) -> DistanceField:
    """To (ix, iy) over the costmap's free cells."""
    return field_to(costmap.graph, cell, costmap.grid.resolution_m)


def plane_field(plane: CellPlane, cell: tuple[int, ...]) -> NDArray[np.int32]:
    """((H + 2) (W + 2),) [1 / STRAIGHT of a cell's side] with a border of UNREACHED."""
    nodes = np.full(plane.steps_out.shape, UNREACHED, np.int32)
    if plane.is_free(cell):
        _spread(plane.steps_out, plane.offsets, plane.node_of(cell), nodes)
    return nodes


@njit(cache=True, nogil=True)
def _spread(
    steps_out: NDArray[np.uint8], offsets: NDArray[np.int32], goal: int, field: NDArray[np.int32]
) -> None:
    """Fill `field` (all UNREACHED) from `goal`. A cell enters a bucket at most once, so the ring suffices."""
    ring = np.empty((_RING, len(steps_out)), np.int32)
    counts = np.zeros(_RING, np.int64)
    came = np.empty(len(steps_out), np.uint8)
    field[goal] = 0
    came[goal] = NO_STEP
    ring[0, 0] = goal
    counts[0] = 1
    begin = 0  # of the bucket
    here = 0
    while counts.sum() > 0:
        for place in range(counts[here]):
            node = ring[here, place]
            reached = field[node]
            if reached < begin:
                continue  # it got a shorter way, and was settled, in an earlier bucket
            steps = ONWARD[came[node], steps_out[node]]
            while steps:
                step = LOWEST[steps]
                steps &= steps - 1
                end = node + offsets[step]
                there, before = reached + LENGTHS[step], field[end]
                if there < before and there <= LONGEST:
                    field[end] = there
                    came[end] = step
                    further = 1 if there < begin + 2 * STRAIGHT else 2
                    old_further = 1 if before < begin + 2 * STRAIGHT else 2
                    if before == UNREACHED or further != old_further:
                        slot = (here + further) % _RING
                        ring[slot, counts[slot]] = end
                        counts[slot] += 1
        counts[here] = 0
        here = (here + 1) % _RING
        begin += STRAIGHT


def distance_at(costmap: Costmap, field: DistanceField, x_m: float, y_m: float) -> float:
    """Drivable metres from (x, y) to the field's goal; inf where unreachable."""
    return float(distances_at(costmap, [field], x_m, y_m)[0])


def distances_at(
    costmap: Costmap, fields: Sequence[DistanceField], x_m: float, y_m: float
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
    node, unit_m = costmap.graph.node_of(cell), costmap.grid.resolution_m / STRAIGHT
    units = [field.nodes.item(node) for field in fields]  # a dozen numbers: no work for arrays
    return np.array([math.inf if way == UNREACHED else way * unit_m + extra_m for way in units], np.float64)
