"""The best of all poses on a grid around a guess: exhaustive in its answer, not in its work.

Two levels, branch and bound (Olson 2009; Hess et al. 2016): a block of BLOCK x BLOCK translations is looked
into only if its bound reaches the best score so far. Scores are sums of integers, and of equal ones the
nearest to the guess wins, so the answer depends on nothing but the arguments. Knows cells, not metres.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.slam.likelihood_field import BLOCK

MOST_LOSS = 2.0**30  # more would overflow 32 bits

Best = tuple[int, int, int, int]  # dx, dy [cells], yaw step, sum of levels


@njit(cache=True, nogil=True)
def search_poses(
    levels: NDArray[np.uint8],
    blocks: NDArray[np.uint8],
    points: NDArray[np.float64],
    guess: NDArray[np.float64],
    half_cells: int,
    half_turns: int,
    turn_rad: float,
    per_cell: float,
    per_turn: float,
) -> Best:
    """(dx, dy, turn, score): the best translation in cells and rotation in steps of turn_rad from the guess.

    points: (n, 2) base frame, and guess: (3,) x, y, yaw; both with lengths in cells from the field's corner
    per_cell, per_turn: what a pose's score loses per squared cell and per squared turn away from the guess
    """
    count, turns = points.shape[0], 2 * half_turns + 1
    corner = np.empty((turns, count, 2), np.int32)  # each point's cell at the least translation
    side = (2 * half_cells + BLOCK) // BLOCK  # blocks that hold the 2 half_cells + 1 translations
    bounds = np.zeros((turns, side, side), np.int32)
    for turn in range(turns):
        _place(points, guess, guess[2] + (turn - half_turns) * turn_rad, half_cells, corner[turn])
        _add_bounds(blocks, corner[turn], bounds[turn])
        _take_least_loss(bounds[turn], half_cells, turn - half_turns, per_cell, per_turn)
    scores = np.empty((BLOCK, BLOCK), np.int32)
    flat = bounds.ravel()
    best_x, best_y, best_turn, best, nearest = 0, 0, 0, 0, -1
    known = _score_of_guess(levels, corner[half_turns], half_cells)
    for block in _promising(flat, known):
        if flat[block] < best:
            break
        turn, place = block // (side * side), block % (side * side)
        first_x, first_y = (place % side) * BLOCK, (place // side) * BLOCK
        _score_block(levels, corner[turn], first_x, first_y, scores)
        for by in range(min(BLOCK, 2 * half_cells + 1 - first_y)):
            for bx in range(min(BLOCK, 2 * half_cells + 1 - first_x)):
                dx, dy, dturn = first_x + bx - half_cells, first_y + by - half_cells, turn - half_turns
                away = dx * dx + dy * dy + dturn * dturn
                score = scores[by, bx] - _loss(dx, dy, dturn, per_cell, per_turn)
                if score > best or (score == best and 0 <= away < nearest):
                    best_x, best_y, best_turn, best, nearest = dx, dy, dturn, score, away
    return best_x, best_y, best_turn, best


@njit(cache=True, nogil=True)
def _loss(dx: int, dy: int, dturn: int, per_cell: float, per_turn: float) -> int:
    return int(min(per_cell * (dx * dx + dy * dy) + per_turn * dturn * dturn, MOST_LOSS))


@njit(cache=True, nogil=True)
def _take_least_loss(
    bounds: NDArray[np.int32], half_cells: int, dturn: int, per_cell: float, per_turn: float
) -> None:
    """Each block's bound, less what its pose nearest to the guess loses."""
    for by in range(bounds.shape[0]):
        low = by * BLOCK - half_cells
        dy = max(low, min(0, low + BLOCK - 1))
        for bx in range(bounds.shape[1]):
            left = bx * BLOCK - half_cells
            dx = max(left, min(0, left + BLOCK - 1))
            bounds[by, bx] -= _loss(dx, dy, dturn, per_cell, per_turn)


@njit(cache=True, nogil=True)
def _score_of_guess(levels: NDArray[np.uint8], cells: NDArray[np.int32], half_cells: int) -> int:
    """The sum of levels at the guess itself, which loses nothing."""
    total = 0
    for k in range(cells.shape[0]):
        ix, iy = cells[k, 0] + half_cells, cells[k, 1] + half_cells
        if 0 <= ix < levels.shape[1] and 0 <= iy < levels.shape[0]:
            total += levels[iy, ix]
    return total


@njit(cache=True, nogil=True)
def _promising(bounds: NDArray[np.int32], known: int) -> NDArray[np.int64]:
    """The blocks that may hold the best pose, highest bound first: all that reach a score that exists."""
    blocks = np.flatnonzero(bounds >= max(known, 1))
    return blocks[np.argsort(-bounds[blocks], kind="mergesort")]  # stable, so equal bounds keep their order


@njit(cache=True, nogil=True)
def _place(
    points: NDArray[np.float64],
    guess: NDArray[np.float64],
    yaw_rad: float,
    half_cells: int,
    cells: NDArray[np.int32],
) -> None:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    for k in range(points.shape[0]):
        cells[k, 0] = math.floor(guess[0] + c * points[k, 0] - s * points[k, 1]) - half_cells
        cells[k, 1] = math.floor(guess[1] + s * points[k, 0] + c * points[k, 1]) - half_cells


@njit(cache=True, nogil=True)
def _add_bounds(blocks: NDArray[np.uint8], cells: NDArray[np.int32], bounds: NDArray[np.int32]) -> None:
    """bounds[by, bx] += what each point can meet in that block of translations."""
    high, wide = blocks.shape
    side = bounds.shape[0]
    for k in range(cells.shape[0]):
        left, low = cells[k, 0] // BLOCK + 1, cells[k, 1] // BLOCK + 1  # // floors: right for cells < 0
        first_x, last_x = max(-left, 0), min(wide - left, side)
        for by in range(max(-low, 0), min(high - low, side)):
            for bx in range(first_x, last_x):
                bounds[by, bx] += blocks[low + by, left + bx]


@njit(cache=True, nogil=True)
def _score_block(
    levels: NDArray[np.uint8],
    cells: NDArray[np.int32],
    first_x: int,
    first_y: int,
    scores: NDArray[np.int32],
) -> None:
    """scores[by, bx] = sum of levels that the points meet, moved by (first_x + bx, first_y + by) cells."""
    height, width = levels.shape
    scores[:] = 0
    for k in range(cells.shape[0]):
        left, low = cells[k, 0] + first_x, cells[k, 1] + first_y
        for by in range(max(-low, 0), min(height - low, BLOCK)):
            for bx in range(max(-left, 0), min(width - left, BLOCK)):
                scores[by, bx] += levels[low + by, left + bx]
