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
    most, total = np.empty(b), np.empty(b)
    for step in range(len(steps)):
        tau, rate = steps[step]
        sharpness = 1.0 / tau
        for i in range(n):
            for s in range(b):
                most[s] = benefit[i, 0, s] - v[step, 0, s]
                total[s] = 0.0
            for j in range(1, m):
                for s in range(b):
                    most[s] = max(most[s], benefit[i, j, s] - v[step, j, s])
            for j in range(m):
                for s in range(b):
                    total[s] += exp_64((benefit[i, j, s] - v[step, j, s] - most[s]) * sharpness)
            for s in range(b):
                target = most[s] + tau * (log_64(total[s]) - row_slack[i, s])
                u[step + 1, i, s] = row_free[i, s] * (u[step, i, s] + rate * (target - u[step, i, s]))
        for j in range(m):
            for s in range(b):
                most[s] = benefit[0, j, s] - u[step + 1, 0, s]
                total[s] = 0.0
            for i in range(1, n):
                for s in range(b):
                    most[s] = max(most[s], benefit[i, j, s] - u[step + 1, i, s])
            for i in range(n):
                for s in range(b):
                    total[s] += exp_64((benefit[i, j, s] - u[step + 1, i, s] - most[s]) * sharpness)
            for s in range(b):
                target = most[s] + tau * (log_64(total[s]) - column_slack[j, s])
                v[step + 1, j, s] = column_free[j, s] * (v[step, j, s] + rate * (target - v[step, j, s]))


@njit(cache=True, nogil=True)
def settle_backward(benefit: Any, slack: Any, free: Any, steps: Any, u: Any, v: Any, by_v: Any) -> None:
    """by_v: (M + 1, B) gradient by the last prices, becomes that by the first ones.

    A target is tau log sum exp((b - p) / tau) over the other side's potentials p: its gradient by p is minus
    exp((b - p - target) / tau), the share that the other one has in it.
    """
    row_slack, column_slack = slack
    row_free, column_free = free
    n, m, b = benefit.shape
    by_u, target, by_target = np.zeros((n, b)), np.empty(b), np.empty(b)
    for step in range(len(steps) - 1, -1, -1):
        tau, rate = steps[step]
        sharpness, kept = 1.0 / tau, 1.0 - rate
        for j in range(m):
            for s in range(b):
                by_target[s] = rate * column_free[j, s] * by_v[j, s]
                by_v[j, s] *= kept * column_free[j, s]
                moved = (v[step + 1, j, s] - kept * v[step, j, s]) / rate
                target[s] = moved + tau * column_slack[j, s]
            for i in range(n):
                for s in range(b):
                    share = (benefit[i, j, s] - u[step + 1, i, s] - target[s]) * sharpness
                    by_u[i, s] -= by_target[s] * exp_64(min(share, 0.0))
        for i in range(n):
            for s in range(b):
                by_target[s] = rate * row_free[i, s] * by_u[i, s]
                by_u[i, s] *= kept * row_free[i, s]
                moved = (u[step + 1, i, s] - kept * u[step, i, s]) / rate
                target[s] = moved + tau * row_slack[i, s]
            for j in range(m):
                for s in range(b):
                    share = (benefit[i, j, s] - v[step, j, s] - target[s]) * sharpness
                    by_v[j, s] -= by_target[s] * exp_64(min(share, 0.0))
