"""The free cells of a map and the steps between them: 8-connected, no corner cutting, integer step lengths.

A diagonal step needs both cells beside it free: a robot has width. Step lengths of the whole project, ground
and air: 20586, 29113 and 35656 for 1, sqrt(2) and sqrt(3) cells. Ratios are right to 6e-8, so sums are exact
in every order and equal on every machine; the smaller pair 5741 / 8119 has no partner for sqrt(3). A way
longer than 104,000 cells (5 km at 0.05 m) does not fit 32 bits and counts as none. Knows cells, not metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

STRAIGHT, DIAGONAL, SPACE_DIAGONAL = 20586, 29113, 35656
UNREACHED = int(np.iinfo(np.int32).max)
LONGEST = UNREACHED - SPACE_DIAGONAL  # ways beyond it are not followed, so that no sum overflows
# (dx, dy). Straight steps counter-clockwise, then the diagonals: 4 + k lies between k and (k + 1) % 4.
STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1))
LENGTHS = np.array([STRAIGHT] * 4 + [DIAGONAL] * 4, np.int32)
LONGEST_RUN = 32767  # cells; fits 16 bits
NO_STEP = 8  # how the search came to its origin


@dataclass(frozen=True, slots=True, eq=False)
class CellPlane:
    """The free cells of a grid and the steps that lead out of each."""

    free: NDArray[np.bool_]  # (H, W) [iy, ix]
    # ((H + 2) (W + 2),) with a border of one cell: bit k = STEPS[k] is allowed
    steps_out: NDArray[np.uint8]
    offsets: NDArray[np.int32]  # (8,) from an index into steps_out to that of the step's end
    # (as long as steps_out, 4): cells that a straight run by STEPS[k] passes until there is a choice or until
    # the way ends (< 0); 0 where the step is not allowed
    runs: NDArray[np.int16]
    # Scratch of the searches, as long as steps_out. so_far is all 0 between them, so that nothing is carried
    # over; fresh memory for every search costs as much as a short search.
    so_far: NDArray[np.int32]
    came: NDArray[np.uint8]
    entries: NDArray[np.int32]

    @property
    def lengths(self) -> NDArray[np.int32]:
        """(8,) of the steps."""
        return LENGTHS

    @property
    def cells(self) -> NDArray[np.int32]:
        """(K, 2) [ix, iy] of the free cells in row-major order."""
        return np.argwhere(self.free)[:, ::-1].astype(np.int32)

    def is_free(self, cell: tuple[int, ...]) -> bool:
        """Whether (ix, iy) is inside the grid and free."""
        height, width = self.free.shape
        ix, iy = cell
        return 0 <= ix < width and 0 <= iy < height and bool(self.free[iy, ix])

    def node_of(self, cell: tuple[int, ...]) -> int:
        """Index of (ix, iy) into steps_out."""
        return (cell[1] + 1) * (self.free.shape[1] + 2) + cell[0] + 1


def cell_plane(free: NDArray[np.bool_]) -> CellPlane:
    """Of free (H, W) [iy, ix]."""
    free = np.ascontiguousarray(free, np.bool_)
    width = free.shape[1] + 2
    offsets = np.array([dx + dy * width for dx, dy in STEPS], np.int32)
    padded = np.pad(free, 1).ravel()
    scratch = np.zeros(padded.shape, np.int32), np.zeros(padded.shape, np.uint8)
    entries = np.empty(
        (4 * len(padded), 4), np.int32
    )  # far more than ever wait; untouched pages cost nothing
    steps_out = _steps_out(padded, offsets)
    return CellPlane(free, steps_out, offsets, _runs(steps_out, offsets), *scratch, entries)


@njit(cache=True, nogil=True)
def _steps_out(free: NDArray[np.bool_], offsets: NDArray[np.int32]) -> NDArray[np.uint8]:
    """free: padded and flat."""
    steps_out = np.zeros(len(free), np.uint8)
    for node in range(len(free)):
        if not free[node]:
            continue
        steps = 0
        for k in range(4):
            if free[node + offsets[k]]:
                steps |= 1 << k
        for k in range(4):
            both = 1 << k | 1 << (k + 1) % 4
            if steps & both == both and free[node + offsets[4 + k]]:
                steps |= 16 << k
        steps_out[node] = steps
    return steps_out


def _onward() -> NDArray[np.uint8]:
    """(9, 256): of the steps allowed at a cell, those worth taking after coming there by step k (8: none).

    Left out is a step to a cell n that is reached at least as well without passing here (the neighbour
    pruning of Harabor and Grastien 2011, adapted to uncut corners):
    - strictly shorter past the cells around: then the step lies on no shortest way;
    - as short, with the diagonal first: straight + diagonal here, diagonal + straight there. The other way's
      last step is straight, and straight steps are left out only where they lie on no shortest way. So by
      induction over its distance every cell still gets its exact distance, whichever of two equally short
      ways came first.
    Coming straight by k with a wall behind at one side, that side and the diagonal towards it are new ground.
    """
    table = np.zeros((9, 256), np.uint8)
    for steps in range(256):
        for k in range(4):
            left, right = (k + 1) % 4, (k + 3) % 4
            kept = 1 << k
            if not steps & 16 << left:  # the diagonal back on the left; its other two cells are free
                kept |= 1 << left | 16 << k
            if not steps & 16 << (k + 2) % 4:
                kept |= 1 << right | 16 << right
            table[k, steps] = steps & kept
            table[4 + k, steps] = steps & (1 << k | 1 << left | 16 << k)
        table[NO_STEP, steps] = steps
    return table


ONWARD = _onward()
# The lowest of the bits set: which step to take next.
LOWEST = np.array([0] + [(bits & -bits).bit_length() - 1 for bits in range(1, 256)], np.uint8)


@njit(cache=True, nogil=True)
def _runs(steps_out: NDArray[np.uint8], offsets: NDArray[np.int32]) -> NDArray[np.int16]:
    """CellPlane.runs: each from that of the next cell. A run too long to be written down ends in between."""
    runs = np.zeros((len(steps_out), 4), np.int16)
    for place in range(len(steps_out)):
        for k in range(4):
            node = place if k >= 2 else len(steps_out) - 1 - place  # the next cell comes first
            if not steps_out[node] >> k & 1:
                continue
            onward = ONWARD[k, steps_out[node + offsets[k]]]
            run = runs[node + offsets[k], k]
            if onward == 0:
                runs[node, k] = -1
            elif onward != 1 << k or abs(run) == LONGEST_RUN:
                runs[node, k] = 1
            else:
                runs[node, k] = run + 1 if run > 0 else run - 1
    return runs
