"""One shortest path between two cells (Hart, Nilsson, Raphael 1968). Exact, 8-connected, no corner cutting.

With a distance field to the goal as heuristic the search walks straight down the field, and still is exact
where some cells are blocked: blocking only lengthens ways, so the field stays a consistent lower bound. Most
steps are never looked at (graph.ONWARD).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.planning.buckets import (
    BUCKET,
    LENGTH,
    NODE,
    ROW,
    SHORTEST,
    WAITING,
    Entries,
    empty_heads,
    new_slate,
    put,
    take,
    way_back,
)
from hippomat_core.planning.costmap import Costmap
from hippomat_core.planning.distance_field import DistanceField
from hippomat_core.planning.graph import (
    DIAGONAL,
    LENGTHS,
    LONGEST,
    LOWEST,
    NO_STEP,
    ONWARD,
    STEPS,
    STRAIGHT,
    CellPlane,
    cell_plane,
)
from hippomat_core.planning.jump_search import jump_search

Path = NDArray[np.int32]  # (K, 2) [ix, iy], start to goal, both included

_NO_BLOCKED = np.empty((0, 0), np.bool_)
_STEPS = np.array(STEPS, np.int32)


def shortest_path(
    costmap: Costmap,
    start: tuple[int, int],
    goal: tuple[int, int],
    blocked: NDArray[np.bool_] | None = None,
    field: DistanceField | None = None,
) -> Path | None:
    """A shortest path over free cells that are not blocked, or None. Equal input, equal path.

    blocked: (H, W) cells to keep out of; the start may be blocked, the goal may not
    field: distance_field(costmap, goal); without it the octile distance guides the search
    """
    if field is not None and (field.goal != goal or field.shape != costmap.free.shape):
        raise ValueError(f"the field leads to {field.goal} on a map of {field.shape}, not to {goal}")
    return plane_path(costmap.graph, start, goal, blocked, None if field is None else field.nodes)


def plane_path(
    plane: CellPlane,
    start: tuple[int, int],
    goal: tuple[int, int],
    blocked: NDArray[np.bool_] | None = None,
    to_go: NDArray[np.int32] | None = None,
) -> Path | None:
    """The same on bare cells. to_go: plane_field(plane, goal)."""
    height, width = plane.free.shape
    (start_x, start_y), (goal_x, goal_y) = start, goal
    inside = 0 <= start_x < width and 0 <= start_y < height and 0 <= goal_x < width and 0 <= goal_y < height
    if not inside:
        return None
    if start == goal:
        return np.array([start], np.int32) if plane.free[start_y, start_x] else None
    if blocked is not None and blocked[goal_y, goal_x]:
        return None  # without searching all the map for it
    # No step leads out of a cell that is not free, so the search need not ask.
    origin, target = (start_y + 1) * (width + 2) + start_x + 1, (goal_y + 1) * (width + 2) + goal_x + 1
    if to_go is not None:
        path = _down_the_field(
            plane.steps_out,
            plane.offsets,
            _NO_BLOCKED if blocked is None else np.ascontiguousarray(blocked, np.bool_),
            to_go,
            origin,
            target,
            plane.so_far,
            plane.came,
            plane.entries,
        )
    else:
        if blocked is not None:
            free = plane.free & ~blocked
            free[start_y, start_x] = plane.free[start_y, start_x]
            plane = cell_plane(free)
        path = jump_search(
            plane.steps_out,
            plane.offsets,
            plane.runs,
            origin,
            target,
            plane.so_far,
            plane.came,
            plane.entries,
        )
    return path if len(path) else None


def path_length_m(path: Path, resolution_m: float) -> float:
    """Length of a path along its cell centres [m], in the planner's own integer costs."""
    if len(path) < 2:
        return 0.0
    return _steps(path) * resolution_m / STRAIGHT


@njit(cache=True, nogil=True)
def _steps(path: Path) -> int:
    steps = 0
    for k in range(1, len(path)):
        moved = abs(path[k, 0] - path[k - 1, 0]) + abs(path[k, 1] - path[k - 1, 1])
        steps += DIAGONAL if moved == 2 else STRAIGHT
    return steps


@njit(cache=True)  # with the interpreter's lock: the scratch belongs to one search at a time
def _down_the_field(
    steps_out: NDArray[np.uint8],
    offsets: NDArray[np.int32],
    blocked: NDArray[np.bool_],
    to_go: NDArray[np.int32],
    origin: int,
    target: int,
    so_far: NDArray[np.int32],
    came: NDArray[np.uint8],
    entries: Entries,
) -> NDArray[np.int32]:
    """(K, 2) [ix, iy] from origin to target; K = 0 where there is no way.

    blocked: (H, W), or empty   so_far, came: scratch; so_far is all 0 before and after
    A bucket may hold several totals; a cell that gets shorter within its bucket is expanded once more.
    """
    width = int(offsets[1])
    heads, slate = empty_heads(2 * DIAGONAL), new_slate(width, origin, target)
    bucket = to_go[origin] // BUCKET
    if to_go[origin] < LONGEST:
        so_far[origin], came[origin] = 1, NO_STEP
        put(heads, entries, slate, to_go[origin], origin, origin // width, 1)
    while slate[WAITING] > 0 and bucket * BUCKET < slate[SHORTEST]:
        entry = take(heads, entries, slate, bucket)
        if entry < 0:
            bucket += 1
            continue
        node, row = int(entries[entry, NODE]), int(entries[entry, ROW])
        length = int(entries[entry, LENGTH])
        if so_far[node] != length:
            continue  # reached by a shorter way since
        steps = int(steps_out[node])
        if blocked.size:
            steps = _unblocked(steps, blocked, node - row * width - 1, row - 1, node, origin, offsets)
        steps = int(ONWARD[came[node], steps])
        while steps:
            step = LOWEST[steps]
            steps &= steps - 1
            end, there = node + offsets[step], length + LENGTHS[step]
            before, total = so_far[end], there + to_go[end]
            if (before != 0 and there >= before) or total >= slate[SHORTEST]:
                continue
            so_far[end], came[end] = there, step
            if to_go[end] == 0:
                slate[SHORTEST] = there
            else:
                put(heads, entries, slate, total, end, row + _STEPS[step, 1], there)
    return way_back(so_far, came, offsets, slate)


@njit(cache=True, nogil=True)
def _unblocked(
    steps: int,
    blocked: NDArray[np.bool_],
    ix: int,
    iy: int,
    node: int,
    origin: int,
    offsets: NDArray[np.int32],
) -> int:
    """Of the steps out of (ix, iy) those that touch no blocked cell; the origin counts as free."""
    left = 0
    for k in range(4):
        if steps >> k & 1:
            end_blocked = blocked[iy + _STEPS[k, 1], ix + _STEPS[k, 0]] and node + offsets[k] != origin
            if not end_blocked:
                left |= 1 << k
    for k in range(4, 8):
        both = 1 << (k - 4) | 1 << (k - 3) % 4
        if steps >> k & 1 and left & both == both:
            end_blocked = blocked[iy + _STEPS[k, 1], ix + _STEPS[k, 0]] and node + offsets[k] != origin
            if not end_blocked:
                left |= 1 << k
    return left
