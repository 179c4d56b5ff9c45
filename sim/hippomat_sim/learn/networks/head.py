"""The head: annealed potentials that turn the benefit of every edge into an allocation (entropic optimal
transport, Sinkhorn iterations in the log domain; Cuturi 2013, Peyre and Cuturi 2019 section 4.4, annealed
and over-relaxed, Thibault et al. 2021).

Rows are agents, columns are tasks, p_ij = exp((b_ij - u_i - v_j) / tau). A row's potential u_i makes its
shares sum to one, a column's price v_j its own; tau falls geometrically. What is left over goes to a slack
row of capacity columns - rows or a slack column of capacity rows - columns. While waiting is allowed, both
are open without limit: an agent may wait at a fixed benefit, a task may stay unserved. An agent acts by its
largest net offer b_ij - v_j.

An edge out of reach takes part at a cost beyond every other one and stands for "no request": so there is
always a complete solution, with as few of them as the prices allow.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from hippomat_core.allocation.graphsage_settings import CLOSED_EXTRA, GraphSageSettings
from hippomat_sim.learn.networks.edges import Edges

NOTHING = -1e9  # finite, so that nothing minus nothing is no NaN


@dataclass(frozen=True, slots=True, eq=False)
class Market:
    """Benefits with a slack row and a slack column behind them; NOTHING where nothing can be."""

    benefit: Tensor  # (B, N + 1, M + 1), float64
    log_rows: Tensor  # (B,) logarithm of the slack row's capacity
    log_columns: Tensor  # (B,) of the slack column's
    open: Tensor  # (B,) bool: both slacks are unlimited


def net_offers(edges: Edges, first_prices: Tensor, settings: GraphSageSettings) -> Tensor:
    """(B, N, M + 1) b_ij - v_j in units of the scale, no request in front. first_prices: (B, M)."""
    market = market_of(edges)
    first = torch.cat([first_prices, torch.zeros_like(first_prices[:, :1])], dim=1).double()
    final = prices(market, torch.where(market.open[:, None], first.clamp(min=0.0), first), settings)
    net = market.benefit[:, :-1] - final[:, None, :]
    tasks, slack = net[:, :, :-1], net[:, :, -1:]
    beyond = tasks.masked_fill(~edges.closed, NOTHING).amax(dim=2, keepdim=True)
    return torch.cat([torch.maximum(slack, beyond), tasks.masked_fill(~edges.valid, NOTHING)], dim=2)


def market_of(edges: Edges) -> Market:
    count, agents, tasks = edges.cost.shape
    farthest = edges.cost.flatten(1).amax(dim=1)[:, None, None] + CLOSED_EXTRA
    surplus = edges.rows - edges.columns
    rest = edges.valid.any(dim=2) & (edges.may_wait | (surplus > 0))[:, None]
    unserved = edges.valid.any(dim=1) & (edges.may_wait | (surplus < 0))[:, None]
    table = edges.cost.new_full((count, agents + 1, tasks + 1), NOTHING)
    table[:, :-1, :-1] = torch.where(edges.valid, -edges.cost, torch.where(edges.closed, -farthest, NOTHING))
    table[:, :-1, -1] = torch.where(rest, -edges.wait * edges.may_wait[:, None], NOTHING)
    table[:, -1, :-1] = torch.where(unserved, 0.0, NOTHING)
    log_capacity = surplus.abs().clamp(min=1).to(table.dtype).log()
    return Market(table, log_capacity * (surplus < 0), log_capacity * (surplus > 0), edges.may_wait)


def prices(market: Market, first: Tensor, settings: GraphSageSettings) -> Tensor:
    """(B, M + 1) v_j after all steps, the slack column's last. first: (B, M + 1) where they begin."""
    benefit = market.benefit
    rows, columns = (benefit > NOTHING / 2).any(dim=2), (benefit > NOTHING / 2).any(dim=1)
    u, v = torch.zeros_like(benefit[:, :, 0]), _settled(first, columns, market.open)
    for step, tau in enumerate(temperatures(settings)):
        rate = settings.relaxation if step else 1.0
        u = u + rate * (_potential(benefit - v[:, None, :], columns[:, None, :], tau, market.log_rows, 2) - u)
        u = _settled(u, rows, market.open)
        v = v + rate * (_potential(benefit - u[:, :, None], rows[:, :, None], tau, market.log_columns, 1) - v)
        v = _settled(v, columns, market.open)
    return v


def temperatures(settings: GraphSageSettings) -> list[float]:
    """tau of every step, geometric from the first to the last."""
    ratio = settings.tau_last / settings.tau_first
    last = max(settings.head_steps - 1, 1)
    return [settings.tau_first * ratio ** (step / last) for step in range(settings.head_steps)]


def _potential(net: Tensor, taking_part: Tensor, tau: float, log_slack: Tensor, dim: int) -> Tensor:
    """tau log sum exp(net / tau) along dim; the slack's, which is last, less tau log of its capacity."""
    total = tau * torch.logsumexp(net.masked_fill(~taking_part, NOTHING) / tau, dim=dim)
    return torch.cat([total[:, :-1], total[:, -1:] - tau * log_slack[:, None]], dim=1)


def _settled(potential: Tensor, taking_part: Tensor, open_: Tensor) -> Tensor:
    """Zero where nothing takes part, and for slacks without limit."""
    limited = torch.cat([taking_part[:, :-1], taking_part[:, -1:] & ~open_[:, None]], dim=1)
    return potential.masked_fill(~limited, 0.0)
