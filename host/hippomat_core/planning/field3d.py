"""Shortest way from every cell of a 3D grid to one goal: 26-connected, no corner cutting, exact in integers.

A diagonal step needs every cell of the box it spans free: a robot has width. One layer (Z = 1) is the ground,
which CellPlane (graph.py) holds in a tenth of the memory. Step lengths are graph.py's. Knows cells, not
metres. Buckets no wider than the shortest step settle every cell in one pass (Dial 1969, Algorithm 360;
Denardo and Fox 1979).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.planning.graph import DIAGONAL, LONGEST, SPACE_DIAGONAL, STRAIGHT, UNREACHED

# (dx, dy, dz), straight ones first: the order in which ties between equally short ways are broken.
STEPS_3D = tuple(
    sorted((step for step in product((-1, 0, 1), repeat=3) if any(step)), key=lambda step: -step.count(0))
)
LENGTHS_3D = np.array(
    [(0, STRAIGHT, DIAGONAL, SPACE_DIAGONAL)[3 - step.count(0)] for step in STEPS_3D], np.int32
)
_STEPS = np.array(STEPS_3D, np.int32)
NO_STEP_3D = 26  # how the search came to its origin


def _forward() -> NDArray[np.uint32]:
    """(27,): the steps worth taking after coming to a cell by each step: those that turn back along no axis.

    Coming by d and leaving by n, which turns back along some axes, is longer than both steps without those
    axes: p -> p + d' lies in the box of d, and the step n' from there in the box of n, so both are free.
    """
    forward = [
        sum(1 << bit for bit, step in enumerate(STEPS_3D) if min(np.multiply(step, came)) >= 0)
        for came in STEPS_3D
    ]
    return np.array([*forward, (1 << 26) - 1], np.uint32)


FORWARD = _forward()
_DE_BRUIJN = 0x077CB531
_PLACES = np.zeros(32, np.uint8)
_PLACES[[(_DE_BRUIJN << bit & 0xFFFFFFFF) >> 27 for bit in range(32)]] = np.arange(32)
_RING = 3  # buckets in use at once: a step from one ends at most two further on


@dataclass(frozen=True, slots=True, eq=False)
class CellSpace:
    """The free cells of a grid and the steps that lead out of each."""

    free: NDArray[np.bool_]  # (Z, Y, X) [iz, iy, ix]
    # ((Z + 2) (Y + 2) (X + 2),) with a border of one cell: bit k = STEPS_3D[k] is allowed here
    steps_out: NDArray[np.uint32]
    offsets: NDArray[np.int32]  # (26,) from an index into steps_out to that of the step's end

    @property
    def lengths(self) -> NDArray[np.int32]:
        """(26,) of the steps."""
        return LENGTHS_3D

    def is_free(self, cell: tuple[int, ...]) -> bool:
        """Whether (ix, iy, iz) is inside the grid and free."""
        layers, height, width = self.free.shape
        ix, iy, iz = cell
        inside = 0 <= ix < width and 0 <= iy < height and 0 <= iz < layers
        return inside and bool(self.free[iz, iy, ix])

    def node_of(self, cell: tuple[int, ...]) -> int:
        """Index of (ix, iy, iz) into steps_out."""
        _, height, width = self.free.shape
        ix, iy, iz = cell
        return ((iz + 1) * (height + 2) + iy + 1) * (width + 2) + ix + 1


def cell_space(free: NDArray[np.bool_]) -> CellSpace:
    """Of free (Z, Y, X) [iz, iy, ix]."""
    padded = np.pad(free.astype(np.bool_), 1)
    layers, height, width = free.shape
    steps_out = np.zeros(padded.shape, np.uint32)
    inner = steps_out[1:-1, 1:-1, 1:-1]
    for bit, (dx, dy, dz) in enumerate(STEPS_3D):
        open_ = np.ones(free.shape, np.bool_)
        for x, y, z in product({0, dx}, {0, dy}, {0, dz}):
            open_ &= padded[1 + z : 1 + z + layers, 1 + y : 1 + y + height, 1 + x : 1 + x + width]
        inner |= open_.astype(np.uint32) << np.uint32(bit)
    strides = (1, width + 2, (width + 2) * (height + 2))
    offsets = np.array([np.dot(step, strides) for step in STEPS_3D], np.int32)
    return CellSpace(free, steps_out.ravel(), offsets)


def distance_field_3d(space: CellSpace, cell: tuple[int, int, int]) -> NDArray[np.int32]:
    """(Z, Y, X) [1 / STRAIGHT of a cell's side] to (ix, iy, iz).

    UNREACHED where there is no way; everywhere if the goal itself is outside or not free.
    """
    layers, height, width = space.free.shape
    nodes = space_field(space, cell)
    return nodes.reshape(layers + 2, height + 2, width + 2)[1:-1, 1:-1, 1:-1]


def space_field(space: CellSpace, cell: tuple[int, ...]) -> NDArray[np.int32]:
    """The same by node, ((Z + 2) (Y + 2) (X + 2),), with a border of UNREACHED."""
    field = np.full(space.steps_out.shape, UNREACHED, np.int32)
    if space.is_free(cell):
        _spread(space.steps_out, space.offsets, space.node_of(cell), field)
    return field


def way_down(space: CellSpace, field: NDArray[np.int32], cell: tuple[int, int, int]) -> NDArray[np.int32]:
    """(K, 3) [ix, iy, iz] of one shortest way from `cell` to the goal of `field`, both included.

    Of equally short ways always the same. K = 0 where there is none. ValueError for a field of another space.
    """
    ix, iy, iz = cell
    if not space.is_free(cell) or field[iz, iy, ix] == UNREACHED:
        return np.empty((0, 3), np.int32)
    way = np.empty((int(field[iz, iy, ix]) // STRAIGHT + 1, 3), np.int32)
    layers, height, width = space.free.shape
    steps_out = space.steps_out.reshape(layers + 2, height + 2, width + 2)[1:-1, 1:-1, 1:-1]
    way[0] = cell
    count = _descend(steps_out, field, way)
    if count == 0:
        raise ValueError(f"the field does not belong to this space: stuck on the way from {cell}")
    return way[:count]


@njit(cache=True, nogil=True)
def _spread(
    steps_out: NDArray[np.uint32], offsets: NDArray[np.int32], goal: int, field: NDArray[np.int32]
) -> None:
    """Fill `field` (all UNREACHED) from `goal`. A cell enters a bucket at most once, so the ring suffices."""
    ring = np.empty((_RING, len(steps_out)), np.int32)
    counts = np.zeros(_RING, np.int64)
    came = np.empty(len(steps_out), np.uint8)
    field[goal], came[goal] = 0, NO_STEP_3D
    ring[0, 0] = goal
    counts[0] = 1
    begin, here = 0, 0  # of the bucket
    while counts.sum() > 0:
        for place in range(counts[here]):
            node = ring[here, place]
            reached = field[node]
            if reached < begin:
                continue  # it got a shorter way, and was settled, in an earlier bucket
            steps = np.int64(steps_out[node] & FORWARD[came[node]])
            while steps:
                bit = lowest_bit(steps)
                steps &= steps - 1
                end = node + offsets[bit]
                there, before = reached + LENGTHS_3D[bit], field[end]
                if there < before and there <= LONGEST:
                    field[end], came[end] = there, bit
                    further = 1 if there < begin + 2 * STRAIGHT else 2
                    if before == UNREACHED or further != (1 if before < begin + 2 * STRAIGHT else 2):
                        slot = (here + further) % _RING
                        ring[slot, counts[slot]] = end
                        counts[slot] += 1
        counts[here] = 0
        here = (here + 1) % _RING
        begin += STRAIGHT


@njit(cache=True, nogil=True)
def lowest_bit(bits: int | np.int64) -> int:
    """The place of the lowest bit set of 32 (Leiserson, Prokop, Randall 1998)."""
    return int(_PLACES[((bits & -bits) * _DE_BRUIJN & 0xFFFFFFFF) >> 27])


@njit(cache=True, nogil=True)
def _descend(steps_out: NDArray[np.uint32], field: NDArray[np.int32], way: NDArray[np.int32]) -> int:
    """Continue way[0] to the goal; the number of cells, 0 if no step leads down by just its length."""
    ix, iy, iz = way[0]
    count = 1
    while field[iz, iy, ix] > 0:
        chosen = -1
        for bit in range(26):
            if steps_out[iz, iy, ix] >> np.uint32(bit) & np.uint32(1):
                dx, dy, dz = _STEPS[bit]
                if field[iz + dz, iy + dy, ix + dx] + LENGTHS_3D[bit] == field[iz, iy, ix]:
                    chosen = bit
                    break
        if chosen < 0 or count == len(way):
            return 0
        ix, iy, iz = ix + _STEPS[chosen, 0], iy + _STEPS[chosen, 1], iz + _STEPS[chosen, 2]
        way[count, 0], way[count, 1], way[count, 2] = ix, iy, iz
        count += 1
    return count
