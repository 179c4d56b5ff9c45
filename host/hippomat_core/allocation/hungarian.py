"""Assign tasks to agents by minimum total travel cost (Kuhn 1955). Knows costs, not maps.

Solved in integers, so that no rounding decides: first as many assignments as can be, then the least total
of the de-quantised costs (q^2, in units of c_max / 254^2), then the least total of fixed weights that depend
on row and column alone, which settles ties in the same way for everyone who holds the same snapshot.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from hippomat_core.allocation.port import NO_LOGITS, Decision, Problem
from hippomat_core.config import MAX_ROBOTS, MAX_TASK_SLOTS

# All sums stay below 2^53 and so are exact in the float64 that scipy computes with:
# 64 rows x 254^2 < 2^22 units; a missing assignment weighs more than all costs together; 64 ties < 1 unit.
TIE_BITS = 16
UNIT = 2**23
FORBIDDEN = 2**22 * UNIT


def units(costs_q: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Costs of codes in units of c_max / 254^2; 255 = unreachable has no meaning here."""
    return np.square(costs_q.astype(np.int64))


def _tie_weights() -> NDArray[np.int64]:
    rows = np.arange(MAX_ROBOTS, dtype=np.uint64)[:, None]
    columns = np.arange(MAX_TASK_SLOTS, dtype=np.uint64)[None, :]
    mixed = (rows * np.uint64(MAX_TASK_SLOTS) + columns + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    return (mixed >> np.uint64(64 - TIE_BITS)).astype(np.int64)


_TIES = _tie_weights()  # (64, 80)


def weights_of(costs_q: NDArray[np.uint8], eligible: NDArray[np.bool_]) -> NDArray[np.int64]:
    """What each pair weighs in the sum to be least, (N, M); FORBIDDEN where it is not eligible."""
    robots, tasks = costs_q.shape
    return np.where(eligible, units(costs_q) * UNIT + _TIES[:robots, :tasks], FORBIDDEN)


def least_total(weights: NDArray[np.int64]) -> NDArray[np.int64]:
    """Column of every row, -1 for none: the assignment of the least sum, without its forbidden pairs."""
    columns = np.full(len(weights), -1, np.int64)
    chosen_rows, chosen_columns = linear_sum_assignment(weights.astype(np.float64))
    kept = weights[chosen_rows, chosen_columns] < FORBIDDEN
    columns[chosen_rows[kept]] = chosen_columns[kept]
    return columns


def assign(costs_q: NDArray[np.uint8], eligible: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Slot of every robot, -1 for none. costs_q: (N, M) codes  eligible: (N, M)  returns: (N,).

    Never gives a pair that is not eligible; one robot per task, one task per robot.
    """
    assignment = np.full(len(costs_q), -1, np.int64)
    rows = np.flatnonzero(eligible.any(axis=1))
    columns = np.flatnonzero(eligible.any(axis=0))
    if rows.size == 0:
        return assignment
    found = least_total(weights_of(costs_q, eligible)[np.ix_(rows, columns)])
    assignment[rows] = np.where(found >= 0, columns[found], -1)
    return assignment


class Hungarian:
    """Every robot solves the whole problem on the common snapshot and takes its own part."""

    name = "hungarian"

    def allocate(self, problem: Problem) -> Decision:
        return Decision(int(self.actions(problem)[problem.self_index]), NO_LOGITS)

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        return assign(problem.costs_q, problem.eligible) + 1
