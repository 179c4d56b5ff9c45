"""The drivable cells of a map as a graph: 8-connected, no corner cutting, integer edge costs.

A diagonal step needs both cells beside it free: a robot has width. Costs are 5741 straight and 8119 diagonal
(8119 / 5741 = sqrt(2) to 1e-8), so that sums are exact in every order. Knows cells, not metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

STRAIGHT, DIAGONAL = 5741, 8119
# East, north, and the two northern diagonals; the graph is undirected.
HALF_STEPS = ((1, 0), (0, 1), (1, 1), (-1, 1))
STEPS = HALF_STEPS + tuple((-dx, -dy) for dx, dy in HALF_STEPS)


@dataclass(frozen=True, slots=True, eq=False)
class CellGraph:
    """Nodes are the free cells in row-major order; weights count 1/5741 of a cell's side."""

    node_of: NDArray[np.int32]  # (H, W), -1 where not free
    cells: NDArray[np.int32]  # (K, 2) [ix, iy] of each node
    weights: csr_matrix[np.float64]  # (K, K) float64 holding integers, symmetric


def cell_graph(free: NDArray[np.bool_]) -> CellGraph:
    """The graph over the True cells of free (H, W) [iy, ix]."""
    node_of = np.full(free.shape, -1, np.int32)
    iy, ix = np.nonzero(free)
    node_of[iy, ix] = np.arange(len(ix), dtype=np.int32)
    tails, heads, costs = [], [], []
    for dx, dy in HALF_STEPS:
        to_x, to_y = ix + dx, iy + dy
        inside = (to_x >= 0) & (to_x < free.shape[1]) & (to_y < free.shape[0])
        fx, fy, to_x, to_y = ix[inside], iy[inside], to_x[inside], to_y[inside]
        open_ = free[to_y, to_x] & free[fy, to_x] & free[to_y, fx]
        tails.append(node_of[fy, fx][open_])
        heads.append(node_of[to_y, to_x][open_])
        costs.append(np.full(int(open_.sum()), DIAGONAL if dx and dy else STRAIGHT, np.float64))
    tail, head, cost = np.concatenate(tails), np.concatenate(heads), np.concatenate(costs)
    both = (np.concatenate([cost, cost]), (np.concatenate([tail, head]), np.concatenate([head, tail])))
    cells = np.stack([ix, iy], axis=1).astype(np.int32)
    return CellGraph(node_of, cells, csr_matrix(both, shape=(len(cells), len(cells))))
