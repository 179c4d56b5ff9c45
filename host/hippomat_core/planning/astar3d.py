"""One shortest path through a 3D grid: A* (Hart et al. 1968). Exact, 26-connected, no corner cutting.

For a single query; where a distance field to the goal is at hand, field3d.way_down needs no search.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.planning.buckets import (
    BUCKET,
    LENGTH,
    NODE,
    SHORTEST,
    WAITING,
    Entries,
    empty_heads,
    new_slate,
    put,
    take,
    wipe,
)
from hippomat_core.planning.field3d import FORWARD, LENGTHS_3D, NO_STEP_3D, CellSpace, lowest_bit
from hippomat_core.planning.graph import DIAGONAL, SPACE_DIAGONAL, STRAIGHT


def shortest_path_3d(
    space: CellSpace, start: tuple[int, int, int], goal: tuple[int, int, int]
) -> NDArray[np.int32]:
    """(K, 3) [ix, iy, iz] from start to goal, both included; K = 0 where there is no way."""
    if not (space.is_free(start) and space.is_free(goal)):
        return np.empty((0, 3), np.int32)
    count = len(space.steps_out)
    _, height, width = space.free.shape
    nodes = _search(
        space.steps_out,
        space.offsets,
        width + 2,
        height + 2,
        space.node_of(start),
        space.node_of(goal),
        np.zeros(count, np.int32),
        np.empty(count, np.uint8),
        np.empty((4 * count, 4), np.int32),
    )
    layer, rest = np.divmod(nodes, (width + 2) * (height + 2))
    row, column = np.divmod(rest, width + 2)
    return (np.stack([column, row, layer], axis=1) - 1).astype(np.int32)


@njit(cache=True, nogil=True)
def _search(
    steps_out: NDArray[np.uint32],
    offsets: NDArray[np.int32],
    width: int,
    height: int,
    origin: int,
    target: int,
    so_far: NDArray[np.int32],
    came: NDArray[np.uint8],
    entries: Entries,
) -> NDArray[np.int32]:
    """(K,) nodes from origin to target. so_far: all 0   came, entries: scratch"""
    heads, slate = empty_heads(2 * SPACE_DIAGONAL), new_slate(width * height, origin, target)
    goal = target % width, target // width % height, target // (width * height)
    total = _to_go(origin, width, height, goal)
    bucket = total // BUCKET
    so_far[origin], came[origin] = 1, NO_STEP_3D
    put(heads, entries, slate, total, origin, 0, 1)
    while slate[WAITING] > 0 and bucket * BUCKET < slate[SHORTEST]:
        entry = take(heads, entries, slate, bucket)
        if entry < 0:
            bucket += 1
            continue
        node, length = np.int64(entries[entry, NODE]), entries[entry, LENGTH]
        if so_far[node] != length:
            continue  # reached by a shorter way since
        steps = np.int64(steps_out[node] & FORWARD[came[node]])
        while steps:
            bit = lowest_bit(steps)
            steps &= steps - 1
            end, there = node + offsets[bit], length + LENGTHS_3D[bit]
            before = so_far[end]
            if before != 0 and there >= before:
                continue
            total = there + _to_go(end, width, height, goal)
            if total >= slate[SHORTEST]:
                continue
            so_far[end], came[end] = there, bit
            if end == target:
                slate[SHORTEST] = there
            else:
                put(heads, entries, slate, total - 1, end, 0, there)
    nodes = _way_back(so_far, came, offsets, origin, target)
    wipe(so_far, slate)
    return nodes


@njit(cache=True, nogil=True)
def _to_go(node: int, width: int, height: int, goal: tuple[int, int, int]) -> int:
    """The octile distance in space: all three axes, then two, then one."""
    dx = abs(node % width - goal[0])
    dy = abs(node // width % height - goal[1])
    dz = abs(node // (width * height) - goal[2])
    longest, shortest = max(dx, dy, dz), min(dx, dy, dz)
    middle = dx + dy + dz - longest - shortest
    return STRAIGHT * longest + (DIAGONAL - STRAIGHT) * middle + (SPACE_DIAGONAL - DIAGONAL) * shortest


@njit(cache=True, nogil=True)
def _way_back(
    so_far: NDArray[np.int32], came: NDArray[np.uint8], offsets: NDArray[np.int32], origin: int, target: int
) -> NDArray[np.int32]:
    if so_far[target] == 0:
        return np.empty(0, np.int32)
    count, node = 1, target
    while node != origin:
        node -= offsets[came[node]]
        count += 1
    nodes = np.empty(count, np.int32)
    node = target
    for place in range(count - 1, 0, -1):
        nodes[place] = node
        node -= offsets[came[node]]
    nodes[0] = origin
    return nodes
