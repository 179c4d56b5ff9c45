"""Policies in torch as methods of the tables: those that no robot runs. Knows no run and no directory."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from hippomat_core.allocation.policy_file import read_policy
from hippomat_sim.learn.methods import BatchMethod
from hippomat_sim.learn.networks import make_network, policy_inputs
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.runs import Fleet

_EDGES = 100_000  # agent-task pairs at once: what fits the caches


def torch_method(policy: bytes, fleet: Fleet) -> BatchMethod:
    """Every agent takes its most probable action. policy: a policy file's bytes."""
    file = read_policy(policy)
    network = make_network(file.network, file.settings, fleet.agents, fleet.tasks)
    network.load_tensors({name: torch.from_numpy(array) for name, array in file.tensors.items()})
    network.eval()

    @torch.no_grad()
    def decide(problems: ProblemBatch) -> NDArray[np.int64]:
        rows = max(1, _EDGES // (fleet.agents * fleet.tasks))
        parts = [
            network(policy_inputs(problems.take(np.arange(start, min(start + rows, len(problems))))))
            for start in range(0, len(problems), rows)
        ]
        return torch.cat(parts).argmax(dim=2).numpy()

    return BatchMethod(decide, file.hash)
