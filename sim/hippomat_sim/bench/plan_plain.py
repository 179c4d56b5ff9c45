"""The yardstick: A* as it is written in plain Python, with heapq, dictionaries and sets (Hart et al. 1968).

Exact, without corner cutting, on the ground (8-connected) and in the air (26-connected). Of equal totals the
one nearer to the goal comes first, which helps it. Shares no code with the planners that it is compared with.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from heapq import heappop, heappush
from itertools import product
from typing import TypeVar

Cell = tuple[int, int]
Cell3 = tuple[int, int, int]
AnyCell = TypeVar("AnyCell", bound=Hashable)

ROOT2, ROOT3 = math.sqrt(2.0), math.sqrt(3.0)
MOVES = [(dx, dy, math.hypot(dx, dy)) for dx, dy in product((-1, 0, 1), repeat=2) if dx or dy]
# The move, its length, and what else of the box it spans must be free: a robot has width.
MOVES_3D = [
    (
        (dx, dy, dz),
        math.hypot(dx, dy, dz),
        set(product({0, dx}, {0, dy}, {0, dz})) - {(0, 0, 0), (dx, dy, dz)},
    )
    for dx, dy, dz in product((-1, 0, 1), repeat=3)
    if dx or dy or dz
]


def plain_path(free: list[list[bool]], start: Cell, goal: Cell) -> list[Cell] | None:
    """A shortest path, start and goal included, or None. free[iy][ix]; both ends are free."""
    height, width = len(free), len(free[0])
    goal_x, goal_y = goal
    best, parents = {start: 0.0}, {start: start}
    closed: set[Cell] = set()
    queue = [(_octile(start[0] - goal_x, start[1] - goal_y), 0.0, start)]
    while queue:
        _, _, cell = heappop(queue)
        if cell == goal:
            return _traced(parents, cell)
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


def plain_length_3d(free: list[list[list[bool]]], start: Cell3, goal: Cell3) -> float:
    """Length of a shortest path [cells], inf where there is none. free[iz][iy][ix]; both ends are free."""
    layers, height, width = len(free), len(free[0]), len(free[0][0])
    best = {start: 0.0}
    closed: set[Cell3] = set()
    queue = [(_octile_3d(start, goal), 0.0, start)]
    while queue:
        _, _, cell = heappop(queue)
        so_far = best[cell]
        if cell == goal:
            return so_far
        if cell in closed:
            continue
        closed.add(cell)
        ix, iy, iz = cell
        for (dx, dy, dz), length, box in MOVES_3D:
            x, y, z = ix + dx, iy + dy, iz + dz
            if not (0 <= x < width and 0 <= y < height and 0 <= z < layers and free[z][y][x]):
                continue
            if not all(free[iz + bz][iy + by][ix + bx] for bx, by, bz in box):
                continue
            other, total = (x, y, z), so_far + length
            if total < best.get(other, math.inf):
                best[other] = total
                left = _octile_3d(other, goal)
                heappush(queue, (total + left, left, other))
    return math.inf


def _octile(dx: int, dy: int) -> float:
    dx, dy = abs(dx), abs(dy)
    return max(dx, dy) + (ROOT2 - 1.0) * min(dx, dy)


def _octile_3d(cell: Cell3, goal: Cell3) -> float:
    low, middle, high = sorted((abs(cell[0] - goal[0]), abs(cell[1] - goal[1]), abs(cell[2] - goal[2])))
    return high + (ROOT2 - 1.0) * middle + (ROOT3 - ROOT2) * low


def _traced(parents: dict[AnyCell, AnyCell], cell: AnyCell) -> list[AnyCell]:
    cells = [cell]
    while parents[cells[-1]] != cells[-1]:
        cells.append(parents[cells[-1]])
    return cells[::-1]
