"""Allocators, quantisation and the observation: values worked out by hand, and laws."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from allocation_samples import U, cost_matrices, problem
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from safetensors.numpy import save

from hippomat_core.allocation.factory import BASELINES, make_allocator
from hippomat_core.allocation.greedy import assign_greedily
from hippomat_core.allocation.hungarian import assign
from hippomat_core.allocation.observation import observations
from hippomat_core.allocation.paper_network import KEYS, MASKED_LOGIT, expected_shapes
from hippomat_core.allocation.pure_hash import hash_below, pure_hash
from hippomat_core.allocation.quantise import dequantise, quantise, saturated
from hippomat_core.errors import ConfigError

# ---- quantisation -------------------------------------------------------------------------------


def test_costs_become_the_codes_worked_out_by_hand():
    codes = quantise([0.0, 25.0, 6.25, 1.0, 30.0, math.inf, math.nan], 25.0)
    assert codes.tolist() == [0, 254, 127, 51, 254, 255, 255]  # 254 sqrt(1/25) = 50.8
    assert dequantise(codes, 25.0)[[0, 1, 2, 5]].tolist() == [0.0, 25.0, 6.25, math.inf]
    assert saturated([25.0, 25.1, math.inf], 25.0).tolist() == [False, True, False]


def test_every_code_survives_dequantising():
    codes = np.arange(256, dtype=np.uint8)
    assert np.array_equal(quantise(dequantise(codes, 17.3), 17.3), codes)


@given(st.lists(st.floats(0.0, 100.0), min_size=2, max_size=20), st.floats(0.1, 50.0))
def test_quantising_keeps_the_order(costs_s, c_max_s):
    codes = quantise(sorted(costs_s), c_max_s)
    assert np.all(np.diff(codes.astype(int)) >= 0)


def test_quantising_without_a_scale_is_refused():
    with pytest.raises(ValueError, match="c_max_s"):
        quantise([1.0], 0.0)


# ---- observation --------------------------------------------------------------------------------


def test_the_observation_is_the_papers_vector():
    x = observations(
        np.array([[0, 127, 254], [U, 0, 0]], np.uint8), np.array([False, True]), np.array([True, False, True])
    )
    assert x.dtype == np.float32
    assert x.tolist() == [
        [-1, -1, -0.5, 1, 1, -1, 1],  # idle; 2 (127/254)^2 - 1 = -0.5
        [1, 1, -1, -1, 1, -1, 1],  # assigned; unreachable = 1
    ]


def test_a_robot_never_heard_adds_nothing_to_the_graph():
    x = observations(np.zeros((2, 1), np.uint8), np.zeros(2, bool), np.ones(1, bool), np.array([True, False]))
    assert x.tolist() == [[-1, -1, 1], [0, 0, 0]]


# ---- hungarian and greedy -----------------------------------------------------------------------


def test_hungarian_gives_up_the_nearest_task_for_the_smaller_total():
    # robot 0 is nearest to both tasks; squares 1 + 100 > 9 + 4
    costs = [[1, 3], [2, 10]]
    assert assign(np.array(costs, np.uint8), np.ones((2, 2), bool)).tolist() == [1, 0]
    assert assign_greedily(np.array(costs, np.uint8), np.ones((2, 2), bool)).tolist() == [0, 1]


def test_hungarian_serves_as_many_as_it_can_before_it_saves_cost():
    costs = np.array([[0, U], [0, 254]], np.uint8)
    assert assign(costs, costs != U).tolist() == [0, 1]


@given(cost_matrices(5))
def test_hungarian_finds_the_least_total_of_the_most_assignments(costs):
    eligible = costs != U
    found = assign(costs, eligible)
    n, m = costs.shape
    weights = np.where(eligible, costs.astype(int) ** 2, 10**9)
    small, large = (weights, (n, m)) if n <= m else (weights.T, (m, n))
    best = min(
        sum(small[row, column] for row, column in enumerate(columns))
        for columns in itertools.permutations(range(large[1]), large[0])
    )
    taken = [(row, slot) for row, slot in enumerate(found.tolist()) if slot >= 0]
    total = sum(int(costs[pair]) ** 2 for pair in taken) + (min(n, m) - len(taken)) * 10**9
    assert total == best


@pytest.mark.parametrize("method", [assign, assign_greedily])
@given(costs=cost_matrices(), data=st.data())
def test_an_assignment_gives_one_eligible_task_to_one_robot(method, costs, data):
    eligible = data.draw(arrays(np.bool_, costs.shape)) & (costs != U)
    found = method(costs, eligible)
    taken = [(row, slot) for row, slot in enumerate(found.tolist()) if slot >= 0]
    assert all(eligible[pair] for pair in taken)
    assert len({slot for _, slot in taken}) == len(taken)


@given(cost_matrices())
def test_greedy_is_a_stable_matching(costs):
    found = assign_greedily(costs, costs != U)
    holder = {slot: row for row, slot in enumerate(found.tolist()) if slot >= 0}
    for row, slot in np.argwhere(costs != U).tolist():
        content = found[row] >= 0 and costs[row, found[row]] <= costs[row, slot]
        taken = slot in holder and costs[holder[slot], slot] <= costs[row, slot]
        assert content or taken


@pytest.mark.parametrize("name", ["hungarian", "greedy"])
@given(costs=cost_matrices())
@settings(max_examples=40)
def test_robots_that_hold_the_same_snapshot_never_choose_one_task_twice(name, costs):
    allocator = make_allocator(name, None, *costs.shape)
    actions = [allocator.allocate(problem(costs, robot)).action for robot in range(len(costs))]
    chosen = [action for action in actions if action > 0]
    assert len(set(chosen)) == len(chosen)


@given(st.permutations(range(5)), st.integers(0, 2**32 - 1))
def test_renaming_robots_renames_the_assignment(order, seed):
    costs = np.random.default_rng(seed).permutation(254)[:25].reshape(5, 5).astype(np.uint8)
    straight = assign(costs, np.ones((5, 5), bool))
    renamed = assign(costs[order], np.ones((5, 5), bool))
    total = np.square(costs[range(5), straight].astype(int)).sum()
    assert np.square(costs[order][range(5), renamed].astype(int)).sum() == total


def test_sixty_four_robots_and_eighty_tasks_are_solved_exactly():
    costs = np.full((64, 80), 254, np.uint8)
    costs[np.arange(64), np.arange(64)[::-1]] = 253
    assert assign(costs, np.ones(costs.shape, bool)).tolist() == list(range(63, -1, -1))


def test_a_robot_that_takes_no_part_is_assigned_nothing():
    available = np.array([False, True])
    decision = make_allocator("hungarian", None, 2, 2).allocate(
        problem([[0, 0], [9, 5]], self_index=1, available=available, waiting=np.array([True, False]))
    )
    assert decision.action == 1


# ---- random -------------------------------------------------------------------------------------


def test_random_requests_are_valid_repeatable_and_spread():
    allocator = make_allocator("random", None, 2, 4)
    costs = [[1, U, 3, 4], [0, 0, 0, 0]]
    actions = [allocator.allocate(problem(costs, round=number)).action for number in range(200)]
    assert set(actions) == {1, 3, 4}
    assert actions == [allocator.allocate(problem(costs, round=number)).action for number in range(200)]


def test_the_pure_hash_never_changes():
    # positions of tasks and recorded runs depend on it
    assert pure_hash() == pure_hash() != pure_hash(0) != pure_hash(0, 0)
    assert pure_hash(1, 2, 3) == 0xE15CA7D62D35B26D
    assert all(0 <= hash_below(7, value) < 7 for value in range(100))


# ---- the paper's network ------------------------------------------------------------------------


def weights(
    n: int, m: int, per_robot: bool = False, wide: bool = False, seed: int = 0
) -> dict[str, np.ndarray]:
    shapes = expected_shapes(m, 7 + 2 * m if wide else 6)
    draw = np.random.default_rng(seed)
    lead = (n,) if per_robot else ()
    return {key: draw.normal(0, 0.3, (*lead, *shapes[key])).astype(np.float32) for key in KEYS}


def test_the_papers_network_gives_the_logits_worked_out_by_hand():
    m, tensors = 1, {key: np.zeros(shape, np.float32) for key, shape in expected_shapes(1).items()}
    tensors["sage.self.weight"][0] = [1.0, 0.0, 0.0]  # z_0 sees the status alone
    tensors["sage.neighbour.weight"][0] = [0.5, 0.25, 0.0]
    tensors["policy.0.weight"][0, 0] = -2.0
    tensors["policy.0.bias"][1] = 0.5
    tensors["policy.1.weight"][0, 0] = tensors["policy.1.weight"][1, 1] = 1.0
    tensors["policy.2.weight"][0, 1] = 1.0
    tensors["policy.2.weight"][1, 0] = 3.0
    allocator = make_allocator("paper_network", save(tensors), 3, m)
    # robot 0 idle; robot 1 assigned, 0 s away; robot 2 idle, half the scale in q: cost -0.5
    given_problem = problem([[254], [0], [127]], assigned=np.array([False, True, False]))
    decision = allocator.allocate(given_problem)
    z = math.tanh(-1.0 + (0.5 - 0.25) + (-0.5 - 0.125))
    assert decision.logits.tolist() == pytest.approx([0.5, 3.0 * -2.0 * z])
    assert decision.action == 1


@pytest.mark.parametrize("per_robot", [False, True])
@pytest.mark.parametrize("wide", [False, True])
def test_the_papers_network_equals_its_formula(per_robot, wide):
    n, m = 4, 3
    tensors = weights(n, m, per_robot, wide)
    costs = np.random.default_rng(5).integers(0, 255, (n, m))
    for robot in range(n):
        one = {key: tensor[robot] if per_robot else tensor for key, tensor in tensors.items()}
        x = problem(costs).observations().astype(float)
        others = sum(one["sage.neighbour.weight"] @ x[j] for j in range(n) if j != robot)
        z = np.tanh(one["sage.self.weight"] @ x[robot] + others)
        hidden = np.concatenate([x[robot], z]) if wide else z
        for layer in (0, 1):
            hidden = one[f"policy.{layer}.weight"] @ hidden + one[f"policy.{layer}.bias"]
            hidden = np.maximum(hidden, 0)
        logits = one["policy.2.weight"] @ hidden + one["policy.2.bias"]
        decision = make_allocator("paper_network", save(tensors), n, m).allocate(problem(costs, robot))
        assert decision.logits == pytest.approx(logits, abs=1e-4)
        assert decision.action == int(np.argmax(logits))


def test_the_order_of_the_neighbours_does_not_matter_to_the_papers_network():
    costs = np.random.default_rng(6).integers(0, 255, (5, 3))
    allocator = make_allocator("paper_network", save(weights(5, 3)), 5, 3)
    straight = allocator.allocate(problem(costs))
    shuffled = allocator.allocate(problem(costs[[0, 3, 1, 4, 2]]))
    assert shuffled.logits == pytest.approx(straight.logits, abs=1e-5)


def test_the_papers_network_never_requests_what_is_not_open():
    tensors = weights(2, 3)
    tensors["policy.2.bias"][:] = [0, 90, 80, 70]
    allocator = make_allocator("paper_network", save(tensors), 2, 3)
    decision = allocator.allocate(problem([[U, 9, 9], [1, 1, 1]], waiting=np.array([True, False, True])))
    assert decision.action == 3
    assert decision.logits[[1, 2]].tolist() == [MASKED_LOGIT, MASKED_LOGIT]
    assert allocator.allocate(problem([[U, U, U], [1, 1, 1]])).action == 0


def test_weights_of_another_fleet_are_refused_by_name():
    with pytest.raises(ConfigError, match=r"sage.self.weight.*\[6, 7\], needed float32\[6, 9\].*4 task"):
        make_allocator("paper_network", save(weights(2, 3)), 2, 4)
    with pytest.raises(ConfigError, match=r"needed float32\[5, 6, 7\].*5 robots"):
        make_allocator("paper_network", save(weights(2, 3, per_robot=True)), 5, 3)


def test_files_that_hold_no_policy_are_refused_by_name():
    with pytest.raises(ConfigError, match="not valid safetensors"):
        make_allocator("paper_network", b"weights", 2, 3)
    with pytest.raises(ConfigError, match=r"missing .*policy\.0\.bias"):
        make_allocator("paper_network", save({"w": np.zeros(3, np.float32)}), 2, 3)
    with pytest.raises(ConfigError, match="policy"):
        make_allocator("paper_network", None, 2, 3)
    with pytest.raises(
        ConfigError,
        match=f"known: {', '.join(BASELINES)}, .*paper_network",
    ):
        make_allocator("best", None, 2, 3)


def test_allocators_leave_the_problem_as_it_was():
    costs = np.random.default_rng(7).integers(0, 256, (3, 3)).astype(np.uint8)
    before = costs.copy()
    for name in (*BASELINES, "paper_network"):
        make_allocator(name, save(weights(3, 3)), 3, 3).allocate(problem(costs))
    assert np.array_equal(costs, before)
