"""The agent-task edges of one snapshot: which take part, their costs in the snapshot's scale, their features.

Rows that no task is open to and tasks that no row can reach are left out, so that a robot alone among thirty
tasks computes thirty edges. Every robot that holds the snapshot computes the same numbers to the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.allocation.graphsage_settings import (
    AGE_SPAN_ROUNDS,
    COST_SPAN,
    DIFFERENCE_SPAN,
    FEATURES,
    FRACTION,
    LEAST_SCALE,
    NEAREST,
    RATIO_SPAN,
    WAIT_EXTRA,
    GraphSageSettings,
)
from hippomat_core.allocation.port import Problem
from hippomat_core.allocation.tie_jitter import code_jitter
from hippomat_core.wire.frames import UNREACHABLE

_RANK_SHARE = np.exp(-0.5 * np.arange(256)).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """n rows (available robots, with look-ahead the busy ones too) by m columns (waiting tasks)."""

    rows: NDArray[np.int64]  # (n,) robot of every row
    columns: NDArray[np.int64]  # (m,) slot of every column
    valid: NDArray[np.bool_]  # (n, m) the task is in the row's reach
    raw: NDArray[np.float32]  # (n, m) cost in c_max, inf where not valid
    row_rank: NDArray[np.int64]  # (n, m) 0 = the cheapest task of its robot
    column_rank: NDArray[np.int64]  # (n, m) 0 = the cheapest robot of its task
    cost: NDArray[np.float64]  # (n, m) c / s, 0 where not valid
    own: NDArray[np.bool_]  # (n,) the row's robot is available
    may_wait: bool  # look-ahead, and somebody is busy
    wait: NDArray[np.float64]  # (N,) what no request costs, in the scale
    may_rest: NDArray[np.bool_]  # (N,) no request is a valid action


def edges_of(problem: Problem, settings: GraphSageSettings) -> Edges:
    robots, tasks = problem.costs_q.shape
    promised = problem.busy & ~problem.available & settings.look_ahead
    taking_part = (problem.available | promised) & problem.present
    possible = (problem.costs_q != UNREACHABLE) & taking_part[:, None] & problem.waiting
    rows, columns = np.flatnonzero(possible.any(axis=1)), np.flatnonzero(possible.any(axis=0))
    pick = np.ix_(rows, columns)
    valid = possible[pick]
    codes = problem.costs_q[pick].astype(np.float32) + code_jitter(robots, tasks)[pick]
    raw = np.square(codes * np.float32(FRACTION))
    raw[~valid] = np.inf
    row_rank, column_rank = _row_ranks(raw), np.ascontiguousarray(_row_ranks(raw.T.copy()).T)
    cost = raw.astype(np.float64) / _cost_scale(raw)
    own = problem.available[rows]
    may_wait = bool(promised[rows].any())
    wait = np.zeros(robots)
    wait[rows] = np.where(own, cost.min(axis=1, initial=np.inf), 0.0)
    soonest = cost.min(axis=0, initial=np.inf).sum() / max(len(columns), 1)
    wait = np.maximum(wait, settings.wait_factor * soonest) + WAIT_EXTRA
    may_rest = np.ones(robots, np.bool_)
    spare = (len(rows) > len(columns)) | ~valid.all(axis=1)
    may_rest[rows] = ~own | may_wait | (spare & ~((column_rank == 0) & valid).any(axis=1))
    cost[~valid] = 0.0
    return Edges(rows, columns, valid, raw, row_rank, column_rank, cost, own, may_wait, wait, may_rest)


@njit(cache=True)
def _row_ranks(raw: NDArray[np.float32]) -> NDArray[np.int64]:
    """Place of every cost among its row's, from 0; of equal ones the first column is the smaller."""
    n, m = raw.shape
    ranks = np.zeros((n, m), np.int64)
    for i in range(n):
        for k in range(m):
            for j in range(m):
                ranks[i, j] += raw[i, k] < raw[i, j] or (raw[i, k] == raw[i, j] and k < j)
    return ranks


@njit(cache=True)
def _cost_scale(raw: NDArray[np.float32]) -> float:
    """s: the mean over rows of the mean of their NEAREST smallest costs; 1 where there are none."""
    n, m = raw.shape
    total = 0.0
    for i in range(n):
        least = np.full(NEAREST, np.inf)
        for j in range(m):
            new = np.float64(raw[i, j])
            for place in range(NEAREST):
                if new < least[place]:
                    new, least[place] = least[place], new
        finite = least[np.isfinite(least)]
        total += finite.sum() / len(finite)
    return max(total / n, LEAST_SCALE) if n else 1.0


def edge_features(edges: Edges, problem: Problem) -> NDArray[np.float32]:
    """(FEATURES, n m) float32, in the order of the torch network's edge_features; 0 where not valid."""
    cost = np.where(edges.valid, edges.cost, np.inf).astype(np.float32)
    ages = np.minimum(problem.ages_rounds[edges.rows].astype(np.float32), np.float32(AGE_SPAN_ROUNDS))
    busy = problem.busy[edges.rows].astype(np.float32)
    planes: NDArray[np.float32] = _features(
        cost, edges.row_rank, edges.column_rank, ages / np.float32(10.0), busy
    )
    return planes


@njit(cache=True)
def _features(cost, row_rank, column_rank, age, busy):  # type: ignore[no-untyped-def]
    n, m = cost.shape
    features = np.zeros((FEATURES, n * m), np.float32)
    row_least, row_second = _least_two(cost)
    column_least, column_second = _least_two(cost.T.copy())
    size, span = np.float32(DIFFERENCE_SPAN), np.float32(COST_SPAN)
    ratio = np.float32(min(n / max(m, 1), RATIO_SPAN))
    for i in range(n):
        for j in range(m):
            c = cost[i, j]
            if c == np.inf:
                continue
            e = i * m + j
            other_robot = column_second[j] if column_rank[i, j] == 0 else column_least[j]
            other_task = row_second[i] if row_rank[i, j] == 0 else row_least[i]
            features[0, e] = min(c, span) / size
            features[1, e] = min(max(c - other_robot, -size), size)
            features[2, e] = min(max(c - other_task, -size), size)
            features[3, e] = min(row_least[i], span) / size
            features[4, e] = min(column_least[j], span) / size
            features[5, e] = _RANK_SHARE[row_rank[i, j]]
            features[6, e] = _RANK_SHARE[column_rank[i, j]]
            features[7, e] = ratio
            features[8, e] = age[i]
            features[9, e] = busy[i]
    return features


@njit(cache=True)
def _least_two(cost):  # type: ignore[no-untyped-def]
    """The smallest and the second smallest cost of every row, inf where there is none."""
    n, m = cost.shape
    least, second = np.full(n, np.float32(np.inf)), np.full(n, np.float32(np.inf))
    for i in range(n):
        for j in range(m):
            c = cost[i, j]
            if c < least[i]:
                least[i], second[i] = c, least[i]
            elif c < second[i]:
                second[i] = c
    return least, second
