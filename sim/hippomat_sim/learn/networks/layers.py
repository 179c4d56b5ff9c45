"""Layers that hold one set of weights per agent, or one for all: W has a leading axis of N or of 1."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn


class AgentLinear(nn.Module):
    """y_i = W_i x_i + b_i. weight: (G, out, in)  bias: (G, out), G = N (independent) or 1 (shared).

    Initialised like torch.nn.Linear, every agent's own; `gain` scales the weights.
    """

    def __init__(self, groups: int, inputs: int, outputs: int, bias: bool = True, gain: float = 1.0) -> None:
        super().__init__()
        bound = 1.0 / math.sqrt(inputs)
        self.weight = nn.Parameter(torch.empty(groups, outputs, inputs).uniform_(-bound, bound) * gain)
        self.bias = (
            nn.Parameter(torch.empty(groups, outputs).uniform_(-bound, bound) * gain) if bias else None
        )

    def forward(self, x: Tensor) -> Tensor:
        """(B, N, in) -> (B, N, out)."""
        if self.weight.shape[0] == 1:
            return nn.functional.linear(x, self.weight[0], None if self.bias is None else self.bias[0])
        y = torch.einsum("bni,noi->bno", x, self.weight)
        return y if self.bias is None else y + self.bias


class AgentMlp(nn.Module):
    """Two hidden layers with ReLU and a linear output (the paper's policy and value networks)."""

    def __init__(self, groups: int, inputs: int, hidden: int, outputs: int, gain: float = 1.0) -> None:
        super().__init__()
        sizes = (inputs, hidden, hidden, outputs)
        gains = (1.0, 1.0, gain)
        self.layers = nn.ModuleList(
            AgentLinear(groups, a, b, gain=g) for a, b, g in zip(sizes[:-1], sizes[1:], gains, strict=True)
        )

    def forward(self, x: Tensor) -> Tensor:
        for layer in self.layers[:-1]:
            x = torch.relu(layer(x))
        y: Tensor = self.layers[-1](x)
        return y
