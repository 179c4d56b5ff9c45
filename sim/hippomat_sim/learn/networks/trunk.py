"""The edge network's hops for many snapshots at once, fast on a CPU: one function of autograd with a backward
of its own.

It computes what `GraphSageNetwork.learned` says in torch's operations, block by block of snapshots: products
by torch, what lies between them compiled (trunk_kernels.py). A plane is one number of every edge of a block,
(N, M, B) with the snapshots innermost; a layer's bias is its matrix's last column, times a plane of ones.
float32; features get no gradient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import once_differentiable

from hippomat_sim.learn.networks.trunk_kernels import NOTHING, relu_backward, shares_backward, shares_forward

_BLOCK_EDGES = 6_000  # about 10 MB with all that the way back needs; smaller ones cost more calls

Planes = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class TrunkMatrices:
    """(out, in + 1) of every layer, the bias last; a hop's: query, mix, out.

    mix takes queries, row shares, column shares, embedding, one, in this order.
    """

    edge_in: Tensor
    edge_out: Tensor
    hops: tuple[tuple[Tensor, Tensor, Tensor], ...]
    out: Tensor

    def flat(self) -> list[Tensor]:
        return [self.edge_in, self.edge_out, *(matrix for hop in self.hops for matrix in hop), self.out]


def run_trunk(matrices: TrunkMatrices, features: Tensor, valid: Tensor | None) -> Tensor:
    """(3, B, N, M): score, price and weight of the price of every edge.

    features: (FEATURES, B, N, M) float32  valid: (B, N, M) bool; None = all are
    """
    learned: Tensor = _Trunk.apply(features, valid, *matrices.flat())  # type: ignore[no-untyped-call]
    return learned


class _Trunk(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, features: Tensor, valid: Tensor | None, *layers: Tensor) -> Tensor:
        planes, count, agents, tasks = features.shape
        outputs = layers[-1].shape[0]
        learned = features.new_empty(outputs, count, agents, tasks)
        size = max(1, _BLOCK_EDGES // (agents * tasks))
        learns, kept = any(ctx.needs_input_grad), []
        for first in range(0, count, size):
            some = slice(first, min(first + size, count))
            x = features.new_ones(planes + 1, agents, tasks, some.stop - first)
            x[:-1] = features[:, some].permute(0, 2, 3, 1)
            closed = None if valid is None else ~valid[some].permute(1, 2, 0)
            block = _Block(x, closed, layers)
            learned[:, some] = block.forward().permute(0, 3, 1, 2)
            if learns:
                kept.append((some, block))
        ctx.kept, ctx.layers = kept, layers
        return learned

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *by_outputs: Tensor) -> Any:
        (by_learned,) = by_outputs
        gradients = [torch.zeros_like(layer) for layer in ctx.layers]
        for some, block in ctx.kept:
            block.backward(by_learned[:, some].permute(0, 2, 3, 1).contiguous(), gradients)
        return (None, None, *gradients)


class _Block:
    """Snapshots that go through all layers together, and what the way back needs of them."""

    def __init__(self, x: Tensor, closed: Tensor | None, layers: Sequence[Tensor]) -> None:
        self.layers, self.shape = layers, x.shape[1:]
        self.x, self.closed = x.flatten(1), closed
        self.hops = [_Hop(self, layers[at : at + 3]) for at in range(2, len(layers) - 1, 3)]
        hidden, width = layers[0].shape[0], layers[1].shape[0]
        self.hidden = self.ones(hidden)
        self.last = self.ones(width)

    def ones(self, planes: int) -> Tensor:
        """So many planes to be filled, and one of ones behind them."""
        made = self.x.new_empty(planes + 1, self.x.shape[1])
        made[-1] = 1.0
        return made

    def forward(self) -> Tensor:
        """(3, N, M, B)."""
        inputs = [hop.embedding for hop in self.hops] + [self.last]
        torch.mm(self.layers[0], self.x, out=self.hidden[:-1])
        self.hidden[:-1].relu_()
        torch.mm(self.layers[1], self.hidden, out=inputs[0][:-1])
        for hop, following in zip(self.hops, inputs[1:], strict=True):
            hop.forward(following[:-1])
        return torch.mm(self.layers[-1], self.last).view(-1, *self.shape)

    def backward(self, by_learned: Tensor, gradients: list[Tensor]) -> None:
        """Adds to the gradients, one for every layer. by_learned: (3, N, M, B)."""
        by_out = by_learned.flatten(1)
        gradients[-1].addmm_(by_out, self.last.T)
        by_e = self.layers[-1][:, :-1].T @ by_out
        for at in range(len(self.hops) - 1, -1, -1):
            self.hops[at].backward(by_e, gradients[2 + 3 * at : 5 + 3 * at])
        by_hidden = _through_perceptron(self.layers[1], by_e, self.hidden, gradients[1])
        gradients[0].addmm_(by_hidden, self.x.T)


class _Hop:
    """e + out relu(mix [q, shares of q, e]), q = query e."""

    def __init__(self, block: _Block, layers: Sequence[Tensor]) -> None:
        self.query, self.mix, self.out = layers
        self.shape, self.closed = block.shape, block.closed
        self.heads = self.query.shape[0]
        self.wide = block.ones(self.mix.shape[1] - 1)
        self.hidden = block.ones(self.mix.shape[0])
        agents, tasks, count = self.shape
        self.row_sums = np.empty((self.heads, agents, count), np.float32)
        self.column_sums = np.empty((self.heads, tasks, count), np.float32)

    @property
    def embedding(self) -> Tensor:
        """(width + 1, edges), with the ones."""
        return self.wide[3 * self.heads :]

    def forward(self, e_next: Tensor) -> None:
        heads = self.heads
        q = self.wide[:heads]
        torch.mm(self.query, self.embedding, out=q)
        self.held = self._planes(q if self.closed is None else self._masked(q))
        rows, columns = (
            self._planes(self.wide[heads : 2 * heads]),
            self._planes(self.wide[2 * heads : 3 * heads]),
        )
        shares_forward(self.held, self.row_sums, self.column_sums, rows, columns)
        torch.mm(self.mix, self.wide, out=self.hidden[:-1])
        self.hidden[:-1].relu_()
        torch.addmm(self.embedding[:-1], self.out, self.hidden, out=e_next)

    def backward(self, by_e: Tensor, gradients: Sequence[Tensor]) -> None:
        """by_e: (width, edges) by what the hop gave, becomes that by what it took."""
        heads = self.heads
        by_hidden = _through_perceptron(self.out, by_e, self.hidden, gradients[2])
        gradients[1].addmm_(by_hidden, self.wide.T)
        by_wide = self.mix[:, :-1].T @ by_hidden
        by_q = by_wide[:heads]
        by_rows, by_columns = self._shares(by_wide)
        shares_backward(self.held, self.row_sums, self.column_sums, by_rows, by_columns, self._planes(by_q))
        gradients[0].addmm_(by_q, self.embedding.T)
        by_e.add_(by_wide[3 * heads :]).addmm_(self.query[:, :-1].T, by_q)

    def _masked(self, q: Tensor) -> Tensor:
        assert self.closed is not None
        return q.view(self.heads, *self.shape).masked_fill(self.closed, float(NOTHING))

    def _shares(self, wide: Tensor) -> tuple[Planes, Planes]:
        """Of rows and of columns, as they lie in `wide`."""
        heads = self.heads
        return self._planes(wide[heads : 2 * heads]), self._planes(wide[2 * heads : 3 * heads])

    def _planes(self, tensor: Tensor) -> Planes:
        planes: Planes = tensor.detach().view(-1, *self.shape).numpy()
        return planes


def _through_perceptron(out: Tensor, by_result: Tensor, hidden: Tensor, gradient: Tensor) -> Tensor:
    """The gradient by what went into the relu whose result is `hidden`; adds to that of `out`."""
    gradient.addmm_(by_result, hidden.T)
    by_hidden = out[:, :-1].T @ by_result
    relu_backward(by_hidden.numpy(), hidden[:-1].numpy())
    return by_hidden
