"""Networks: values worked out by hand, and the laws of permutation, masks and waiting."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from network_samples import edge_network, free_fleet, mixed_batch, plane_codes

from hippomat_core.allocation.graphsage_settings import GraphSageSettings
from hippomat_core.allocation.hungarian import Hungarian
from hippomat_core.allocation.look_ahead import LookAhead
from hippomat_core.allocation.paper_network import MASKED_LOGIT
from hippomat_core.errors import ConfigError
from hippomat_sim.learn.networks import PolicyInputs, PolicyNetwork, make_network, policy_inputs
from hippomat_sim.learn.networks.edges import edge_features, edges_of, seen_edges
from hippomat_sim.learn.networks.flat import PaperNetwork
from hippomat_sim.learn.networks.gcn import GcnNetwork
from hippomat_sim.learn.networks.graphsage import GraphSageNetwork, Hop
from hippomat_sim.learn.problems import ProblemBatch

KINDS = [
    ("graphsage", {}),
    ("graphsage", {"head": False}),
    ("graphsage", {"look_ahead": False, "hops": 1}),
    ("paper_network", {}),
    ("paper_network", {"policy_input": "xz", "independent": False}),
    ("paper_network", {"neighbours": False}),
    ("gcn", {}),
]


def codes(*rows: list[int]) -> ProblemBatch:
    return free_fleet(np.array([rows], np.uint8))


def without_jitter(inputs: PolicyInputs) -> PolicyInputs:
    return replace(inputs, jitter=torch.zeros_like(inputs.jitter))


def fill(parameter: torch.Tensor, values: object) -> None:
    with torch.no_grad():
        parameter.copy_(torch.as_tensor(values, dtype=torch.float32).expand_as(parameter))


# ---- inputs -------------------------------------------------------------------------------------


def test_the_observation_in_torch_is_the_cores():
    problems = mixed_batch(np.random.default_rng(1), 20, 4, 7)
    x = policy_inputs(problems).observations().numpy()
    for index in range(len(problems)):
        np.testing.assert_array_equal(x[index], problems.problem(index).observations())


def test_inputs_are_copies_because_environments_reuse_their_buffers():
    problems = codes([1, 2], [3, 4])
    inputs = policy_inputs(problems)
    problems.costs_q[:] = 9
    assert inputs.costs_q.tolist() == [[[1, 2], [3, 4]]]


# ---- the paper's network --------------------------------------------------------------------------


def paper_network_by_hand(network: PaperNetwork) -> None:
    """W adds x up, W' adds it up twice (first component of z alone); the logits are [1, -2] relu(z_0)."""
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.zero_()
        network.self_layer.weight[:, 0] = 1.0
        if network.neighbour_layer is not None:
            network.neighbour_layer.weight[:, 0] = 2.0
        first, second, last = network.policy.layers
        first.weight[:, 0, -6] = 1.0
        second.weight[:, 0, 0] = 1.0
        last.weight[:, 0, 0], last.weight[:, 1, 0] = 1.0, -2.0


@pytest.mark.parametrize("policy_input", ["z", "xz"])
@pytest.mark.parametrize("independent", [True, False])
def test_the_papers_embedding_and_policy_are_those_worked_out_by_hand(policy_input: str, independent: bool):
    network = PaperNetwork(2, 1, policy_input, independent)
    paper_network_by_hand(network)
    inputs = policy_inputs(codes([127], [254]))  # c = 2 x .25 - 1 = -.5 and 1; x = [-1, c, 1]
    own = torch.tensor([-0.5, 1.0])
    z = torch.tanh(own + 2.0 * own.flip(0))  # tanh(1.5), tanh(0)
    torch.testing.assert_close(network.embeddings(inputs.observations())[0, :, 0], z)
    torch.testing.assert_close(network(inputs)[0], torch.stack([z, -2.0 * z], 1))


def test_without_neighbours_only_the_own_row_counts():
    network = PaperNetwork(2, 1, neighbours=False)
    paper_network_by_hand(network)
    z = network.embeddings(policy_inputs(codes([127], [254])).observations())[0, :, 0]
    torch.testing.assert_close(z, torch.tanh(torch.tensor([-0.5, 1.0])))
    assert not network.to_tensors()["sage.neighbour.weight"].any()


def test_independent_agents_have_weights_of_their_own():
    network = PaperNetwork(3, 2)
    inputs = policy_inputs(codes([10, 20], [10, 20], [10, 20]))
    before = network(inputs)
    with torch.no_grad():
        network.policy.layers[2].bias[1] += 1.0
    change = (network(inputs) - before)[0]
    assert change[1].gt(0.9).all()
    assert not change[[0, 2]].any()


# ---- MAPPO + GCN ----------------------------------------------------------------------------------


def test_the_graph_convolution_is_the_mean_over_those_who_are_present():
    network = GcnNetwork(3, 1, embedding=1)
    fill(network.convolution.weight, [[0.0, 1.0, 0.0]])
    fill(network.convolution.bias, 1.0)
    problems = codes([127], [254], [0])
    problems.present[0, 2] = False
    z = network.embeddings(policy_inputs(problems))
    assert z[0, :, 0].tolist() == pytest.approx([1.25] * 3)  # relu(mean(-.5, 1) + 1)


def test_the_critic_sees_every_agent_and_gives_all_the_same_value():
    network = GcnNetwork(2, 2)
    problems = mixed_batch(np.random.default_rng(2), 6, 2, 2)
    values = network.values(policy_inputs(problems))
    assert values.shape == (6, 2)
    torch.testing.assert_close(values[:, 0], values[:, 1])
    torch.testing.assert_close(network.evaluate(policy_inputs(problems))[1], values)


# ---- ours -----------------------------------------------------------------------------------------


def test_edge_features_are_those_worked_out_by_hand():
    inputs = policy_inputs(codes([127, 254], [254, 255]))
    edges = edges_of(without_jitter(inputs), GraphSageSettings())
    scale = ((0.25 + 1.0) / 2 + 1.0) / 2  # the mean of the rows' means of their smallest costs
    np.testing.assert_allclose(edges.cost[0].numpy() * scale, [[0.25, 1.0], [1.0, 0.0]], atol=1e-7)
    near, far = 0.25 / scale, 1.0 / scale
    once = math.exp(-0.5)
    expected = [
        [near / 4, near - far, near - far, near / 4, near / 4, 1.0, 1.0, 1.0, 0.0, 0.0],
        [far / 4, -4.0, far - near, near / 4, far / 4, once, 1.0, 1.0, 0.0, 0.0],
        [far / 4, far - near, -4.0, far / 4, near / 4, 1.0, once, 1.0, 0.0, 0.0],
        [0.0] * 10,
    ]
    np.testing.assert_allclose(edge_features(edges)[:, 0].reshape(10, 4).T.numpy(), expected, atol=1e-6)


def test_a_hop_is_the_one_worked_out_by_hand():
    hop = Hop(GraphSageSettings(width=1, hidden=1, heads=1))
    for parameter in hop.parameters():
        fill(parameter, 1.0)
    fill(hop.query.bias, 0.0)
    e = torch.tensor([0.0, math.log(3.0)]).reshape(1, 1, 2, 1)
    found = hop(e, torch.ones(1, 1, 2, 1, dtype=torch.bool)).flatten()
    row = torch.log(torch.tensor([0.25, 0.75]))  # softmax over the row; a column has one edge, log 1 = 0
    expected = e.flatten() + torch.relu(2.0 * e.flatten() + 0.3 * row + 1.0) + 1.0
    torch.testing.assert_close(found, expected)


def test_the_untrained_head_gives_the_cheapest_allocation_not_the_greedy_one():
    inputs = policy_inputs(codes([100, 120], [100, 200]))  # greedy: agent 0 takes task 1, 254-units 4.0 + 1.0
    assert GraphSageNetwork()(inputs).argmax(2).tolist() == [[2, 1]]


def test_the_untrained_head_is_nearly_the_hungarian_algorithm():
    problems = free_fleet(plane_codes(np.random.default_rng(3), 40, 20, 20))
    actions = GraphSageNetwork()(policy_inputs(problems)).argmax(2).numpy()
    single = [np.count_nonzero(np.bincount(row, minlength=21)[1:] == 1) for row in actions]
    assert sum(single) >= 0.995 * 40 * 20
    hungarian = Hungarian()
    total = best = 0.0
    for index in np.flatnonzero(np.array(single) == 20):
        problem = problems.problem(int(index))
        squares = np.square(problem.costs_q.astype(float))
        total += squares[np.arange(20), actions[index] - 1].sum()
        best += squares[np.arange(20), hungarian.actions(problem) - 1].sum()
    assert total <= 1.005 * best


def test_the_learned_part_alone_scores_each_edge_less_its_cost():
    network = edge_network(head=False)
    inputs = policy_inputs(codes([100, 120], [100, 200]))
    seen = seen_edges(inputs, network.settings)
    score = network.out(network.embeddings(seen))[..., 0]
    torch.testing.assert_close(network(inputs)[:, :, 1:], (score - seen.edges.cost).float())


def test_both_readings_of_one_pass_are_those_of_two_networks():
    network = edge_network(head=False)
    head = GraphSageSettings(head_steps=16, tau_first=0.1, tau_last=0.005)
    inputs = policy_inputs(mixed_batch(np.random.default_rng(4), 12, 5, 6))
    alone, with_head = network.evaluate_both(inputs, head)
    torch.testing.assert_close(alone, network(inputs))
    torch.testing.assert_close(with_head, network.with_settings(**head.as_dict())(inputs))


@pytest.mark.parametrize("head", [True, False])
def test_permuting_agents_or_tasks_permutes_the_output(head: bool):
    random = np.random.default_rng(5)
    network = edge_network(head=head)
    for agents, tasks in ((6, 9), (9, 6), (7, 7)):
        inputs = policy_inputs(mixed_batch(random, 30, agents, tasks))
        rows, slots = torch.as_tensor(random.permutation(agents)), torch.as_tensor(random.permutation(tasks))
        logits, values = network.evaluate(inputs)
        permuted, permuted_values = network.evaluate(inputs.permuted(rows, slots))
        columns = torch.cat([torch.zeros(1, dtype=torch.long), slots + 1])
        torch.testing.assert_close(permuted, logits[:, rows][:, :, columns], atol=1e-4, rtol=1e-5)
        torch.testing.assert_close(permuted_values, values[:, rows], atol=1e-5, rtol=1e-5)


def test_costs_count_in_the_snapshots_own_scale():
    random = np.random.default_rng(6)
    inputs = policy_inputs(free_fleet(plane_codes(random, 10, 5, 5) // 2 * 2))
    half = policy_inputs(free_fleet(inputs.costs_q.numpy() // 2))  # a quarter of the costs
    network = edge_network()
    torch.testing.assert_close(
        network(without_jitter(inputs)), network(without_jitter(half)), atol=1e-3, rtol=1e-4
    )


def test_nobody_waits_while_nobody_is_busy():
    problems = mixed_batch(np.random.default_rng(7), 300, 5, 7)
    problems.available[:] |= problems.busy
    problems.busy[:] = False
    problems.costs_q[problems.costs_q == 255] = 200
    problems.costs_q[~problems.present] = 255
    inputs = policy_inputs(problems)
    enough = inputs.available.sum(1) <= inputs.waiting.sum(1)
    can = inputs.eligible.any(2) & enough[:, None]
    logits = edge_network()(inputs)
    assert can.any()
    assert logits[:, :, 0][can].le(float(MASKED_LOGIT)).all()


def test_somebody_requests_wherever_somebody_can_and_nobody_is_busy():
    problems = mixed_batch(np.random.default_rng(8), 400, 6, 4)
    problems.busy[:] = False
    inputs = policy_inputs(problems)
    for network in (edge_network(), edge_network(head=False), GraphSageNetwork()):
        requests = network(inputs).argmax(2).gt(0).any(1)
        assert torch.equal(requests, inputs.eligible.flatten(1).any(1))


def test_an_agent_waits_for_a_busy_one_that_is_there_sooner():
    problems = codes([100, 250], [20, 255])  # 1 is busy but nearly at task 1; task 2 is far from 0
    problems.available[0, 1], problems.busy[0, 1] = False, True
    problems.waiting[0, 1] = False
    assert GraphSageNetwork()(policy_inputs(problems)).argmax(2).tolist() == [[0, 0]]
    myopic = GraphSageNetwork(GraphSageSettings(look_ahead=False))
    assert myopic(policy_inputs(problems)).argmax(2).tolist() == [[1, 0]]


def test_looking_ahead_agrees_with_the_look_ahead_hungarian():
    problems = free_fleet(plane_codes(np.random.default_rng(9), 60, 12, 12))
    problems.busy[:, 4:] = True
    problems.available[:, 4:] = False
    actions = GraphSageNetwork()(policy_inputs(problems)).argmax(2).numpy()
    exact = np.array([LookAhead().actions(problems.problem(index)) for index in range(60)])
    assert (actions == exact)[:, :4].mean() >= 0.98
    assert not actions[:, 4:].any()


# ---- all ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "settings"), KINDS)
def test_every_network_masks_what_is_not_valid_and_gives_finite_gradients(kind: str, settings: dict):
    problems = mixed_batch(np.random.default_rng(10), 50, 5, 6)
    inputs = policy_inputs(problems)
    network = make_network(kind, settings, 5, 6)
    logits, values = network.evaluate(inputs)
    assert logits.shape == (50, 5, 7)
    assert values.shape == (50, 5)
    valid = logits > float(MASKED_LOGIT)
    assert torch.equal(valid[:, :, 1:], inputs.eligible)
    assert valid.any(2).all()
    torch.testing.assert_close(network(inputs), logits)
    (torch.distributions.Categorical(logits=logits).entropy().sum() + values.sum()).backward()
    assert all(p.grad is None or torch.isfinite(p.grad).all() for p in network.parameters())


@pytest.mark.parametrize(("kind", "settings"), KINDS)
def test_a_network_is_built_again_from_what_it_exports(kind: str, settings: dict):
    network = make_network(kind, settings, 4, 3)
    twin: PolicyNetwork = make_network(kind, network.settings_dict(), 4, 3)
    twin.load_tensors(network.to_tensors())
    inputs = policy_inputs(mixed_batch(np.random.default_rng(11), 10, 4, 3))
    torch.testing.assert_close(twin(inputs), network(inputs), rtol=0, atol=0)


def test_unknown_networks_and_settings_are_refused_by_name():
    with pytest.raises(ConfigError, match="'transformer' is unknown; known: graphsage"):
        make_network("transformer", {}, 2, 2)
    with pytest.raises(ConfigError, match="'steps' is unknown"):
        make_network("graphsage", {"steps": 3}, 2, 2)
    with pytest.raises(ConfigError, match="depth"):
        make_network("gcn", {"depth": 3}, 2, 2)
    with pytest.raises(ConfigError, match="policy_input = 'x'"):
        make_network("paper_network", {"policy_input": "x"}, 2, 2)


def test_the_age_of_a_row_changes_nothing_until_a_training_teaches_it():
    network, batch = edge_network(seed=1), mixed_batch(np.random.default_rng(5), 20, 6, 8)
    fresh = GraphSageNetwork()
    fresh.out.load_state_dict(network.out.state_dict())
    aged = replace(batch, ages_rounds=batch.ages_rounds + np.float32(0.7))
    assert torch.equal(fresh(policy_inputs(batch)), fresh(policy_inputs(aged)))
