"""The cells that real robots are planned on: wide squares laid over the fine map so that two never touch.

A node is a fine cell of the costmap every `side` cells, where a robot's centre may be; a move is a straight
line of free fine cells between two of them. Two robots on different nodes, or on moves that share no node and
pass none, are at least a side apart. The squares are laid so that as many nodes as possible hang together:
equal maps give equal lattices. Knows no robots.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from hippomat_core.motion.graph import MotionGraph, largest_part, motion_graph
from hippomat_core.planning.costmap import Costmap
from hippomat_core.planning.field3d import STEPS_3D
from hippomat_core.planning.graph import CellPlane

NOWHERE = -1
_TRIED = 6  # of all ways to lay the squares, those with most nodes are looked at closely


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """K nodes."""

    graph: MotionGraph  # with diagonals
    centre: NDArray[np.int32]  # (K, 2) [ix, iy] fine cell of each node
    near: NDArray[np.int32]  # (H, W) the node nearest to each free fine cell, by driving; NOWHERE if none
    side: int  # [fine cells] between neighbouring nodes


def lattice_of(costmap: Costmap, apart_m: float) -> Lattice | None:
    """Nodes at least apart_m from each other; None where the map has no room for two that are connected."""
    side = int(np.ceil(apart_m / costmap.grid.resolution_m - 1e-6))
    free = costmap.free
    laid = sorted(product(range(side), repeat=2), key=lambda o: -int(free[o[1] :: side, o[0] :: side].sum()))
    graphs = [(_graph(free, side, ox, oy), ox, oy) for ox, oy in laid[:_TRIED]]
    parts = [largest_part(graph) if len(graph.cells) else np.zeros(0, np.int32) for graph, _, _ in graphs]
    best = max(range(len(graphs)), key=lambda k: len(parts[k]))  # the first of equals
    graph, ox, oy = graphs[best]
    if len(parts[best]) < 2:
        return None
    centre = (graph.cells[:, :2] * side + np.array([ox, oy])).astype(np.int32, order="C")
    return Lattice(graph, centre, _near(costmap, centre, parts[best]), side)


def _graph(free: NDArray[np.bool_], side: int, ox: int, oy: int) -> MotionGraph:
    """The nodes at this offset, without the moves that a wall is in the way of."""
    graph = motion_graph(free[oy::side, ox::side], diagonals=True)
    padded = np.pad(free, side)
    x, y = (graph.cells[:, :2] * side + np.array([ox, oy]) + side).T
    flat = [step for step in STEPS_3D if step[2] == 0]
    neighbours = graph.neighbours.copy()
    for column in range(neighbours.shape[1]):
        leads = np.flatnonzero(neighbours[:, column] >= 0)
        if not len(leads):
            continue
        way = graph.cells[neighbours[leads[0], column]] - graph.cells[leads[0]]
        dx, dy, _ = next(step for step in flat if step == tuple(way.tolist()))
        open_ = np.ones(len(x), np.bool_)
        for k in range(1, side + 1):
            open_ &= padded[y + k * dy, x + k * dx]
            open_ &= padded[y + (k - 1) * dy, x + k * dx] & padded[y + k * dy, x + (k - 1) * dx]
        neighbours[~open_, column] = NOWHERE
    return MotionGraph(
        graph.cells,
        graph.node_of,
        neighbours,
        graph.middles,
        graph.beside,
        graph.places,
        graph.place_count,
        True,
    )


def _near(costmap: Costmap, centre: NDArray[np.int32], part: NDArray[np.int32]) -> NDArray[np.int32]:
    plane = costmap.graph
    sources = np.array([plane.node_of((int(ix), int(iy))) for ix, iy in centre[part]])
    _, _, source = dijkstra(
        _steps(plane), directed=False, indices=sources, min_only=True, return_predecessors=True
    )
    node_at = np.full(len(plane.steps_out), NOWHERE, np.int32)
    node_at[sources] = part
    near = np.full(len(plane.steps_out), NOWHERE, np.int32)
    reached = source >= 0
    near[reached] = node_at[source[reached]]
    height, width = costmap.free.shape
    return np.ascontiguousarray(near.reshape(height + 2, width + 2)[1:-1, 1:-1])


def _steps(plane: CellPlane) -> csr_array:
    """All steps with their lengths, by node."""
    begins = [np.flatnonzero(plane.steps_out >> bit & 1) for bit in range(len(plane.offsets))]
    ends = [begin + offset for begin, offset in zip(begins, plane.offsets, strict=True)]
    lengths = np.repeat(plane.lengths.astype(np.float64), [len(begin) for begin in begins])
    size = len(plane.steps_out)
    return csr_array((lengths, (np.concatenate(begins), np.concatenate(ends))), shape=(size, size))
