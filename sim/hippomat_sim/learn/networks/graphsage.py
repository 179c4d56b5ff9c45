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
from hippomat_sim.learn.networks.edges import Edges, edge_features, edges_of
from hippomat_sim.learn.networks.head import NOTHING, net_offers
from hippomat_sim.learn.networks.inputs import PolicyInputs
from hippomat_sim.learn.networks.masks import masked
from hippomat_sim.learn.networks.network import PolicyNetwork


class Hop(nn.Module):
    """e + MLP [e, q, log-softmax of q over the row, over the column], q = one number per head."""

    def __init__(self, settings: GraphSageSettings) -> None:
        super().__init__()
        self.query = nn.Linear(settings.width, settings.heads)
        self.mix = nn.Linear(settings.width + 3 * settings.heads, settings.hidden)
        self.out = nn.Linear(settings.hidden, settings.width)

    def forward(self, e: Tensor, valid: Tensor | None) -> Tensor:
        """e: (B, N, M, width)  valid: (B, N, M, 1); None = all are, which saves the masks."""
        q = self.query(e)
        held = q if valid is None else q.masked_fill(~valid, NOTHING)
        shares = [torch.log_softmax(held, dim).clamp(min=WEAKEST_SHARE) for dim in (2, 1)]
        if valid is not None:
            invalid = ~valid
            shares = [share.masked_fill(invalid, WEAKEST_SHARE) for share in shares]
        shares = [share * SHARE_SIZE for share in shares]
        heard: Tensor = self.out(torch.relu(self.mix(torch.cat([e, q, *shares], dim=3))))
        return e + heard


class GraphSageNetwork(PolicyNetwork):
    network = "graphsage"
    training_only = "value_"

    def __init__(self, settings: GraphSageSettings | None = None) -> None:
        super().__init__()
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

    def embeddings(self, edges: Edges) -> Tensor:
        """(B, N, M, width) of every edge; meaningless where the edge is not valid."""
        e: Tensor = self.edge_out(torch.relu(self.edge_in(edge_features(edges).to(self.out.weight.dtype))))
        valid = None if bool(edges.valid.all()) else edges.valid[..., None]
        for hop in self.hops:
            e = hop(e, valid)
        return e

    def evaluate(self, inputs: PolicyInputs) -> tuple[Tensor, Tensor]:
        edges = edges_of(inputs, self.settings)
        e = self.embeddings(edges)
        return self._logits(edges, e), self._values(edges, e)

    def forward(self, inputs: PolicyInputs) -> Tensor:
        edges = edges_of(inputs, self.settings)
        return self._logits(edges, self.embeddings(edges))

    def _logits(self, edges: Edges, e: Tensor) -> Tensor:
        return self._with_head(edges, e, self.settings) if self.settings.head else self._alone(edges, e)

    def evaluate_both(self, inputs: PolicyInputs, head: GraphSageSettings) -> tuple[Tensor, Tensor]:
        """Logits of the learned part alone and with a head of these settings; what they share runs once."""
        edges = edges_of(inputs, head)
        e = self.embeddings(edges)
        return self._alone(edges, e), self._with_head(edges, e, head)

    def _alone(self, edges: Edges, e: Tensor) -> Tensor:
        score = self.out(e)[..., 0]
        offers = torch.cat([-edges.wait[..., None], score - edges.cost], dim=2)
        return masked(offers.to(e.dtype), edges.allowed)

    def _with_head(self, edges: Edges, e: Tensor, settings: GraphSageSettings) -> Tensor:
        out = self.out(e)
        weights = torch.softmax(out[..., 2].masked_fill(~edges.valid, NOTHING), dim=1)
        first_prices = PRICE_SIZE * (weights * out[..., 1]).sum(dim=1)
        offers = net_offers(edges, first_prices, settings).masked_fill(~edges.allowed, NOTHING)
        behind = (offers - offers.amax(dim=2, keepdim=True)) / settings.head_temperature
        return masked(behind.clamp(min=-LOGIT_SPAN).to(e.dtype), edges.allowed)

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
        return twin

    def settings_dict(self) -> dict[str, Any]:
        return self.settings.as_dict()
