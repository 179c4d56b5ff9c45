"""The agent-task edges of a snapshot: which take part, their costs in the snapshot's scale, their features.

The same numbers, computed in the same order, as the core's graphsage_edges: a test holds them equal.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from torch import Tensor

from hippomat_core.allocation.graphsage_settings import (
    AGE_SPAN_ROUNDS,
    COST_SPAN,
    DIFFERENCE_SPAN,
    FRACTION,
    LEAST_SCALE,
    NEAREST,
    RATIO_SPAN,
    WAIT_EXTRA,
    GraphSageSettings,
)
from hippomat_sim.learn.networks.inputs import PolicyInputs

_INFINITE = float("inf")


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Rows = available agents, with look-ahead the busy ones too; columns = waiting tasks.

    A row or column without a valid edge takes no part.
    """

    valid: Tensor  # (B, N, M) bool: the row takes part, the task waits and is reachable
    closed: Tensor  # (B, N, M) bool: row and column take part, but the task is out of the row's reach
    cost: Tensor  # (B, N, M) c / s, float64, 0 where not valid
    row_rank: Tensor  # (B, N, M) int64: 0 = the cheapest task of its agent
    column_rank: Tensor  # (B, N, M) int64: 0 = the cheapest agent of its task
    rows: Tensor  # (B,) how many rows take part
    columns: Tensor  # (B,)
    may_wait: Tensor  # (B,) bool: look-ahead, and somebody is busy
    wait: Tensor  # (B, N) what no request costs, in the scale
    allowed: Tensor  # (B, N, M + 1) bool: valid actions
    ages_rounds: Tensor  # (B, N)
    busy: Tensor  # (B, N) bool


@dataclass(frozen=True, slots=True, eq=False)
class SeenEdges(PolicyInputs):
    """Snapshots whose edges are worked out already."""

    edges: Edges
    features: Tensor  # as edge_features gives them


def seen_edges(inputs: PolicyInputs, settings: GraphSageSettings) -> SeenEdges:
    """Worked out now, or before by a network with the same look_ahead and wait_factor."""
    if isinstance(inputs, SeenEdges):
        return inputs
    edges = edges_of(inputs, settings)
    arrays = {field.name: getattr(inputs, field.name) for field in fields(PolicyInputs)}
    return SeenEdges(**arrays, edges=edges, features=edge_features(edges))


def edges_of(inputs: PolicyInputs, settings: GraphSageSettings) -> Edges:
    """Costs in float64: the head divides their differences by small temperatures."""
    promised = inputs.busy & ~inputs.available & settings.look_ahead
    taking_part = (inputs.available | promised) & inputs.present
    valid = inputs.reachable & taking_part[:, :, None] & inputs.waiting[:, None, :]
    codes = inputs.costs_q.float() + inputs.jitter
    raw = torch.square(codes * FRACTION).masked_fill(~valid, _INFINITE)
    cost = raw.double() / cost_scale(raw.double())[:, None, None]
    row_rank, column_rank = _ranks(raw, 2), _ranks(raw, 1)
    row_in, column_in = valid.any(dim=2), valid.any(dim=1)
    rows, columns = row_in.sum(dim=1), column_in.sum(dim=1)
    closed = row_in[:, :, None] & column_in[:, None, :] & ~valid
    may_wait = (promised & row_in).any(dim=1)
    spare = (rows > columns)[:, None] | closed.any(dim=2)
    first = ((column_rank == 0) & valid).any(dim=2)
    eligible = valid & inputs.available[:, :, None]
    may_rest = ~eligible.any(dim=2) | may_wait[:, None] | (spare & ~first)
    return Edges(
        valid=valid,
        closed=closed,
        cost=cost.masked_fill(~valid, 0.0),
        row_rank=row_rank,
        column_rank=column_rank,
        rows=rows,
        columns=columns,
        may_wait=may_wait,
        wait=_wait(cost, row_in & inputs.available, column_in, settings.wait_factor),
        allowed=torch.cat([may_rest[..., None], eligible], dim=2),
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
    scale = means.sum(dim=1) / rows.clamp(min=1)
    return torch.where(rows > 0, scale.clamp(min=LEAST_SCALE), 1.0)


def _wait(cost: Tensor, own: Tensor, column_in: Tensor, factor: float) -> Tensor:
    """(B, N) factor times the mean soonest arrival, as the core's look_ahead has it. For an available agent
    (own) no less than its cheapest task: it stays only where that one is promised to another."""
    soonest = cost.amin(dim=1).masked_fill(~column_in, 0.0)
    wait = factor * soonest.sum(dim=1) / column_in.sum(dim=1).clamp(min=1)
    own_least = cost.amin(dim=2).masked_fill(~own, 0.0)
    return torch.maximum(wait[:, None], own_least) + WAIT_EXTRA


def edge_features(edges: Edges) -> Tensor:
    """(FEATURES, B, N, M) float32; 0 where not valid."""
    cost = edges.cost.float().masked_fill(~edges.valid, _INFINITE)
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
    return torch.stack([plane.expand_as(cost) for plane in planes]).masked_fill(~edges.valid, 0.0)


def _ranks(cost: Tensor, dim: int) -> Tensor:
    return cost.argsort(dim=dim, stable=True).argsort(dim=dim)


def _least_and_other(cost: Tensor, rank: Tensor, dim: int) -> tuple[Tensor, Tensor]:
    """The smallest cost along dim, and for every edge the smallest of the others (inf where it is alone)."""
    least = cost.amin(dim=dim, keepdim=True)
    second = cost.masked_fill(rank == 0, _INFINITE).amin(dim=dim, keepdim=True)
    return least, torch.where(rank == 0, second, least)
