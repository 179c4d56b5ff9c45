"""One distance field per task, kept until that task or the map under it changes: costs are look-ups.

On the ground and in the air alike. Knows cells and tasks' keys, no robots, no speeds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.planning.distance_field import DistanceField, field_to
from hippomat_core.planning.field3d import CellSpace
from hippomat_core.planning.graph import CellPlane
from hippomat_core.planning.map_change import changed_nodes, field_holds

FIELDS_KEPT = 4  # beside those of the open tasks: a claim keeps its destination when its slot turns

Key = tuple[int, int]  # slot, generation


@dataclass(frozen=True, slots=True, eq=False)
class Fields:
    """As a value: what changes it gives another one."""

    by_task: dict[Key, DistanceField]  # never written to after it is stored; newest last

    def with_goals(
        self, space: CellPlane | CellSpace, goals: Mapping[Key, tuple[int, ...]], cell_m: float
    ) -> Fields:
        """Fields for all wanted tasks (key -> goal cell), computing only those that are missing."""
        if all(key in self.by_task for key in goals):
            return self
        old = {key: field for key, field in self.by_task.items() if key not in goals}
        kept = dict(list(old.items())[-FIELDS_KEPT:])
        for key, goal in goals.items():
            held = self.by_task.get(key)
            kept[key] = field_to(space, goal, cell_m) if held is None else held
        return Fields(kept)

    def with_space(self, old: CellPlane | CellSpace, new: CellPlane | CellSpace) -> Fields:
        """Those that are the same in the new space, cell for cell. Both spaces lie on the same grid."""
        if old.free.shape != new.free.shape:
            return Fields({})
        nodes = changed_nodes(old, new)
        return Fields({key: field for key, field in self.by_task.items() if field_holds(new, field, nodes)})

    def matrix(self, tasks: Sequence[Key], nodes: NDArray[np.int64]) -> NDArray[np.int32]:
        """(N, M) [1 / STRAIGHT of a cell's side] from N places to M tasks; UNREACHED where there is no way.

        nodes: (N,) node_of() the places, each inside the grid
        """
        rows = [self.by_task[task].nodes[nodes] for task in tasks]
        return np.array(rows, np.int32).reshape(len(tasks), len(nodes)).T
