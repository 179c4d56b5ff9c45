"""The cells that robots occupy one at a time, and the moves between them. Knows no robots and no metres.

A move goes to a neighbouring cell; with diagonals it cuts no corner. Every cell and every point halfway
between two cells is a *place* of a grid twice as fine. Two moves that swap cells, or cross between cells,
meet at the place halfway: vertex, swap and crossing conflicts are all "two robots at one place". A diagonal
move passes close by the two cells beside it, which have to be free of robots too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from hippomat_core.planning.field3d import STEPS_3D, cell_space

UNREACHED = 1 << 24  # moves; more than any way has
_STRAIGHT = 6  # of STEPS_3D, which has the straight steps first


@dataclass(frozen=True, slots=True, eq=False)
class MotionGraph:
    """K free cells. A node is the index of a cell, in their order in memory."""

    cells: NDArray[np.int32]  # (K, 3) [ix, iy, iz]
    node_of: NDArray[np.int32]  # (Z, Y, X) [iz, iy, ix], -1 where not free
    neighbours: NDArray[np.int32]  # (K, D), -1 where there is no move
    middles: NDArray[np.int64]  # (K, D) the place halfway to each neighbour
    beside: NDArray[np.int32]  # (K, D, 2) the nodes that a diagonal in one plane passes, -1 where none
    places: NDArray[np.int64]  # (K,) of the cells themselves
    place_count: int
    diagonals: bool

    def node(self, ix: int, iy: int, iz: int = 0) -> int:
        """The node of a cell; -1 where that is outside the grid or not free."""
        layers, height, width = self.node_of.shape
        inside = 0 <= ix < width and 0 <= iy < height and 0 <= iz < layers
        return int(self.node_of[iz, iy, ix]) if inside else -1


class Ways(NamedTuple):
    """A MotionGraph's arrays for the compiled part."""

    neighbours: NDArray[np.int32]
    middles: NDArray[np.int64]
    beside: NDArray[np.int32]
    places: NDArray[np.int64]
    span: int  # place_count


def motion_graph(free: NDArray[np.bool_], diagonals: bool = False) -> MotionGraph:
    """Over free (Z, Y, X) or (Y, X) cells: 4- or 8-connected in one layer, 6- or 26-connected in several."""
    free = free[None] if free.ndim == 2 else free
    layers, height, width = free.shape
    space = cell_space(free)
    steps = STEPS_3D if diagonals else STEPS_3D[:_STRAIGHT]
    open_ = space.steps_out.reshape(layers + 2, height + 2, width + 2)[1:-1, 1:-1, 1:-1][free]
    cells = np.argwhere(free)[:, ::-1].astype(np.int32)
    node_of = np.full(free.shape, -1, np.int32)
    node_of[free] = np.arange(len(cells), dtype=np.int32)
    neighbours = np.full((len(cells), len(steps)), -1, np.int32)
    middles = np.zeros((len(cells), len(steps)), np.int64)
    beside = np.full((len(cells), len(steps), 2), -1, np.int32)
    strides = np.array([1, 2 * width, 4 * width * height], np.int64)
    for bit, step in enumerate(steps):
        leads = np.flatnonzero(open_ >> np.uint32(bit) & np.uint32(1))
        x, y, z = (cells[leads] + np.array(step, np.int32)).T
        neighbours[leads, bit] = node_of[z, y, x]
        middles[leads, bit] = (2 * cells[leads].astype(np.int64) + np.array(step)) @ strides
        for side, part in enumerate(_sides(step)):
            x, y, z = (cells[leads] + np.array(part, np.int32)).T
            beside[leads, bit, side] = node_of[z, y, x]
    places = 2 * cells.astype(np.int64) @ strides
    used = np.flatnonzero((neighbours >= 0).any(axis=0))  # one layer has no moves up or down
    kept = used if len(used) else np.arange(1)
    columns = neighbours[:, kept].copy(), middles[:, kept].copy(), beside[:, kept].copy()
    return MotionGraph(cells, node_of, *columns, places, 8 * free.size, diagonals)


def _sides(step: Sequence[int]) -> list[tuple[int, int, int]]:
    """The two single steps that a diagonal in one plane is made of; none for any other step."""
    axes = [axis for axis in range(3) if step[axis]]
    if len(axes) != 2:
        return []
    return [tuple(step[axis] if axis == one else 0 for axis in range(3)) for one in axes]  # type: ignore[misc]


def largest_part(graph: MotionGraph) -> NDArray[np.int32]:
    """The nodes of the largest set that reach one another, in order."""
    tails, columns = np.nonzero(graph.neighbours >= 0)
    heads = graph.neighbours[tails, columns]
    count = len(graph.cells)
    edges = csr_matrix((np.ones(len(tails), np.int8), (tails, heads)), shape=(count, count))
    _, label = connected_components(edges, directed=False)
    return np.flatnonzero(label == np.argmax(np.bincount(label))).astype(np.int32)


def moves_to(graph: MotionGraph, node: int) -> NDArray[np.int32]:
    """(K,) fewest moves from every node to this one; UNREACHED where there is no way."""
    return _spread(graph.neighbours, node)


@njit(cache=True, nogil=True)
def halfway(ways: Ways, tail: int, head: int) -> int:
    """The place halfway of the move from tail to head, -1 where there is no such move."""
    for direction in range(ways.neighbours.shape[1]):
        if ways.neighbours[tail, direction] == head:
            return int(ways.middles[tail, direction])
    return -1


@njit(cache=True, nogil=True)
def _spread(neighbours: NDArray[np.int32], goal: int) -> NDArray[np.int32]:
    """Breadth first: all moves take equally long."""
    count, directions = neighbours.shape
    moves = np.full(count, UNREACHED, np.int32)
    queue = np.empty(count, np.int32)
    moves[goal] = 0
    queue[0] = goal
    begin, end = 0, 1
    while begin < end:
        node = queue[begin]
        begin += 1
        for direction in range(directions):
            other = neighbours[node, direction]
            if other >= 0 and moves[other] == UNREACHED:
                moves[other] = moves[node] + 1
                queue[end] = other
                end += 1
    return moves
