"""What the searches of one shortest path share: a queue of cells in buckets of length, and the way back.

What is found last in a bucket leaves first: which of equally short ways is found, always the same one, never
how long it is. Everything lives in arrays of the caller, and small functions are inlined: numba counts
references for each array that goes into a call or comes out of it, which made the searches take half as long
again.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.planning.graph import DIAGONAL, LENGTHS, LONGEST, STRAIGHT

# Towards the octile distance, so far + still to go grows by 0 or at least by this with each step: a bucket no
# wider holds few different totals.
BUCKET = 2 * STRAIGHT - DIAGONAL
NODE, ROW, LENGTH, NEXT = range(4)  # columns of `entries` (n, 4)
# What `slate` holds: the queue's book-keeping and the search's constants.
UNUSED, USED, WAITING, LOWEST_ROW, HIGHEST_ROW, SHORTEST, WIDTH, TARGET, GOAL_X, GOAL_Y = range(10)
OVERFULL = -1

Entries = NDArray[np.int32]
Slate = NDArray[np.int64]


@njit(cache=True, nogil=True)
def new_slate(width: int, origin: int, target: int) -> Slate:
    """Of a search on rows of `width` nodes. SHORTEST: 1 + length of the best way yet, or LONGEST."""
    row, goal_y = origin // width, target // width
    slate = np.empty(10, np.int64)
    slate[UNUSED], slate[USED], slate[WAITING] = -1, 0, 0
    slate[LOWEST_ROW], slate[HIGHEST_ROW] = min(row, goal_y), max(row, goal_y)
    slate[SHORTEST] = 1 if origin == target else LONGEST
    slate[WIDTH], slate[TARGET], slate[GOAL_X], slate[GOAL_Y] = width, target, target % width, goal_y
    return slate


@njit(cache=True, nogil=True)
def empty_heads(largest_growth: int) -> NDArray[np.int32]:
    """Buckets for a queue whose totals differ by at most largest_growth."""
    ring = 8
    while ring < largest_growth // BUCKET + 2:
        ring *= 2
    return np.full(ring, -1, np.int32)


@njit(cache=True, nogil=True, inline="always")
def put(
    heads: NDArray[np.int32], entries: Entries, slate: Slate, total: int, node: int, row: int, length: int
) -> None:
    """Into the bucket of `total`."""
    entry = slate[UNUSED]
    if entry >= 0:
        slate[UNUSED] = entries[entry, NEXT]
    else:
        entry = slate[USED]
        if entry == len(entries):
            slate[SHORTEST] = OVERFULL  # ends the search
            return
        slate[USED] += 1
    slot = total // BUCKET & (len(heads) - 1)
    entries[entry, NODE] = node
    entries[entry, ROW] = row
    entries[entry, LENGTH] = length
    entries[entry, NEXT] = heads[slot]
    heads[slot] = entry
    slate[WAITING] += 1
    slate[LOWEST_ROW] = min(slate[LOWEST_ROW], row)
    slate[HIGHEST_ROW] = max(slate[HIGHEST_ROW], row)


@njit(cache=True, nogil=True, inline="always")
def take(heads: NDArray[np.int32], entries: Entries, slate: Slate, bucket: int) -> int:
    """The entry found last in the bucket, -1 where it is empty. Valid until the next put()."""
    slot = bucket & (len(heads) - 1)
    entry = int(heads[slot])
    if entry >= 0:
        heads[slot] = entries[entry, NEXT]
        entries[entry, NEXT] = slate[UNUSED]
        slate[UNUSED] = entry
        slate[WAITING] -= 1
    return entry


@njit(cache=True, nogil=True)
def wipe(so_far: NDArray[np.int32], slate: Slate) -> None:
    """All 0 again, in the rows that a search has touched. Raises if the search was cut short."""
    so_far[slate[LOWEST_ROW] * slate[WIDTH] : (slate[HIGHEST_ROW] + 1) * slate[WIDTH]] = 0
    if slate[SHORTEST] == OVERFULL:
        raise MemoryError("more cells wait in the search than there is room for")


@njit(cache=True, nogil=True)
def way_back(
    so_far: NDArray[np.int32], came: NDArray[np.uint8], offsets: NDArray[np.int32], slate: Slate
) -> NDArray[np.int32]:
    """(K, 2) [ix, iy] of the way found, from its origin to the target; K = 0 if none. Wipes so_far.

    A run of equal steps ends, going back, at the first cell reached with just the length that is left.
    """
    width, node = slate[WIDTH], slate[TARGET]
    count, length, cells = 0, so_far[node], np.empty((256, 2), np.int32)
    step = came[node]
    while length > 0:
        if count == len(cells):
            more = np.empty((2 * count, 2), np.int32)
            more[:count] = cells
            cells = more
        cells[count, 0], cells[count, 1] = node % width - 1, node // width - 1
        count += 1
        if length == 1:
            break
        node -= offsets[step]
        length -= LENGTHS[step]
        if so_far[node] == length:
            step = came[node]
    wipe(so_far, slate)
    return cells[:count][::-1].copy()
