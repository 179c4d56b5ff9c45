"""What is trained in torch is what the robots run: the same logits and actions on 100,000 snapshots."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from network_samples import edge_network, in_core, mixed_batch, policy_bytes

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.paper_network import MASKED_LOGIT
from hippomat_core.allocation.port import actions_one_by_one
from hippomat_sim.learn.networks import policy_inputs
from hippomat_sim.learn.networks.flat import PaperNetwork
from hippomat_sim.learn.networks.graphsage import GraphSageNetwork

TOLERANCE, MARGIN = 1e-5, 1e-4
SIZES = [  # agents, tasks, snapshots: 100,000 together
    (1, 30, 10_000),
    (2, 3, 34_000),
    (3, 2, 30_000),
    (5, 5, 10_000),
    (4, 8, 6_000),
    (8, 4, 6_000),
    (10, 10, 3_000),
    (20, 30, 700),
    (30, 20, 200),
    (30, 30, 100),
]
# Fewer than 40 steps may end unsettled, where rounding of the first prices still shows.
WAYS = [{}, {"head": False}, {"look_ahead": False}, {"head_steps": 40}]


def differences(torch_logits: np.ndarray, core_logits: np.ndarray) -> None:
    """Asserts the two properties that are promised for every row of logits."""
    assert np.array_equal(torch_logits <= MASKED_LOGIT, core_logits <= MASKED_LOGIT)
    assert np.abs(torch_logits - core_logits).max() <= TOLERANCE
    best_two = np.sort(core_logits, axis=-1)[..., -2:]
    clear = best_two[..., 1] - best_two[..., 0] > MARGIN
    assert np.array_equal(torch_logits.argmax(-1)[clear], core_logits.argmax(-1)[clear])


def test_the_sizes_make_100_000_snapshots():
    assert sum(count for _, _, count in SIZES) == 100_000


@pytest.mark.parametrize(("agents", "tasks", "count"), SIZES)
def test_torch_and_the_core_give_the_same_logits_and_actions(agents: int, tasks: int, count: int):
    problems = mixed_batch(np.random.default_rng((agents, tasks)), count, agents, tasks)
    network = edge_network(agents)
    ways = [
        (network.with_settings(**way), np.arange(start, count, len(WAYS))) for start, way in enumerate(WAYS)
    ]
    for reading, chosen in ways:
        robot = in_core(reading)
        for part in np.array_split(chosen, max(1, len(chosen) * agents * tasks // 100_000)):
            batch = problems.take(part)
            with torch.no_grad():
                expected = reading(policy_inputs(batch)).numpy()
            found = np.stack([robot.logits(batch.problem(index)) for index in range(len(batch))])
            differences(expected, found)


@pytest.mark.parametrize("policy_input", ["z", "xz"])
@pytest.mark.parametrize("independent", [True, False])
@pytest.mark.parametrize("neighbours", [True, False])
def test_the_papers_network_is_the_same_in_both(policy_input: str, independent: bool, neighbours: bool):
    torch.manual_seed(3)
    network = PaperNetwork(4, 6, policy_input, independent, neighbours)
    with torch.no_grad():
        network.policy.layers[2].weight *= 100.0
    problems = mixed_batch(np.random.default_rng(4), 100, 4, 6)
    allocator = make_allocator("paper_network", policy_bytes(network), 4, 6)
    with torch.no_grad():
        expected = network(policy_inputs(problems)).numpy()
    found = [
        [allocator.allocate(problems.problem(index, robot)).logits for robot in range(4)]
        for index in range(100)
    ]
    differences(expected, np.array(found))


def test_one_robots_decision_is_its_row_of_everybodys():
    allocator = make_allocator("graphsage", policy_bytes(edge_network()), 6, 8)
    problems = mixed_batch(np.random.default_rng(5), 40, 6, 8)
    for index in range(40):
        problem = problems.problem(index, 2)
        assert np.array_equal(allocator.actions(problem), actions_one_by_one(allocator, problem))
        again = allocator.allocate(problem)
        assert np.array_equal(again.logits, allocator.allocate(problem).logits)


def test_the_untrained_network_acts_in_the_core_as_in_torch():
    problems = mixed_batch(np.random.default_rng(6), 50, 6, 8)
    network = GraphSageNetwork()
    robot = in_core(network)
    with torch.no_grad():
        expected = network(policy_inputs(problems)).argmax(2).numpy()
    assert np.array_equal(expected, [robot.actions(problems.problem(index)) for index in range(50)])
