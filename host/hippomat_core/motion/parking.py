"""Where robots without a task stand so that they are in nobody's way.

A cell is a parking spot where those around it stay connected without it: standing there closes no way. Dead
ends are such cells too. Knows no tasks: which cells are wanted is an argument.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.motion.graph import UNREACHED, MotionGraph, moves_to


def parking_spots(graph: MotionGraph) -> NDArray[np.bool_]:
    """(K,) True where the free cells of the 3 x 3 (x 3) block around a cell hang together without it."""
    return np.array([_closes_nothing(graph, node) for node in range(len(graph.cells))], np.bool_)


def _closes_nothing(graph: MotionGraph, node: int) -> bool:
    ring = [int(other) for other in graph.neighbours[node] if other >= 0]
    if len(ring) < 2:
        return True
    near = np.abs(graph.cells[graph.neighbours[ring]] - graph.cells[node]).max(axis=2) <= 1
    block = {int(other) for other in graph.neighbours[ring][near] if other >= 0} | set(ring)
    block.discard(node)
    reached, queue = {ring[0]}, [ring[0]]
    while queue:
        for other in graph.neighbours[queue.pop()].tolist():
            if other in block and other not in reached:
                reached.add(other)
                queue.append(other)
    return reached.issuperset(ring)


def parking_goals(
    graph: MotionGraph,
    spots: NDArray[np.bool_],
    nodes: NDArray[np.int32],
    goals: NDArray[np.int32],
    wanted: NDArray[np.int32],
) -> NDArray[np.int32]:
    """(I,) where each of I idle robots goes: the nearest spot that nobody wants and no earlier one takes.

    goals: (I,) where they were going; kept while they still serve   wanted: nodes that are others' goals
    """
    open_ = spots.copy()
    open_[wanted] = False
    chosen = goals.copy()
    for k, (node, goal) in enumerate(zip(nodes.tolist(), goals.tolist(), strict=True)):
        if not open_[goal]:
            chosen[k] = _nearest(graph, open_, node)
        open_[chosen[k]] = False
    return chosen


def _nearest(graph: MotionGraph, open_: NDArray[np.bool_], node: int) -> int:
    """The nearest open node, the first of equals; its own where there is none."""
    if not open_.any():
        return node
    moves = np.where(open_, moves_to(graph, node), UNREACHED)
    return int(np.argmin(moves)) if moves.min() < UNREACHED else node
