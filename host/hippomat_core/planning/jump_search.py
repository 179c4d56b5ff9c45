"""Jump point search (Harabor and Grastien 2011, 2014): A* that runs past cells with nothing to decide.

Exact, 8-connected, no corner cutting, guided by the octile distance. From a cell only the steps of
graph.ONWARD are looked at. Where a straight run leads to is written in the plane (JPS+); a diagonal run
tries both its straight sides at every cell, and waits in the queue where it has led too far from the goal.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.planning.buckets import (
    BUCKET,
    GOAL_X,
    GOAL_Y,
    LENGTH,
    NODE,
    ROW,
    SHORTEST,
    TARGET,
    WAITING,
    WIDTH,
    Entries,
    Slate,
    empty_heads,
    new_slate,
    put,
    take,
    way_back,
)
from hippomat_core.planning.graph import DIAGONAL, LOWEST, NO_STEP, ONWARD, STEPS, STRAIGHT

# A diagonal run waits where its total lies so many buckets ahead. Measured: 1 makes mazes half as slow again,
# no limit makes large open maps twice as slow.
PATIENCE = 6
_STEPS = np.array(STEPS, np.int32)
_TOWARDS = np.zeros((3, 3), np.int64)  # [dy + 1, dx + 1]: the bit of that step
_TOWARDS[_STEPS[:, 1] + 1, _STEPS[:, 0] + 1] = 1 << np.arange(8)


@njit(cache=True)  # with the interpreter's lock: the scratch belongs to one search at a time
def jump_search(
    steps_out: NDArray[np.uint8],
    offsets: NDArray[np.int32],
    runs: NDArray[np.int16],
    origin: int,
    target: int,
    so_far: NDArray[np.int32],
    came: NDArray[np.uint8],
    entries: Entries,
) -> NDArray[np.int32]:
    """(K, 2) [ix, iy] of a shortest way from origin to target; K = 0 where there is none.

    steps_out, offsets, runs, origin, target, so_far, came, entries: of a CellPlane
    so_far: 1 + length of the way to a cell, 0 where there is none yet   came: that way's last step
    """
    width = int(offsets[1])
    if steps_out[target] == 0:
        return np.empty((0, 2), np.int32)  # without searching all the map for it
    # A step adds at most twice its length; a diagonal run ends soon, a straight one at a border.
    farthest = max(width, len(steps_out) // width)
    heads = empty_heads(PATIENCE * BUCKET + 2 * DIAGONAL + 2 * STRAIGHT * farthest)
    slate = new_slate(width, origin, target)
    row = origin // width
    so_far[origin], came[origin] = 1, NO_STEP
    total = 1 + _to_go(slate, origin, row)
    put(heads, entries, slate, total, origin, row, 1)
    bucket = total // BUCKET
    while slate[WAITING] > 0 and bucket * BUCKET < slate[SHORTEST]:
        entry = take(heads, entries, slate, bucket)
        if entry < 0:
            bucket += 1
            continue
        node, row = int(entries[entry, NODE]), int(entries[entry, ROW])
        length = int(entries[entry, LENGTH])
        if so_far[node] != length:
            continue  # reached by a shorter way since
        limit = (bucket + PATIENCE) * BUCKET
        steps = int(ONWARD[came[node], steps_out[node]])
        # First towards the target: in open space that finds it, and the other steps are over at once.
        toward = steps & _towards(slate, node, row)
        while steps:
            step = LOWEST[toward or steps]
            steps &= ~(1 << step)
            toward = 0
            if step < 4:
                _straight(offsets, runs, so_far, came, heads, entries, slate, node, row, length, step)
            else:
                _diagonal(
                    steps_out,
                    offsets,
                    runs,
                    so_far,
                    came,
                    heads,
                    entries,
                    slate,
                    node,
                    row,
                    length,
                    step,
                    limit,
                )
    return way_back(so_far, came, offsets, slate)


@njit(cache=True, nogil=True, inline="always")
def _straight(
    offsets: NDArray[np.int32],
    runs: NDArray[np.int16],
    so_far: NDArray[np.int32],
    came: NDArray[np.uint8],
    heads: NDArray[np.int32],
    entries: Entries,
    slate: Slate,
    node: int,
    row: int,
    length: int,
    step: int,
) -> bool:
    """Run straight on; where that leads to something new, let it wait there. True if it did."""
    run = int(runs[node, step])
    to_target = _ahead(slate, node, row, step)
    if 0 < to_target <= abs(run):
        run = to_target
    elif run <= 0:
        return False
    end, there, end_row = node + run * offsets[step], length + run * STRAIGHT, row + run * _STEPS[step, 1]
    before, total = so_far[end], there + _to_go(slate, end, end_row)
    if (before != 0 and there >= before) or total >= slate[SHORTEST]:
        return False
    so_far[end], came[end] = there, step
    if end == slate[TARGET]:
        slate[SHORTEST] = there
    else:
        put(heads, entries, slate, total, end, end_row, there)
    return True


@njit(cache=True, nogil=True, inline="always")
def _diagonal(
    steps_out: NDArray[np.uint8],
    offsets: NDArray[np.int32],
    runs: NDArray[np.int16],
    so_far: NDArray[np.int32],
    came: NDArray[np.uint8],
    heads: NDArray[np.int32],
    entries: Entries,
    slate: Slate,
    node: int,
    row: int,
    length: int,
    step: int,
    limit: int,
) -> None:
    """Run diagonally, with straight runs to both sides at every cell, up to a total of `limit`."""
    onward = 1 << step
    while onward >> step & 1:
        node += offsets[step]
        row += _STEPS[step, 1]
        length += DIAGONAL
        before, total = so_far[node], length + _to_go(slate, node, row)
        if (before != 0 and length >= before) or total >= slate[SHORTEST]:
            return
        if node == slate[TARGET]:
            so_far[node], came[node] = length, step
            slate[SHORTEST] = length
            return
        onward = int(ONWARD[step, steps_out[node]])
        if total >= limit:
            so_far[node], came[node] = length, step
            put(heads, entries, slate, total, node, row, length)
            return
        sides = onward & 15
        while sides:
            side = LOWEST[sides]
            sides &= sides - 1
            if _straight(offsets, runs, so_far, came, heads, entries, slate, node, row, length, side):
                so_far[node], came[node] = length, step  # the way back leads through here


@njit(cache=True, nogil=True, inline="always")
def _ahead(slate: Slate, node: int, row: int, step: int) -> int:
    """Straight steps to the target; 0 or less where it does not lie in this direction."""
    dy = slate[GOAL_Y] - row
    dx = slate[GOAL_X] - (node - row * slate[WIDTH])
    if step & 1:
        return int(dy * _STEPS[step, 1]) if dx == 0 else 0
    return int(dx * _STEPS[step, 0]) if dy == 0 else 0


@njit(cache=True, nogil=True, inline="always")
def _towards(slate: Slate, node: int, row: int) -> int:
    """The bit of the step that leads straightest to the target."""
    dy = np.sign(slate[GOAL_Y] - row)
    dx = np.sign(slate[GOAL_X] - (node - row * slate[WIDTH]))
    return int(_TOWARDS[dy + 1, dx + 1])


@njit(cache=True, nogil=True, inline="always")
def _to_go(slate: Slate, node: int, row: int) -> int:
    """The octile distance to the target."""
    dx, dy = abs(node - row * slate[WIDTH] - slate[GOAL_X]), abs(row - slate[GOAL_Y])
    return int(STRAIGHT * max(dx, dy) + (DIAGONAL - STRAIGHT) * min(dx, dy))
