"""Ours: a bipartite GraphSAGE over agent-task edges with a head of annealed potentials. One set of weights
for any N, M and mix of vehicles; permuting agents or tasks permutes the output.

Every edge (i, j) has an embedding. A hop lets it hear its row and its column through attention heads
(log-softmax over both) and adds a residual. Three numbers come out of every edge:

- its score: without the head, the policy is a softmax over score - cost (the learned part alone);
- a price and a weight: pooled over a task's agents, the task's price from which the head begins (head.py).
  The head alone decides where it ends, so a learned price saves steps and cannot lead it astray.

All three begin at zero: untrained, the network is the pure head. Costs count in the snapshot's own scale, so
the fleet's c_max does not matter.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor, nn

from hippomat_core.allocation.graphsage_settings import (
    AGE,
    FEATURES,
    LOGIT_SPAN,
    PRICE_SIZE,
    SHARE_SIZE,
    WEAKEST_SHARE,
    GraphSageSettings,
)
from hippomat_sim.learn.networks.edges import Edges, SeenEdges, seen_edges
from hippomat_sim.learn.networks.head import NOTHING, net_offers
from hippomat_sim.learn.networks.inputs import PolicyInputs
from hippomat_sim.learn.networks.masks import masked
from hippomat_sim.learn.networks.network import PolicyNetwork
from hippomat_sim.learn.networks.trunk import TrunkMatrices, run_trunk


class Hop(nn.Module):
    """e + MLP [e, q, log-softmax of q over the row, over the column], q = one number per head."""

    def __init__(self, settings: GraphSageSettings) -> None:
        super().__init__()
        self.query = nn.Linear(settings.width, settings.heads)
        self.mix = nn.Linear(settings.width + 3 * settings.heads, settings.hidden)
        self.out = nn.Linear(settings.hidden, settings.width)

    def forward(self, e: Tensor, valid: Tensor) -> Tensor:
        """e: (B, N, M, width)  valid: (B, N, M, 1)."""
        q = self.query(e)
        held = q.masked_fill(~valid, NOTHING)
        shares = [self._share(held, valid, dim) for dim in (2, 1)]
        heard: Tensor = self.out(torch.relu(self.mix(torch.cat([e, q, *shares], dim=3))))
        return e + heard

    @staticmethod
    def _share(q: Tensor, valid: Tensor, dim: int) -> Tensor:
        share = torch.log_softmax(q, dim).clamp(min=WEAKEST_SHARE)
        return share.masked_fill(~valid, WEAKEST_SHARE) * SHARE_SIZE

    def matrices(self) -> tuple[Tensor, Tensor, Tensor]:
        """As run_trunk takes them."""
        mix, width = _matrix(self.mix), self.query.in_features
        turned = torch.cat([mix[:, width:-1], mix[:, :width], mix[:, -1:]], dim=1)
        return _matrix(self.query), turned, _matrix(self.out)


def _matrix(layer: nn.Linear) -> Tensor:
    """(out, in + 1), the bias last."""
    return torch.cat([layer.weight, layer.bias[:, None]], dim=1)


class GraphSageNetwork(PolicyNetwork):
    """compiled: on a CPU in float32 the head (head.py) and, where no value is asked for, the hops (trunk.py)
    go through compiled functions, which give the same; False: torch's operations alone."""

    network = "graphsage"
    training_only = "value_"

    def __init__(self, settings: GraphSageSettings | None = None) -> None:
        super().__init__()
        self.compiled = True
        self.settings = settings or GraphSageSettings()
        width, hidden = self.settings.width, self.settings.hidden
        self.edge_in = nn.Linear(FEATURES, hidden)
        self.edge_out = nn.Linear(hidden, width)
        self.hops = nn.ModuleList(Hop(self.settings) for _ in range(self.settings.hops))
        self.out = nn.Linear(width, 3)  # score, price, weight of the price
        self.value_in = nn.Linear(3 * width, hidden)
        self.value_out = nn.Linear(hidden, 1)
        with torch.no_grad():  # what training without losses never shows has to say nothing
            self.edge_in.weight[:, AGE] = 0.0
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def prepared(self, inputs: PolicyInputs) -> PolicyInputs:
        return seen_edges(inputs, self.settings)

    def embeddings(self, seen: SeenEdges) -> Tensor:
        """(B, N, M, width) of every edge; meaningless where the edge is not valid."""
        features = seen.features.permute(1, 2, 3, 0).to(self.out.weight.dtype)
        e: Tensor = self.edge_out(torch.relu(self.edge_in(features)))
        for hop in self.hops:
            e = hop(e, seen.edges.valid[..., None])
        return e

    def learned(self, seen: SeenEdges) -> Tensor:
        """(3, B, N, M): score, price and weight of every edge."""
        if self._runs_compiled:
            valid = seen.edges.valid
            return run_trunk(self._matrices(), seen.features, None if bool(valid.all()) else valid)
        return self._said(self.embeddings(seen))

    @property
    def _runs_compiled(self) -> bool:
        weight = self.out.weight
        return self.compiled and weight.device.type == "cpu" and weight.dtype == torch.float32

    def _said(self, e: Tensor) -> Tensor:
        said: Tensor = self.out(e)
        return said.permute(3, 0, 1, 2)

    def _matrices(self) -> TrunkMatrices:
        hops = tuple(hop.matrices() for hop in self.hops if isinstance(hop, Hop))
        return TrunkMatrices(_matrix(self.edge_in), _matrix(self.edge_out), hops, _matrix(self.out))

    def evaluate(self, inputs: PolicyInputs) -> tuple[Tensor, Tensor]:
        seen = seen_edges(inputs, self.settings)
        e = self.embeddings(seen)
        return self._logits(seen.edges, self._said(e)), self._values(seen.edges, e)

    def forward(self, inputs: PolicyInputs) -> Tensor:
        seen = seen_edges(inputs, self.settings)
        return self._logits(seen.edges, self.learned(seen))

    def evaluate_both(self, inputs: PolicyInputs, head: GraphSageSettings) -> tuple[Tensor, Tensor]:
        """Logits of the learned part alone and with a head of these settings; what they share runs once."""
        seen = seen_edges(inputs, self.settings)
        learned = self.learned(seen)
        return self._alone(seen.edges, learned), self._with_head(seen.edges, learned, head)

    def _logits(self, edges: Edges, learned: Tensor) -> Tensor:
        if self.settings.head:
            return self._with_head(edges, learned, self.settings)
        return self._alone(edges, learned)

    def _alone(self, edges: Edges, learned: Tensor) -> Tensor:
        offers = torch.cat([-edges.wait[..., None], learned[0] - edges.cost], dim=2)
        return masked(offers.to(learned.dtype), edges.allowed)

    def _with_head(self, edges: Edges, learned: Tensor, settings: GraphSageSettings) -> Tensor:
        weights = torch.softmax(learned[2].masked_fill(~edges.valid, NOTHING), dim=1)
        first_prices = PRICE_SIZE * (weights * learned[1]).sum(dim=1)
        offers = net_offers(edges, first_prices, settings, self._runs_compiled)
        offers = offers.masked_fill(~edges.allowed, NOTHING)
        behind = (offers - offers.amax(dim=2, keepdim=True)) / settings.head_temperature
        return masked(behind.clamp(min=-LOGIT_SPAN).to(learned.dtype), edges.allowed)

    def _values(self, edges: Edges, e: Tensor) -> Tensor:
        """(B, N) from the row's mean edge, its cheapest edges and the mean of all edges."""
        valid = edges.valid[..., None].to(e.dtype)
        whole = (e * valid).sum((1, 2)) / valid.sum((1, 2)).clamp(min=1.0)
        row = (e * valid).sum(2) / valid.sum(2).clamp(min=1.0)
        nearness = (-edges.cost).to(e.dtype).masked_fill(~edges.valid, NOTHING)
        near = torch.softmax(nearness, dim=2)[..., None] * valid
        seen = torch.cat([row, (e * near).sum(2), whole[:, None].expand_as(row)], dim=2)
        value: Tensor = self.value_out(torch.relu(self.value_in(seen)))
        return value[..., 0]

    def with_settings(self, **changes: Any) -> GraphSageNetwork:
        """The same weights with other settings of the head, look-ahead or temperature; shares no tensor."""
        twin = GraphSageNetwork(replace(self.settings, **changes))
        twin.load_state_dict(self.state_dict())
        twin.compiled = self.compiled
        return twin

    def settings_dict(self) -> dict[str, Any]:
        return self.settings.as_dict()
