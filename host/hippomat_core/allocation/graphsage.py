"""Allocator `graphsage`: the learned edge network with its head of potentials, or the learned part alone.

One set of weights for any N, M and mix of vehicles. Every robot that holds the snapshot decides for all
alike and acts by its own row. Trained in hippomat_sim.learn; networks/graphsage.py there says what it
computes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.graphsage_edges import Edges, edge_features, edges_of
from hippomat_core.allocation.graphsage_head import net_offers
from hippomat_core.allocation.graphsage_settings import FEATURES, LOGIT_SPAN, GraphSageSettings
from hippomat_core.allocation.graphsage_trunk import TrunkWeights, run_trunk
from hippomat_core.allocation.paper_network import MASKED_LOGIT
from hippomat_core.allocation.policy_file import PolicyFile, checked_tensors
from hippomat_core.allocation.port import Decision, Problem

Array = NDArray[np.float32]


def expected_shapes(settings: GraphSageSettings) -> dict[str, tuple[int, ...]]:
    """Shape of every tensor in the file (PyTorch's convention, weight = (out, in))."""
    width, hidden, heads = settings.width, settings.hidden, settings.heads
    layers = {"edge_in": (hidden, FEATURES), "edge_out": (width, hidden), "out": (3, width)}
    for hop in range(settings.hops):
        layers[f"hops.{hop}.query"] = (heads, width)
        layers[f"hops.{hop}.mix"] = (hidden, width + 3 * heads)
        layers[f"hops.{hop}.out"] = (width, hidden)
    shapes: dict[str, tuple[int, ...]] = {}
    for name, shape in layers.items():
        shapes[f"{name}.weight"], shapes[f"{name}.bias"] = shape, shape[:1]
    return shapes


@dataclass(frozen=True, slots=True, eq=False)
class GraphSage:
    settings: GraphSageSettings
    weights: TrunkWeights

    @property
    def name(self) -> str:
        return "graphsage"

    def logits(self, problem: Problem) -> Array:
        """(N, M + 1) of every robot; MASKED_LOGIT where not valid."""
        robots, tasks = problem.costs_q.shape
        edges = edges_of(problem, self.settings)
        logits = np.full((robots, tasks + 1), MASKED_LOGIT)
        logits[edges.may_rest, 0] = 0.0
        if len(edges.rows):
            learned = run_trunk(self.weights, self.settings, edge_features(edges, problem), edges.valid)
            self._fill(logits, edges, learned)
        if not self.settings.head:
            logits[edges.may_rest, 0] = -edges.wait[edges.may_rest]
        return logits

    def allocate(self, problem: Problem) -> Decision:
        logits = self.logits(problem)[problem.self_index]
        return Decision(int(np.argmax(logits)), logits)

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        actions: NDArray[np.int64] = np.argmax(self.logits(problem), axis=1)
        return actions

    def _fill(self, logits: Array, edges: Edges, learned: Array) -> None:
        """Writes the logits of the robots that may request."""
        if not self.settings.head:
            offers = np.where(edges.valid, learned[0] - edges.cost, MASKED_LOGIT)
            logits[np.ix_(edges.rows[edges.own], edges.columns + 1)] = offers[edges.own]
            return
        rest, offers = net_offers(edges, learned, self.settings)
        rest = np.where(edges.may_rest[edges.rows], rest, -np.inf)
        best = np.maximum(rest, offers.max(axis=1))
        scaled = (np.column_stack([rest, offers]) - best[:, None]) / self.settings.head_temperature
        allowed = np.column_stack([edges.may_rest[edges.rows], edges.valid])
        values = np.where(allowed, np.maximum(scaled, -LOGIT_SPAN), MASKED_LOGIT)
        logits[np.ix_(edges.rows[edges.own], np.append(0, edges.columns + 1))] = values[edges.own]


def load_graphsage(policy: PolicyFile) -> GraphSage:
    """The allocator of a policy file of network `graphsage`; ConfigError names what is wrong with it."""
    settings = GraphSageSettings.from_dict(policy.settings)
    tensors = checked_tensors(policy, expected_shapes(settings))

    def layer(name: str) -> Array:
        return np.column_stack([tensors[f"{name}.weight"], tensors[f"{name}.bias"]])

    def mix(hop: int) -> Array:
        """Its inputs in the order of run_trunk's planes; torch has the embedding in front."""
        matrix = layer(f"hops.{hop}.mix")
        width = settings.width
        return np.column_stack([matrix[:, width:-1], matrix[:, :width], matrix[:, -1:]])

    hops = tuple(
        (layer(f"hops.{hop}.query"), mix(hop), layer(f"hops.{hop}.out")) for hop in range(settings.hops)
    )
    return GraphSage(settings, TrunkWeights(layer("edge_in"), layer("edge_out"), hops, layer("out")))
