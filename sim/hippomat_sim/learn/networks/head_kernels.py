"""The head's steps for many snapshots at once and their gradient by the first prices, compiled. float64.

Snapshots are the innermost axis: a loop over them is vector code, however small the fleet is. head.py says
what the steps are; `prices` there gives the same in torch's operations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from hippomat_core.allocation.vector_math import exp_64, log_64


@njit(cache=True, nogil=True)
def settle(benefit: Any, slack: Any, free: Any, steps: Any, u: Any, v: Any) -> None:
    """benefit: (N + 1, M + 1, B); slack, free: of rows and of columns, (N + 1, B) and (M + 1, B) each: the
    logarithm of the capacity, and 1 where the potential moves, else 0. steps: (steps, 2) tau and rate.

    u: (steps + 1, N + 1, B), v: (steps + 1, M + 1, B), begun at [0]: the potentials after every step.
    """
    row_slack, column_slack = slack
    row_free, column_free = free
    n, m, b = benefit.shape
    edges = benefit.reshape(n * m, b)
    most, total = np.empty(b), np.empty(b)
    for step in range(len(steps)):
        move, before, after = steps[step], step, step + 1
        for i in range(n):
            _move(
                edges,
                i * m,
                1,
                v[before],
                row_slack[i],
                row_free[i],
                move,
                u[before, i],
                u[after, i],
                most,
                total,
            )
        for j in range(m):
            _move(
                edges,
                j,
                m,
                u[after],
                column_slack[j],
                column_free[j],
                move,
                v[before, j],
                v[after, j],
                most,
                total,
            )


@njit(cache=True, nogil=True)
def _move(
    edges: Any, first: int, stride: int, theirs: Any, slack: Any, free: Any, move: Any,
    before: Any, after: Any, most: Any, total: Any,
) -> None:  # fmt: skip
    """Moves the potential of one row or column, (B,), given those across, (K, B). Its K edges lie `stride`
    apart in (N M, B)."""
    tau, rate = move
    sharpness, b = 1.0 / tau, len(after)
    for s in range(b):
        most[s] = edges[first, s] - theirs[0, s]
        total[s] = 0.0
    for k in range(1, len(theirs)):
        for s in range(b):
            most[s] = max(most[s], edges[first + k * stride, s] - theirs[k, s])
    for k in range(len(theirs)):
        for s in range(b):
            total[s] += exp_64((edges[first + k * stride, s] - theirs[k, s] - most[s]) * sharpness)
    for s in range(b):
        target = most[s] + tau * (log_64(total[s]) - slack[s])
        after[s] = free[s] * (before[s] + rate * (target - before[s]))


@njit(cache=True, nogil=True)
def settle_backward(benefit: Any, slack: Any, free: Any, steps: Any, u: Any, v: Any, by_v: Any) -> None:
    """by_v: (M + 1, B) gradient by the last prices, becomes that by the first ones.

    A target is tau log sum exp((b - p) / tau) over the other side's potentials p: its gradient by p is minus
    exp((b - p - target) / tau), the share that the other one has in it.
    """
    row_slack, column_slack = slack
    row_free, column_free = free
    n, m, b = benefit.shape
    edges = benefit.reshape(n * m, b)
    by_u, target, by_target = np.zeros((n, b)), np.empty(b), np.empty(b)
    for step in range(len(steps) - 1, -1, -1):
        move, before, after = steps[step], step, step + 1
        for j in range(m):
            _move_backward(
                edges, j, m, u[after], column_slack[j], column_free[j], move,
                v[before, j], v[after, j], by_v[j], by_u, target, by_target,
            )  # fmt: skip
        for i in range(n):
            _move_backward(
                edges, i * m, 1, v[before], row_slack[i], row_free[i], move,
                u[before, i], u[after, i], by_u[i], by_v, target, by_target,
            )  # fmt: skip


@njit(cache=True, nogil=True)
def _move_backward(
    edges: Any, first: int, stride: int, theirs: Any, slack: Any, free: Any, move: Any,
    before: Any, after: Any, by_ours: Any, by_theirs: Any, target: Any, by_target: Any,
) -> None:  # fmt: skip
    """As _move: by_ours, (B,), becomes the gradient by what was before; by_theirs, (K, B), is added to."""
    tau, rate = move
    sharpness, kept, b = 1.0 / tau, 1.0 - rate, len(after)
    for s in range(b):
        by_target[s] = rate * free[s] * by_ours[s]
        by_ours[s] *= kept * free[s]
        target[s] = (after[s] - kept * before[s]) / rate + tau * slack[s]
    for k in range(len(theirs)):
        for s in range(b):
            share = (edges[first + k * stride, s] - theirs[k, s] - target[s]) * sharpness
            by_theirs[k, s] -= by_target[s] * exp_64(min(share, 0.0))
