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
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import once_differentiable

from hippomat_core.allocation.graphsage_settings import CLOSED_EXTRA, GraphSageSettings
from hippomat_sim.learn.networks.edges import Edges
from hippomat_sim.learn.networks.head_kernels import settle, settle_backward

NOTHING = -1e9  # finite, so that nothing minus nothing is no NaN

Values = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Market:
    """Benefits with a slack row and a slack column behind them; NOTHING where nothing can be."""

    benefit: Tensor  # (B, N + 1, M + 1), float64
    log_rows: Tensor  # (B,) logarithm of the slack row's capacity
    log_columns: Tensor  # (B,) of the slack column's
    open: Tensor  # (B,) bool: both slacks are unlimited

    def limited(self) -> tuple[Tensor, Tensor]:
        """(B, N + 1) and (B, M + 1) bool: potentials that move.

        The others are zero: where nothing takes part, and slacks without limit.
        """
        possible = self.benefit > NOTHING / 2
        rows, columns = possible.any(dim=2), possible.any(dim=1)
        for side in (rows, columns):
            side[:, -1] &= ~self.open
        return rows, columns


def net_offers(edges: Edges, first_prices: Tensor, settings: GraphSageSettings, compiled: bool) -> Tensor:
    """(B, N, M + 1) b_ij - v_j in units of the scale, no request in front. first_prices: (B, M)."""
    market = market_of(edges)
    first = torch.cat([first_prices, torch.zeros_like(first_prices[:, :1])], dim=1).double()
    first = torch.where(market.open[:, None], first.clamp(min=0.0), first)
    final = (fast_prices if compiled else prices)(market, first, settings)
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
    rows, columns = market.limited()
    u, v = torch.zeros_like(benefit[:, :, 0]), first.masked_fill(~columns, 0.0)
    for step, tau in enumerate(temperatures(settings)):
        rate = settings.relaxation if step else 1.0
        u = u + rate * (_potential(benefit - v[:, None, :], tau, market.log_rows, 2) - u)
        u = u.masked_fill(~rows, 0.0)
        v = v + rate * (_potential(benefit - u[:, :, None], tau, market.log_columns, 1) - v)
        v = v.masked_fill(~columns, 0.0)
    return v


def fast_prices(market: Market, first: Tensor, settings: GraphSageSettings) -> Tensor:
    """As `prices`, compiled, on a CPU; the gradient goes to `first` alone."""
    final: Tensor = _Settled.apply(first, market, settings)  # type: ignore[no-untyped-call]
    return final


class _Settled(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, first: Tensor, market: Market, settings: GraphSageSettings) -> Tensor:
        taus = np.array(temperatures(settings))
        steps = np.column_stack([taus, np.full(len(taus), settings.relaxation)])
        steps[0, 1] = 1.0
        rows, limited = market.limited()
        benefit, slack, free = _innermost_snapshots(market, rows, limited)
        u = np.zeros((len(taus) + 1, benefit.shape[0], benefit.shape[2]))
        v = np.empty((len(taus) + 1, benefit.shape[1], benefit.shape[2]))
        v[0] = first.detach().masked_fill(~limited, 0.0).numpy().T
        settle(benefit, slack, free, steps, u, v)
        ctx.given, ctx.limited = (benefit, slack, free, steps, u, v), limited
        return torch.from_numpy(v[-1].T.copy())

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *by_outputs: Tensor) -> Any:
        by_v = by_outputs[0].T.numpy().copy()
        benefit, slack, free, steps, u, v = ctx.given
        settle_backward(benefit, slack, free, steps, u, v, by_v)
        return torch.from_numpy(by_v.T.copy()).masked_fill(~ctx.limited, 0.0), None, None


def _innermost_snapshots(
    market: Market, rows: Tensor, columns: Tensor
) -> tuple[Values, tuple[Values, Values], tuple[Values, Values]]:
    """Benefits, capacities and what moves, as the kernels take them. rows, columns: market.limited()."""
    slacks = []
    for side, log_slack in ((rows, market.log_rows), (columns, market.log_columns)):
        slack = np.zeros((side.shape[1], len(side)))
        slack[-1] = log_slack.numpy()
        slacks.append(slack)
    benefit = np.ascontiguousarray(market.benefit.numpy().transpose(1, 2, 0))
    free = (rows.T.double().contiguous().numpy(), columns.T.double().contiguous().numpy())
    return benefit, (slacks[0], slacks[1]), free


def temperatures(settings: GraphSageSettings) -> list[float]:
    """tau of every step, geometric from the first to the last."""
    ratio = settings.tau_last / settings.tau_first
    last = max(settings.head_steps - 1, 1)
    return [settings.tau_first * ratio ** (step / last) for step in range(settings.head_steps)]


def _potential(net: Tensor, tau: float, log_slack: Tensor, dim: int) -> Tensor:
    """tau log sum exp(net / tau) along dim; the slack's, which is last, less tau log of its capacity."""
    total = tau * torch.logsumexp(net / tau, dim=dim)
    return torch.cat([total[:, :-1], total[:, -1:] - tau * log_slack[:, None]], dim=1)
