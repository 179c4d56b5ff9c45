"""The agent-task edges of a snapshot: which take part, their costs in the snapshot's scale, their features.

The same numbers, computed in the same order, as the core's graphsage_kernels: a test holds them equal.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from hippomat_core.allocation.graphsage_settings import (
    AGE_SPAN_ROUNDS,
    COST_SPAN,
    DIFFERENCE_SPAN,
    LEAST_SCALE,
    NEAREST,
    RATIO_SPAN,
)
from hippomat_core.allocation.quantise import FULL_SCALE
from hippomat_sim.learn.networks.inputs import PolicyInputs

_INFINITE = float("inf")


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Rows = available agents, with look-ahead the busy ones too; columns = waiting tasks.

    A row or column without a valid edge takes no part.
    """

    valid: Tensor  # (B, N, M) bool: the row takes part, the task waits and is reachable
    closed: Tensor  # (B, N, M) bool: row and column take part, but the task is out of the row's reach
    eligible: Tensor  # (B, N, M) bool: valid, and the agent is free to request
    cost: Tensor  # (B, N, M) c / s, 0 where not valid
    row_rank: Tensor  # (B, N, M) int64: 0 = the cheapest task of its agent
    column_rank: Tensor  # (B, N, M) int64: 0 = the cheapest agent of its task
    rows: Tensor  # (B,) how many rows take part
    columns: Tensor  # (B,)
    may_wait: Tensor  # (B,) bool: look-ahead, and somebody is busy
    may_rest: Tensor  # (B, N) bool: no request is an action
    ages_rounds: Tensor  # (B, N)
    busy: Tensor  # (B, N) bool


def edges_of(inputs: PolicyInputs, look_ahead: bool) -> Edges:
    taking_part = (inputs.available | inputs.busy) if look_ahead else inputs.available
    row_open = taking_part & inputs.present
    valid = inputs.reachable & row_open[:, :, None] & inputs.waiting[:, None, :]
    codes = inputs.costs_q.float() + inputs.jitter
    cost = torch.square(codes * (1.0 / FULL_SCALE)).masked_fill(~valid, _INFINITE)
    row_rank, column_rank = _ranks(cost, 2), _ranks(cost, 1)
    row_in, column_in = valid.any(dim=2), valid.any(dim=1)
    closed = row_in[:, :, None] & column_in[:, None, :] & ~valid
    eligible = valid & inputs.available[:, :, None]
    may_wait = (inputs.busy & inputs.present).any(dim=1) & look_ahead
    rows, columns = row_in.sum(dim=1), column_in.sum(dim=1)
    first = ((column_rank == 0) & valid).any(dim=2)
    spare = (rows > columns)[:, None] | closed.any(dim=2)
    return Edges(
        valid=valid,
        closed=closed,
        eligible=eligible,
        cost=(cost / cost_scale(cost)[:, None, None]).masked_fill(~valid, 0.0),
        row_rank=row_rank,
        column_rank=column_rank,
        rows=rows,
        columns=columns,
        may_wait=may_wait,
        may_rest=~eligible.any(dim=2) | may_wait[:, None] | (spare & ~first),
        ages_rounds=inputs.ages_rounds,
        busy=inputs.busy,
    )


def cost_scale(cost: Tensor) -> Tensor:
    """s, (B,): the mean over rows of the mean of their NEAREST smallest costs. cost: inf where invalid."""
    nearest = cost.topk(min(NEAREST, cost.shape[2]), dim=2, largest=False).values
    finite = torch.isfinite(nearest)
    count = finite.sum(dim=2)
    means = nearest.masked_fill(~finite, 0.0).sum(dim=2) / count.clamp(min=1)
    rows = (count > 0).sum(dim=1)
    return torch.where(rows > 0, means.sum(dim=1) / rows.clamp(min=1), 1.0).clamp(min=LEAST_SCALE)


def edge_features(edges: Edges) -> Tensor:
    """(B, N, M, FEATURES); 0 where not valid."""
    cost = edges.cost.masked_fill(~edges.valid, _INFINITE)
    row_least, other_task = _least_and_other(cost, edges.row_rank, 2)
    column_least, other_agent = _least_and_other(cost, edges.column_rank, 1)
    ratio = (edges.rows / edges.columns.clamp(min=1)).clamp(max=RATIO_SPAN)
    planes = (
        cost.clamp(max=COST_SPAN) / DIFFERENCE_SPAN,
        (cost - other_agent).clamp(-DIFFERENCE_SPAN, DIFFERENCE_SPAN),
        (cost - other_task).clamp(-DIFFERENCE_SPAN, DIFFERENCE_SPAN),
        row_least.clamp(max=COST_SPAN) / DIFFERENCE_SPAN,
        column_least.clamp(max=COST_SPAN) / DIFFERENCE_SPAN,
        torch.exp(edges.row_rank * -0.5),
        torch.exp(edges.column_rank * -0.5),
        ratio[:, None, None],
        (edges.ages_rounds.clamp(max=AGE_SPAN_ROUNDS) / 10.0)[:, :, None],
        edges.busy.to(cost.dtype)[:, :, None],
    )
    stacked = torch.stack([plane.expand_as(cost) for plane in planes], dim=3)
    return stacked.masked_fill(~edges.valid[..., None], 0.0)


def _ranks(cost: Tensor, dim: int) -> Tensor:
    return cost.argsort(dim=dim, stable=True).argsort(dim=dim)


def _least_and_other(cost: Tensor, rank: Tensor, dim: int) -> tuple[Tensor, Tensor]:
    """The smallest cost along dim, and for every edge the smallest of the others (inf where it is alone)."""
    least = cost.amin(dim=dim, keepdim=True)
    second = cost.masked_fill(rank == 0, _INFINITE).amin(dim=dim, keepdim=True)
    return least, torch.where(rank == 0, second, least)
