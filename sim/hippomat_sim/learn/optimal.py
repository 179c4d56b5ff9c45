"""Optimal assignments of many snapshots at once and the prices that support them (Kuhn 1955).

What `hippomat_core.allocation.hungarian` decides, compiled for whole batches, and the dual variables beside
it: at prices p_j every agent's cheapest task (c_ij + p_j) is the one that the optimum gives it.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.allocation.hungarian import FORBIDDEN, TIE_BITS, UNIT, units, weights_of
from hippomat_core.allocation.look_ahead import WAIT_FACTOR
from hippomat_core.allocation.quantise import FULL_SCALE
from hippomat_core.wire.frames import UNREACHABLE

Ints = NDArray[np.int64]
Codes = NDArray[np.uint8]
Flags = NDArray[np.bool_]


def best_slots(costs_q: Codes, eligible: Flags, promisable: Flags | None = None) -> Ints:
    """(B, N) slot of every agent or -1, as the core's assign() and, with promisable, assign_ahead().

    costs_q, eligible, promisable: (B, N, M); promisable are pairs of busy agents.
    """
    blank = np.zeros(costs_q.shape[1:], np.uint8)
    ties = weights_of(blank, np.ones(blank.shape, np.bool_))
    without = np.full(costs_q.shape[:2], FORBIDDEN, np.int64)
    if promisable is not None:
        ahead = np.asarray(promisable.any(axis=(1, 2)))
        without[ahead] = _wait(costs_q[ahead], eligible[ahead], promisable[ahead])
        eligible = eligible | promisable
        ties = ties + promisable * 2**TIE_BITS
    slots, _ = _solve(np.where(eligible, units(costs_q) * UNIT + ties, FORBIDDEN), without)
    return slots


def task_prices(costs_q: Codes, eligible: Flags, task_value: float) -> NDArray[np.float32]:
    """(B, M) p_j in units of c_max, within 0 .. task_value; a task that nobody wants costs nothing.

    An agent may stay without a task at a cost of task_value, so that prices stay bounded.
    """
    without = np.full(costs_q.shape[:2], round(task_value * FULL_SCALE**2), np.int64)
    _, prices = _solve(np.where(eligible, units(costs_q), FORBIDDEN), without)
    return (prices / FULL_SCALE**2).astype(np.float32)


def _wait(costs_q: Codes, eligible: Flags, promisable: Flags) -> Ints:
    """(B, N) what waiting weighs, as in the core's look_ahead."""
    possible = eligible | promisable
    soonest = units(np.where(possible, costs_q, UNREACHABLE).min(axis=1))
    wanted = possible.any(axis=1)
    mean = WAIT_FACTOR * np.where(wanted, soonest, 0).sum(axis=1) // np.maximum(wanted.sum(axis=1), 1)
    own_least = units(np.where(eligible, costs_q, UNREACHABLE).min(axis=2))
    wait = np.maximum(np.where(eligible.any(axis=2), own_least, 0), mean[:, None])
    weighed: Ints = wait * UNIT + 2**TIE_BITS
    return weighed


@njit(cache=True)
def _solve(weights: Ints, without: Ints) -> tuple[Ints, Ints]:
    """Columns (B, N), -1 = none at a cost of without (B, N), and prices (B, M), for weights (B, N, M)."""
    batch, rows, columns = weights.shape
    slots = np.full((batch, rows), -1, np.int64)
    prices = np.zeros((batch, columns), np.int64)
    for index in range(batch):
        _solve_one(weights[index], without[index], slots[index], prices[index])
    return slots, prices


@njit(cache=True)
def _solve_one(weights: Ints, without: Ints, slots: Ints, prices: Ints) -> None:
    """Shortest augmenting paths with potentials, one row after the other; writes into slots and prices.

    Columns M .. M + N - 1 are those of agents that stay without; the last one is where a new row starts.
    """
    rows, tasks = weights.shape
    columns = tasks + rows
    row_of = np.full(columns + 1, -1, np.int64)
    row_potential = np.zeros(rows, np.int64)
    potential = np.zeros(columns + 1, np.int64)
    came_from = np.empty(columns, np.int64)
    for row in range(rows):
        row_of[columns] = row
        column = columns
        least = np.full(columns, np.iinfo(np.int64).max, np.int64)
        used = np.zeros(columns + 1, np.bool_)
        while row_of[column] >= 0:
            used[column] = True
            at = row_of[column]
            step, nearest = np.iinfo(np.int64).max, -1
            for other in range(columns):
                if used[other]:
                    continue
                weight = weights[at, other] if other < tasks else without[at]
                reduced = weight - row_potential[at] - potential[other]
                if reduced < least[other]:
                    least[other] = reduced
                    came_from[other] = column
                if least[other] < step:
                    step, nearest = least[other], other
            for other in range(columns + 1):
                if used[other]:
                    row_potential[row_of[other]] += step
                    potential[other] -= step
                elif other < columns:
                    least[other] -= step
            column = nearest
        while column != columns:
            previous = came_from[column]
            row_of[column] = row_of[previous]
            column = previous
    for task in range(tasks):
        prices[task] = -potential[task]
        if row_of[task] >= 0 and weights[row_of[task], task] < FORBIDDEN:
            slots[row_of[task]] = task
