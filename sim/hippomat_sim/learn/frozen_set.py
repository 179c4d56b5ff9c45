"""How a policy does while it trains: one-shot problems that never change, in the worlds it trains in.

The tables are made in other worlds. Figures per fleet size, in percent:

cf1 = tasks requested by exactly one agent in the first round; gap = total travel time over Hungarian's after
losers have asked again. alone_cf1, alone_gap: the learned part of a network with a head, without the head.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from hippomat_sim.learn.evaluation import play_one_shot, play_optimum
from hippomat_sim.learn.instances import Instances, draw_instances
from hippomat_sim.learn.methods import BatchMethod, Method
from hippomat_sim.learn.networks import PolicyNetwork, policy_inputs
from hippomat_sim.learn.networks.graphsage import GraphSageNetwork
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.world_pool import WorldPool

Evaluation = dict[str, dict[str, float]]  # fleet size -> figure -> percent

_SEED = 20_250_101


class FrozenSet:
    """tasks: of every problem; 0 = as many as agents. The optimum is found once, when it is first needed."""

    def __init__(self, pool: WorldPool, sizes: tuple[int, ...], tasks: int, episodes: int) -> None:
        self._instances = {
            agents: draw_instances(pool, episodes, agents, tasks or agents, _SEED) for agents in sizes
        }
        self._least_ms: dict[int, int] = {}

    def play(self, network: PolicyNetwork, device: torch.device) -> Evaluation:
        """Every agent takes its most probable action."""
        ways = {"": network}
        if isinstance(network, GraphSageNetwork) and network.settings.head:
            ways["alone_"] = network.with_settings(head=False).to(device)
        return {
            str(agents): {
                prefix + name: figure
                for prefix, way in ways.items()
                for name, figure in self._figures(agents, instances, most_probable(way, device)).items()
            }
            for agents, instances in self._instances.items()
        }

    def _figures(self, agents: int, instances: Instances, method: Method) -> dict[str, float]:
        if agents not in self._least_ms:
            self._least_ms[agents] = int(play_optimum(instances)["cost_ms"].sum())
        played = play_one_shot(method, instances)
        at_most = min(instances.costs_q.shape[1:]) * len(instances)
        least_ms = self._least_ms[agents]
        return {
            "cf1": 100.0 * int(played["single"].sum()) / at_most,
            "gap": 100.0 * (int(played["cost_ms"].sum()) - least_ms) / max(least_ms, 1),
        }


def most_probable(network: PolicyNetwork, device: torch.device) -> Method:
    """The network as a method of evaluation."""

    @torch.no_grad()
    def decide(problems: ProblemBatch) -> NDArray[np.int64]:
        actions: NDArray[np.int64] = network(policy_inputs(problems, device)).argmax(dim=2).cpu().numpy()
        return actions

    return BatchMethod(decide, fingerprint="")
