"""Other people's path finders behind one call: a path of cells, or only its length where they give no more.

A peer that is not installed is left out and named. pyastar2d and tcod cut corners, and pyastar2d counts a
diagonal step like a straight one: fast, and no answer for a robot with width. scipy is exact on a graph
with an edge per step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

Cell = tuple[int, int]
Found = NDArray[np.int32] | float | None  # (K, 2) [ix, iy]; or a length [cells]; None: no way
Finder = Callable[[Cell, Cell], Found]


@dataclass(frozen=True, slots=True)
class Peer:
    """prepare(free): done once per map. most: queries to ask, where more would take too long."""

    prepare: Callable[[NDArray[np.bool_]], Finder]
    most: int = 10**9


def peers() -> dict[str, Peer]:
    """By name, whether installed or not: prepare() raises ImportError where it is not."""
    return {"pyastar2d": Peer(_pyastar2d), "tcod": Peer(_tcod), "scipy": Peer(_scipy, most=5)}


def _pyastar2d(free: NDArray[np.bool_]) -> Finder:
    import pyastar2d

    weights = np.where(free, 1.0, np.inf).astype(np.float32)

    def find(start: Cell, goal: Cell) -> Found:
        path = pyastar2d.astar_path(weights, start[::-1], goal[::-1], allow_diagonal=True)
        return None if path is None else np.asarray(path, np.int32)[:, ::-1]

    return find


def _tcod(free: NDArray[np.bool_]) -> Finder:
    import tcod.path

    finder: Any = tcod.path.AStar(free.astype(np.int8), diagonal=2.0**0.5)

    def find(start: Cell, goal: Cell) -> Found:
        path = finder.get_path(*start[::-1], *goal[::-1])
        return np.array([start[::-1], *path], np.int32)[:, ::-1] if path or start == goal else None

    return find


def _scipy(free: NDArray[np.bool_]) -> Finder:
    number, graph = step_graph(free)

    def find(start: Cell, goal: Cell) -> Found:
        lengths = dijkstra(graph, directed=False, indices=[int(number[start[1], start[0]])])[0]
        length = float(lengths[number[goal[1], goal[0]]])
        return length if np.isfinite(length) else None

    return find


def step_graph(free: NDArray[np.bool_]) -> tuple[NDArray[np.int64], csr_matrix[np.float64]]:
    """(H, W) numbers of the free cells; the graph with an edge of 1 or sqrt(2) per step, no cut corners."""
    number = np.full(free.shape, -1, np.int64)
    number[free] = np.arange(np.count_nonzero(free))
    tails, heads, lengths = [], [], []
    across = free[:-1, :-1] & free[:-1, 1:] & free[1:, :-1] & free[1:, 1:]  # all four: both diagonals
    for mask, tail, head, length in (
        (free[:, :-1] & free[:, 1:], number[:, :-1], number[:, 1:], 1.0),
        (free[:-1] & free[1:], number[:-1], number[1:], 1.0),
        (across, number[:-1, :-1], number[1:, 1:], 2.0**0.5),
        (across, number[:-1, 1:], number[1:, :-1], 2.0**0.5),
    ):
        tails.append(tail[mask])
        heads.append(head[mask])
        lengths.append(np.full(np.count_nonzero(mask), length))
    count = int(np.count_nonzero(free))
    ends = np.concatenate(tails), np.concatenate(heads)
    return number, csr_matrix((np.concatenate(lengths), ends), shape=(count, count))
