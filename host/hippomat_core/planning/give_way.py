"""Where to go to let others pass: the nearest cell that their way leaves free.

Knows the peers' intents and destinations and the map; whose turn it is to give way is decided elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from hippomat_core.planning.astar import Path, shortest_path
from hippomat_core.planning.costmap import Costmap, nearest_free
from hippomat_core.planning.graph import DIAGONAL, STEPS, STRAIGHT
from hippomat_core.planning.reservations import PeerMotion, taken_cells

AHEAD_M = 1.5  # of a peer's way beyond its intent is guessed
AWAY_M = 2.0  # nobody goes farther than this to give way
CLEAR_M = 0.02


def expected_way(costmap: Costmap, peer: PeerMotion, guess: bool) -> NDArray[np.int32]:
    """The cells (K, 2) a peer will drive over: its intent and, with guess, a shortest path on from there."""
    if not guess or peer.destination is None:
        return peer.intent
    goal = nearest_free(costmap, *peer.destination)
    last = (int(peer.intent[-1, 0]), int(peer.intent[-1, 1]))
    onward = shortest_path(costmap, last, goal) if goal is not None else None
    if onward is None:
        return peer.intent
    return np.concatenate([peer.intent, onward[1 : 1 + round(AHEAD_M / costmap.grid.resolution_m)]])


def way_aside(
    costmap: Costmap,
    start: tuple[int, int],
    blocked: NDArray[np.bool_],
    passing: Sequence[PeerMotion],
    keep_out_m: float,
) -> Path | None:
    """A shortest path to a cell from which nobody passing has to be let through; None within AWAY_M.

    blocked: (H, W) cells that must not be entered
    The peers' whole expected way is kept free where possible, otherwise their intents.
    """
    for guess in (True, False):
        cells = np.concatenate([expected_way(costmap, peer, guess) for peer in passing])
        centres = costmap.centres(cells)
        wanted = taken_cells(centres, np.full(len(centres), keep_out_m + CLEAR_M), costmap.grid)
        path = nearest_clear(costmap, start, blocked, wanted | blocked)
        if path is not None:
            return path
    return None


def nearest_clear(
    costmap: Costmap, start: tuple[int, int], blocked: NDArray[np.bool_], unwanted: NDArray[np.bool_]
) -> Path | None:
    """A shortest path over free, not blocked cells to one that is not unwanted (Dijkstra, AWAY_M at most)."""
    open_ = costmap.free & ~blocked
    limit = STRAIGHT * AWAY_M / costmap.grid.resolution_m
    best, parents, closed = {start: 0}, {start: start}, set()
    queue = [(0, start)]
    while queue:
        so_far, (ix, iy) = heappop(queue)
        if (ix, iy) in closed:
            continue
        closed.add((ix, iy))
        if not unwanted[iy, ix]:
            return _traced(parents, (ix, iy))
        for dx, dy in STEPS:
            x, y = ix + dx, iy + dy
            if not (costmap.grid.holds(x, y) and open_[y, x]):
                continue
            if dx and dy and not (open_[iy, x] and open_[y, ix]):
                continue
            total = so_far + (DIAGONAL if dx and dy else STRAIGHT)
            if total <= limit and total < best.get((x, y), total + 1):
                best[(x, y)], parents[(x, y)] = total, (ix, iy)
                heappush(queue, (total, (x, y)))
    return None


def _traced(parents: dict[tuple[int, int], tuple[int, int]], cell: tuple[int, int]) -> Path:
    cells = [cell]
    while parents[cells[-1]] != cells[-1]:
        cells.append(parents[cells[-1]])
    return np.array(cells[::-1], np.int32)
