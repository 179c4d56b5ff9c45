"""The paper's network: z_i = tanh(W x_i + sum over j != i of W' x_j) in R^6, policy and value MLPs 2 x 128.

Source: HIPPO-MAT, sections on the graph network and on the network architecture. The paper states both z_i
and [x_i, z_i] as the policy's input; `policy_input` says which. The core's paper_network runs what is
exported.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from hippomat_core.allocation.paper_network import EMBEDDING, HIDDEN, KEYS
from hippomat_core.errors import ConfigError
from hippomat_sim.learn.networks.inputs import PolicyInputs
from hippomat_sim.learn.networks.layers import AgentLinear, AgentMlp
from hippomat_sim.learn.networks.masks import masked, valid_actions
from hippomat_sim.learn.networks.network import PolicyNetwork, exported


class PaperNetwork(PolicyNetwork):
    """independent: every agent has weights of its own, as in the paper; else one set for all.

    neighbours: False leaves W' out (the ablation without GraphSAGE); exported, its W' is zero.
    """

    network = "paper_network"

    def __init__(
        self,
        agents: int,
        tasks: int,
        policy_input: str = "z",
        independent: bool = True,
        neighbours: bool = True,
    ) -> None:
        super().__init__()
        if policy_input not in ("z", "xz"):
            raise ConfigError(f"policy_input = {policy_input!r} is unknown; known: 'z', 'xz'")
        self.agents, self.tasks, self.policy_input = agents, tasks, policy_input
        self.independent, self.neighbours = independent, neighbours
        groups, observation = (agents if independent else 1), 1 + 2 * tasks
        wide = EMBEDDING + (observation if policy_input == "xz" else 0)
        self.self_layer = AgentLinear(groups, observation, EMBEDDING, bias=False)
        self.neighbour_layer = AgentLinear(groups, observation, EMBEDDING, bias=False) if neighbours else None
        self.policy = AgentMlp(groups, wide, HIDDEN, tasks + 1, gain=0.01)  # begins near even odds
        self.value = AgentMlp(groups, wide, HIDDEN, 1)

    def embeddings(self, x: Tensor) -> Tensor:
        """z_i with agent i's own W and W', (B, N, 6). x: (B, N, 1 + 2M)."""
        z = self.self_layer(x)
        if self.neighbour_layer is not None:
            z = z + self.neighbour_layer(x.sum(dim=1, keepdim=True) - x)
        return torch.tanh(z)

    def evaluate(self, inputs: PolicyInputs) -> tuple[Tensor, Tensor]:
        x = inputs.observations()
        z = self.embeddings(x)
        seen = torch.cat([x, z], dim=2) if self.policy_input == "xz" else z
        return masked(self.policy(seen), valid_actions(inputs)), self.value(seen)[:, :, 0]

    def evaluate_own(self, inputs: PolicyInputs, snapshots: Tensor, agents: Tensor) -> tuple[Tensor, Tensor]:
        """As of every network; with shared weights the large layers see the chosen agents alone."""
        if self.independent:
            return super().evaluate_own(inputs, snapshots, agents)
        x = inputs.observations()
        z = self.embeddings(x)
        seen = (torch.cat([x, z], dim=2) if self.policy_input == "xz" else z)[snapshots, agents][:, None]
        logits = masked(self.policy(seen)[:, 0], valid_actions(inputs)[snapshots, agents])
        return logits, self.value(seen)[:, 0, 0]

    def settings_dict(self) -> dict[str, Any]:
        names = ("policy_input", "independent", "neighbours")
        return {name: getattr(self, name) for name in names}

    def to_tensors(self) -> dict[str, Tensor]:
        tensors = {key: exported(value) for key, value in self._by_key().items()}
        if self.neighbour_layer is None:
            tensors["sage.neighbour.weight"] = torch.zeros_like(tensors["sage.self.weight"])
        return tensors if self.independent else {key: value[0] for key, value in tensors.items()}

    @torch.no_grad()
    def load_tensors(self, tensors: dict[str, Tensor]) -> None:
        for key, parameter in self._by_key().items():
            parameter.copy_(tensors[key] if self.independent else tensors[key][None])

    def _by_key(self) -> dict[str, Tensor]:
        sage = [self.self_layer.weight]
        sage += [] if self.neighbour_layer is None else [self.neighbour_layer.weight]
        keys = KEYS[:2] if self.neighbour_layer is not None else KEYS[:1]
        policy = [tensor for layer in self.policy.layers for tensor in (layer.weight, layer.bias)]
        return dict(zip((*keys, *KEYS[2:]), (*sage, *policy), strict=True))
