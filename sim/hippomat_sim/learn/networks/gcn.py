"""MAPPO + GCN, the paper's centralised peer: a mean-normalised graph convolution and a critic that sees all
x.

H' = relu(A_n H W), A_n = D^-1/2 (A + I) D^-1/2 (Kipf and Welling 2017). The agents that are present form a
complete graph, so every entry of A_n is 1 / count: the convolution is the mean over all of them, one
embedding for the whole fleet. The policy sees it beside x_i. Weights are shared (Yu et al. 2022, MAPPO).
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from hippomat_core.allocation.paper_network import HIDDEN
from hippomat_sim.learn.networks.inputs import PolicyInputs
from hippomat_sim.learn.networks.layers import AgentMlp
from hippomat_sim.learn.networks.masks import masked, valid_actions
from hippomat_sim.learn.networks.network import PolicyNetwork


class GcnNetwork(PolicyNetwork):
    """The critic takes the concatenated x of all agents: built for one N and one M."""

    network = "gcn"
    training_only = "critic."

    def __init__(self, agents: int, tasks: int, embedding: int = 64) -> None:
        super().__init__()
        self.agents, self.tasks, self.embedding = agents, tasks, embedding
        observation = 1 + 2 * tasks
        self.convolution = nn.Linear(observation, embedding)
        self.policy = AgentMlp(1, observation + embedding, HIDDEN, tasks + 1, gain=0.01)
        self.critic = AgentMlp(1, agents * observation, HIDDEN, 1)

    def embeddings(self, inputs: PolicyInputs) -> Tensor:
        """The fleet's embedding, the same for every agent, (B, N, embedding)."""
        x, present = inputs.observations(), inputs.present.float()[:, :, None]
        mean = x.sum(dim=1, keepdim=True) / present.sum(dim=1, keepdim=True).clamp(min=1.0)
        return torch.relu(self.convolution(mean)).expand(-1, x.shape[1], -1)

    def evaluate(self, inputs: PolicyInputs) -> tuple[Tensor, Tensor]:
        seen = torch.cat([inputs.observations(), self.embeddings(inputs)], dim=2)
        return masked(self.policy(seen), valid_actions(inputs)), self.values(inputs)

    def values(self, inputs: PolicyInputs) -> Tensor:
        """(B, N): one value of the whole state, the same for every agent."""
        whole = inputs.observations().flatten(1)[:, None, :]
        value: Tensor = self.critic(whole)[:, :, 0]
        return value.expand(-1, self.agents)

    def settings_dict(self) -> dict[str, Any]:
        return {"embedding": self.embedding}
