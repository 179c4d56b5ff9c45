"""What a new map leaves standing of what was planned on the old one. Decides nothing else.

A field is the distance to its goal exactly if every cell agrees with its neighbours: 0 at the goal, elsewhere
the least of (neighbour + step) over the allowed steps, UNREACHED where there is none. (Step lengths are
positive, so from a cell that agrees one can walk down to the goal, and nobody can be nearer.) In a field that
was right on the old map only the cells whose steps have changed can disagree: looking at these decides,
exactly.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.planning.distance_field import DistanceField
from hippomat_core.planning.field3d import CellSpace
from hippomat_core.planning.graph import LONGEST, STEPS, UNREACHED, CellPlane


def changed_nodes(old: CellPlane | CellSpace, new: CellPlane | CellSpace) -> NDArray[np.int64]:
    """(K,) the cells that became free or not, or that gained or lost a step. Equal shapes."""
    freed = np.pad(old.free != new.free, 1).ravel()
    return np.flatnonzero(freed | (old.steps_out != new.steps_out))


def field_holds(space: CellPlane | CellSpace, field: DistanceField, nodes: NDArray[np.int64]) -> bool:
    """Whether a field of another space is this one's, too, cell for cell. nodes: changed_nodes of both."""
    free = np.pad(space.free, 1).ravel()[nodes]
    goal = space.node_of(field.goal) if space.is_free(field.goal) else -1
    return bool(_agree(space.steps_out, space.offsets, space.lengths, nodes, free, goal, field.nodes))


def path_holds(plane: CellPlane, path: NDArray[np.int32]) -> bool:
    """Whether a path may be driven here: every cell free, every step allowed. It may no longer be shortest.

    path: (K, 2) [ix, iy], cells inside the grid
    """
    if not plane.free[path[:, 1], path[:, 0]].all():
        return False
    bits = {step: bit for bit, step in enumerate(STEPS)}
    steps = [bits[dx, dy] for dx, dy in np.diff(path, axis=0).tolist()]
    nodes = (path[:-1, 1] + 1) * (plane.free.shape[1] + 2) + path[:-1, 0] + 1
    return bool((plane.steps_out[nodes] >> np.array(steps, np.uint8) & 1).all())


@njit(cache=True, nogil=True)
def _agree(
    steps_out: NDArray[np.uint8] | NDArray[np.uint32],
    offsets: NDArray[np.int32],
    lengths: NDArray[np.int32],
    nodes: NDArray[np.int64],
    free: NDArray[np.bool_],
    goal: int,
    field: NDArray[np.int32],
) -> bool:
    """Whether every one of `nodes` has the value that its neighbours give it. free: (K,) of the nodes."""
    for place in range(len(nodes)):
        node = nodes[place]
        least = UNREACHED
        if node == goal:
            least = 0
        elif free[place]:
            steps = int(steps_out[node])
            for bit in range(len(offsets)):
                if steps >> bit & 1:
                    beyond = field[node + offsets[bit]]
                    if beyond <= LONGEST - lengths[bit]:
                        least = min(least, beyond + lengths[bit])
        if least != field[node]:
            return False
    return True
