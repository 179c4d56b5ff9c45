"""One shortest path between two cells (Hart, Nilsson, Raphael 1968). Exact, 8-connected, no corner cutting.

With a distance field to the goal as heuristic the search walks straight down the field, and still is exact
where some cells are blocked: blocking only lengthens ways, so the field stays a consistent lower bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from hippomat_core.planning.costmap import Costmap
from hippomat_core.planning.graph import DIAGONAL, STEPS, STRAIGHT

Path = NDArray[np.int32]  # (K, 2) [ix, iy], start to goal, both included


def shortest_path(
    costmap: Costmap,
    start: tuple[int, int],
    goal: tuple[int, int],
    blocked: NDArray[np.bool_] | None = None,
    field: NDArray[np.float64] | None = None,
) -> Path | None:
    """A shortest path over free cells that are not blocked, or None. Equal input, equal path.

    blocked: (H, W) cells to keep out of; the start may be blocked, the goal may not
    field: (H, W) [m] distance_field(costmap, goal); without it the octile distance guides the search
    """
    if not (costmap.is_free(start) and costmap.is_free(goal)):
        return None
    if blocked is not None and blocked[goal[1], goal[0]] and goal != start:
        return None  # without searching all the map for it
    free = costmap.free if blocked is None else costmap.free & ~blocked
    width = costmap.grid.width + 2  # one cell of border, so that no step needs a range check
    padded = np.pad(free, 1)
    padded[start[1] + 1, start[0] + 1] = True
    origin, target = ((iy + 1) * width + ix + 1 for ix, iy in (start, goal))
    heuristic = _octile(goal, width) if field is None else _field(field, width, costmap.grid.resolution_m)
    parents = _search(padded.tobytes(), width, origin, target, heuristic)
    if parents is None:
        return None
    cells = [target]
    while cells[-1] != origin:
        cells.append(parents[cells[-1]])
    flat = np.array(cells[::-1], np.int32)
    return np.stack([flat % width - 1, flat // width - 1], axis=1).astype(np.int32)


def path_length_m(path: Path, resolution_m: float) -> float:
    """Length of a path along its cell centres [m], in the planner's own integer costs."""
    if len(path) < 2:
        return 0.0
    diagonal = int(np.count_nonzero(np.abs(np.diff(path, axis=0)).sum(axis=1) == 2))
    steps = STRAIGHT * (len(path) - 1 - diagonal) + DIAGONAL * diagonal
    return steps * resolution_m / STRAIGHT


Heuristic = Callable[[int], float]  # flat padded cell -> cost still to go; inf where there is no way


def _octile(goal: tuple[int, int], width: int) -> Heuristic:
    goal_x, goal_y = goal[0] + 1, goal[1] + 1

    def heuristic(cell: int) -> float:
        dy, dx = abs(cell // width - goal_y), abs(cell % width - goal_x)
        return STRAIGHT * abs(dx - dy) + DIAGONAL * min(dx, dy)

    return heuristic


def _field(field: NDArray[np.float64], width: int, resolution_m: float) -> Heuristic:
    flat, columns, scale = field.ravel(), width - 2, STRAIGHT / resolution_m

    def heuristic(cell: int) -> float:
        metres = flat[(cell // width - 1) * columns + cell % width - 1]
        return round(float(metres) * scale) if metres < math.inf else math.inf

    return heuristic


def _search(free: bytes, width: int, origin: int, target: int, heuristic: Heuristic) -> dict[int, int] | None:
    """Parents of the cells reached, or None. Ties: nearer to the goal first, then the smaller cell number."""
    moves = [(dx + dy * width, dx, dy * width, DIAGONAL if dx and dy else STRAIGHT) for dx, dy in STEPS]
    best: dict[int, float] = {origin: 0}
    parents: dict[int, int] = {}
    to_go: dict[int, float] = {origin: heuristic(origin)}
    closed: set[int] = set()
    queue = [(to_go[origin], to_go[origin], origin)] if to_go[origin] < math.inf else []
    while queue:
        _, _, cell = heappop(queue)
        if cell == target:
            return parents
        if cell in closed:
            continue
        closed.add(cell)
        so_far = best[cell]
        for step, across, along, cost in moves:
            other = cell + step
            if not (free[other] and free[cell + across] and free[cell + along]) or other in closed:
                continue
            total = so_far + cost
            if total < best.get(other, math.inf):
                best[other], parents[other] = total, cell
                if other not in to_go:
                    to_go[other] = heuristic(other)
                if to_go[other] < math.inf:
                    heappush(queue, (total + to_go[other], to_go[other], other))
    return None
