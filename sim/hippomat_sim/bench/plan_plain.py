"""The yardstick: A* as it is written in plain Python, with heapq, dictionaries and sets (Hart et al. 1968).

Exact, without corner cutting, on the ground (8-connected) and in the air (26-connected). Of equal totals the
one nearer to the goal comes first, which helps it. Shares no code with the planners that it is compared with.
"""

from __future__ import annotations

import math
from heapq import heappop, heappush
from itertools import product

Cell = tuple[int, int]
Cell3 = tuple[int, int, int]
DIAGONAL, SPACE_DIAGONAL = math.sqrt(2.0), math.sqrt(3.0)
MOVES = [(dx, dy, math.hypot(dx, dy)) for dx, dy in product((-1, 0, 1), repeat=2) if dx or dy]


def plain_path(free: list[list[bool]], start: Cell, goal: Cell) -> list[Cell] | None:
    """A shortest path, start and goal included, or None. free[iy][ix]; both ends are free."""
    height, width = len(free), len(free[0])
    goal_x, goal_y = goal
    best, parents, closed = {start: 0.0}, {start: start}, set()
    queue = [(_octile(start[0] - goal_x, start[1] - goal_y), 0.0, start)]
    while queue:
        _, _, cell = heappop(queue)
        if cell == goal:
            return traced(parents, cell)
        if cell in closed:
            continue
        closed.add(cell)
        ix, iy = cell
        so_far = best[cell]
        for dx, dy, length in MOVES:
            x, y = ix + dx, iy + dy
            if not (0 <= x < width and 0 <= y < height and free[y][x]):
                continue
            if dx and dy and not (free[iy][x] and free[y][ix]):
                continue
            other, total = (x, y), so_far + length
            if total < best.get(other, math.inf):
                best[other], parents[other] = total, cell
                left = _octile(x - goal_x, y - goal_y)
                heappush(queue, (total + left, left, other))
    return None


def _octile(dx: int, dy: int) -> float:
    dx, dy = abs(dx), abs(dy)
    return max(dx, dy) + (DIAGONAL - 1.0) * min(dx, dy)
