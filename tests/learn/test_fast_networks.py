"""The learner's compiled functions give the values and gradients of torch's own operations."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from network_samples import edge_network, mixed_batch

from hippomat_core.allocation.graphsage_settings import GraphSageSettings
from hippomat_sim.learn.networks import policy_inputs, trunk
from hippomat_sim.learn.networks.edges import SeenEdges, seen_edges
from hippomat_sim.learn.networks.graphsage import GraphSageNetwork
from hippomat_sim.learn.networks.head import fast_prices, market_of, prices

SHAPES = st.tuples(st.integers(1, 7), st.integers(1, 8), st.integers(1, 11))
SHORT = GraphSageSettings(head_steps=16, tau_first=0.1, tau_last=0.005)  # as it is cloned
SHIPPED = GraphSageSettings()


def some_edges(seed: int, shape: tuple[int, int, int]) -> SeenEdges:
    problems = mixed_batch(np.random.default_rng(seed), *shape)
    return seen_edges(policy_inputs(problems), SHIPPED)


def plainly(network: GraphSageNetwork, edges: SeenEdges) -> torch.Tensor:
    """What `learned` gives, in torch's operations."""
    said: torch.Tensor = network.out(network.embeddings(edges))
    return said.permute(3, 0, 1, 2)


def gradients(network: GraphSageNetwork, said: torch.Tensor, weights: torch.Tensor) -> list[torch.Tensor]:
    used = [value for name, value in network.named_parameters() if not name.startswith("value_")]
    return list(torch.autograd.grad((said * weights).sum(), used))


@given(st.integers(0, 10_000), SHAPES, st.integers(0, 3))
@settings(max_examples=60, deadline=None)
def test_the_hops_are_those_of_torch(seed: int, shape: tuple[int, int, int], hops: int) -> None:
    network, edges = edge_network(seed, hops=hops), some_edges(seed, shape)
    valid = edges.edges.valid.expand(3, -1, -1, -1)
    torch.testing.assert_close(
        network.learned(edges)[valid].double(),
        plainly(network.with_settings().double(), edges)[valid],
        rtol=1e-4,
        atol=1e-5,
    )


@given(st.integers(0, 10_000), SHAPES)
@settings(max_examples=40, deadline=None)
def test_the_gradients_of_the_hops_are_those_of_torch(seed: int, shape: tuple[int, int, int]) -> None:
    network, edges = edge_network(seed, hops=2), some_edges(seed, shape)
    weights = torch.randn(3, *shape, generator=torch.Generator().manual_seed(seed)) * edges.edges.valid
    fast = gradients(network, network.learned(edges), weights)
    exact = network.with_settings().double()
    for one, other in zip(fast, gradients(exact, plainly(exact, edges), weights), strict=True):
        scale = float(other.abs().max()) + 1e-3
        torch.testing.assert_close(one.double() / scale, other / scale, rtol=0.0, atol=1e-4)


@pytest.mark.parametrize("block_edges", [1, 50, 10_000])
def test_the_size_of_a_block_does_not_matter(block_edges: int) -> None:
    network, edges = edge_network(3), some_edges(3, (9, 4, 6))
    weights = torch.randn(3, 9, 4, 6, generator=torch.Generator().manual_seed(3))
    said = network.learned(edges)
    expected = gradients(network, said, weights)
    with patch.object(trunk, "_BLOCK_EDGES", block_edges):
        again = network.learned(edges)
        found = gradients(network, again, weights)
    torch.testing.assert_close(again, said)
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-4)


@given(st.integers(0, 10_000), SHAPES, st.sampled_from([SHORT, SHIPPED, replace(SHORT, relaxation=1.0)]))
@settings(max_examples=60, deadline=None)
def test_the_heads_prices_and_their_gradient_are_those_of_torch(
    seed: int, shape: tuple[int, int, int], head: GraphSageSettings
) -> None:
    market = market_of(some_edges(seed, shape).edges)
    random = torch.Generator().manual_seed(seed)
    first = torch.randn(shape[0], shape[2] + 1, generator=random, dtype=torch.float64).requires_grad_()
    weights = torch.randn(first.shape, generator=random, dtype=torch.float64)
    fast, plain = fast_prices(market, first, head), prices(market, first, head)
    torch.testing.assert_close(fast, plain, rtol=1e-6, atol=1e-6)
    (by_fast,) = torch.autograd.grad((fast * weights).sum(), first)
    (by_plain,) = torch.autograd.grad((plain * weights).sum(), first)
    scale = float(by_plain.abs().max()) + 1.0  # over-relaxed steps multiply gradients where nothing settles
    torch.testing.assert_close(by_fast / scale, by_plain / scale, rtol=0.0, atol=1e-5)


def test_no_snapshots_give_no_gradient() -> None:
    network = edge_network(hops=1)
    none = seen_edges(policy_inputs(mixed_batch(np.random.default_rng(0), 2, 3, 4))[:0], network.settings)
    said = network.learned(none)
    assert said.shape == (3, 0, 3, 4)
    assert not any(part.any() for part in gradients(network, said, torch.zeros_like(said)))
