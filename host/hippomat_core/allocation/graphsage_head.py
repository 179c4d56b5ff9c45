"""The head, compiled: annealed potentials from learned first prices to net offers. float64.

Entropic optimal transport, Sinkhorn iterations in the log domain (Peyre and Cuturi 2019, section 4.4),
annealed and over-relaxed (Thibault et al. 2021). hippomat_sim.learn.networks.head has the same in torch
and says why.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.allocation.graphsage_edges import Edges
from hippomat_core.allocation.graphsage_settings import CLOSED_EXTRA, PRICE_SIZE, GraphSageSettings
from hippomat_core.allocation.vector_math import exp_32, exp_64, log_64

NOTHING = -1e9  # finite, so that nothing minus nothing is no NaN

Values = NDArray[np.float64]


def net_offers(
    edges: Edges, learned: NDArray[np.float32], settings: GraphSageSettings
) -> tuple[Values, Values]:
    """b_ij - v_j in units of the scale: of no request (n,), of the tasks (n, m), NOTHING where not valid.

    learned: (3, n, m), as run_trunk gives them.
    """
    table = _market(edges)
    n, m = edges.valid.shape
    prices = np.zeros(m + 1)
    prices[:m] = _pooled_prices(learned[1], learned[2], edges.valid)
    if edges.may_wait:
        prices[:m] = np.maximum(prices[:m], 0.0)
    _settle(table, prices, temperatures(settings), settings.relaxation, n - m, edges.may_wait)
    net = table[:n] - prices
    closed = ~edges.valid
    beyond = np.where(closed, net[:, :m], NOTHING).max(axis=1)
    return np.maximum(net[:, m], beyond), np.where(closed, NOTHING, net[:, :m])


def temperatures(settings: GraphSageSettings) -> Values:
    """tau of every step, geometric from the first to the last."""
    ratio = settings.tau_last / settings.tau_first
    last = max(settings.head_steps - 1, 1)
    return np.array([settings.tau_first * ratio ** (step / last) for step in range(settings.head_steps)])


def _market(edges: Edges) -> Values:
    """(n + 1, m + 1) benefits, the slack row and column last; NOTHING where nothing can be."""
    n, m = edges.valid.shape
    table = np.full((n + 1, m + 1), NOTHING)
    table[:n, :m] = np.where(edges.valid, -edges.cost, -(edges.cost.max() + CLOSED_EXTRA))
    if edges.may_wait:
        table[:n, m] = -edges.wait[edges.rows]
    elif n > m:
        table[:n, m] = 0.0
    if edges.may_wait or n < m:
        table[n, :m] = 0.0
    return table


@njit(cache=True)
def _pooled_prices(price, weight, valid):  # type: ignore[no-untyped-def]
    """(m,) every task's price, the mean of its robots' by the softmax of their weights."""
    n, m = valid.shape
    most, total = np.full(m, np.float32(NOTHING)), np.zeros(m, np.float32)
    for i in range(n):
        for j in range(m):
            most[j] = weight[i, j] if valid[i, j] and weight[i, j] > most[j] else most[j]
    pooled = np.zeros(m, np.float32)
    for i in range(n):
        for j in range(m):
            if valid[i, j]:
                share = exp_32(weight[i, j] - most[j])
                total[j] += share
                pooled[j] += share * price[i, j]
    return np.float32(PRICE_SIZE) * (pooled / total)


@njit(cache=True)
def _settle(benefit, v, taus, relaxation, surplus, open_):  # type: ignore[no-untyped-def]
    """Moves the prices v, (m + 1,), through all steps. surplus: rows - columns."""
    n, m = benefit.shape[0] - 1, benefit.shape[1] - 1
    slack_row, slack_column = open_ or surplus < 0, open_ or surplus > 0
    log_capacity = np.log(np.float64(max(abs(surplus), 1)))
    turned = benefit.T.copy()
    u = np.zeros(n + 1)
    most, total = np.empty(max(n, m) + 1), np.empty(max(n, m) + 1)
    rows, columns = n + slack_row, m + slack_column
    for step in range(len(taus)):
        rate = relaxation if step else 1.0
        _move(turned, v, u, columns, rows, taus[step], rate, most, total)
        if slack_row:
            u[n] = 0.0 if open_ else u[n] - rate * taus[step] * log_capacity
        _move(benefit, u, v, rows, columns, taus[step], rate, most, total)
        if slack_column:
            v[m] = 0.0 if open_ else v[m] - rate * taus[step] * log_capacity


@njit(cache=True)
def _move(table, theirs, ours, them, us, tau, rate, most, total):  # type: ignore[no-untyped-def]
    """ours[j] moves by `rate` towards tau log sum over i of exp((table[i, j] - theirs[i]) / tau)."""
    for j in range(us):
        most[j] = table[0, j] - theirs[0]
        total[j] = 0.0
    for i in range(1, them):
        for j in range(us):
            net = table[i, j] - theirs[i]
            most[j] = net if net > most[j] else most[j]
    sharpness = 1.0 / tau
    for i in range(them):
        for j in range(us):
            total[j] += exp_64((table[i, j] - theirs[i] - most[j]) * sharpness)
    for j in range(us):
        ours[j] += rate * (most[j] + tau * log_64(total[j]) - ours[j])
