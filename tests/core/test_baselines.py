"""Baseline allocators: cases worked out by hand, and laws that each of them keeps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from allocation_samples import U, cost_matrices, problem, problems
from hypothesis import given, settings
from hypothesis import strategies as st

from hippomat_core.allocation.auction import auction
from hippomat_core.allocation.factory import ALLOCATORS, BASELINES, make_allocator
from hippomat_core.allocation.greedy import assign_greedily
from hippomat_core.allocation.hungarian import assign, units
from hippomat_core.allocation.ipso_g import SwarmSettings, swarm_assignment
from hippomat_core.allocation.look_ahead import assign_ahead, promisable, wait_units

# deadline=None: the first swarm on a machine is compiled for seconds.
COMMON = (
    "hungarian",
    "look_ahead",
    "greedy",
    "auction",
)  # who shares a snapshot never asks for one task twice


def actions(name: str, costs: object, **others: object) -> list[int]:
    given_problem = problem(costs, **others)
    return make_allocator(name, None, *given_problem.costs_q.shape).actions(given_problem).tolist()


def one_to_one(slots: np.ndarray) -> bool:
    taken = slots[slots >= 0].tolist()
    return len(set(taken)) == len(taken)


# ---- laws of all --------------------------------------------------------------------------------


def test_the_factory_knows_every_baseline():
    known = {"hungarian", "look_ahead", "greedy", "nearest", "auction", "ipso_g", "random", "fixed_slot"}
    assert set(BASELINES) == known < set(ALLOCATORS)
    assert all(make_allocator(name, None, 2, 2).name == name for name in BASELINES)


@pytest.mark.parametrize("name", BASELINES)
@given(snapshot=problems())
@settings(max_examples=60, deadline=None)
def test_nobody_requests_what_is_not_eligible(name, snapshot):
    found = make_allocator(name, None, *snapshot.costs_q.shape).actions(snapshot)
    assert found.dtype == np.int64
    assert found.shape == snapshot.available.shape
    for robot, action in enumerate(found.tolist()):
        assert action == 0 or snapshot.eligible[robot, action - 1]


@pytest.mark.parametrize("name", BASELINES)
@given(snapshot=problems())
@settings(max_examples=30, deadline=None)
def test_the_same_snapshot_gives_the_same_answer_to_everyone(name, snapshot):
    allocator = make_allocator(name, None, *snapshot.costs_q.shape)
    found = allocator.actions(snapshot).tolist()
    views = [replace(snapshot, self_index=robot) for robot in range(len(found))]
    assert [allocator.allocate(view).action for view in views] == found
    assert all(allocator.actions(view).tolist() == found for view in views)


@pytest.mark.parametrize("name", COMMON)
@given(snapshot=problems())
@settings(max_examples=60, deadline=None)
def test_a_common_snapshot_leaves_no_conflict(name, snapshot):
    assert one_to_one(make_allocator(name, None, *snapshot.costs_q.shape).actions(snapshot) - 1)


@pytest.mark.parametrize("name", ["hungarian", "greedy", "auction"])
@given(snapshot=problems())
@settings(max_examples=60, deadline=None)
def test_who_stays_without_a_task_finds_all_of_its_tasks_taken(name, snapshot):
    found = make_allocator(name, None, *snapshot.costs_q.shape).actions(snapshot)
    for robot in np.flatnonzero(found == 0):
        assert set(np.flatnonzero(snapshot.eligible[robot]) + 1) <= set(found.tolist())


@pytest.mark.parametrize("name", ["nearest", "random", "fixed_slot"])
@given(snapshot=problems())
@settings(max_examples=60, deadline=None)
def test_who_decides_alone_requests_whenever_it_can(name, snapshot):
    found = make_allocator(name, None, *snapshot.costs_q.shape).actions(snapshot)
    assert np.array_equal(found > 0, snapshot.eligible.any(axis=1))


@given(st.integers(1, 6), st.integers(0, 3), st.integers(0, 2**32 - 1))
@settings(deadline=None)
def test_hungarians_total_is_a_lower_bound(n, more, seed):
    costs = np.random.default_rng(seed).integers(0, 255, (n, n + more)).astype(np.uint8)
    eligible = np.ones(costs.shape, bool)
    rows = np.arange(n)
    least = units(costs)[rows, assign(costs, eligible)].sum()
    for slots in (
        assign_greedily(costs, eligible),
        auction(costs, eligible).slots,
        swarm_assignment(costs, eligible, seed, SwarmSettings()),
        np.array(actions("fixed_slot", costs)) - 1,
    ):
        assert one_to_one(slots)
        assert units(costs)[rows, slots].sum() >= least


@pytest.mark.parametrize("name", ["look_ahead", "greedy", "nearest", "auction"])
@pytest.mark.parametrize("seed", range(20))
def test_renaming_robots_and_tasks_renames_the_answer(name, seed):
    draw = np.random.default_rng(seed)
    costs = draw.permutation(254)[:42].reshape(6, 7).astype(np.uint8)  # no ties
    busy = np.arange(6) % 3 == 0
    robots, tasks = draw.permutation(6), draw.permutation(7)
    straight = np.array(actions(name, costs, available=~busy, busy=busy))
    renamed = actions(name, costs[robots][:, tasks], available=~busy[robots], busy=busy[robots])
    expected = [
        int(np.flatnonzero(tasks == slot)[0]) + 1 if slot >= 0 else 0 for slot in straight[robots] - 1
    ]
    assert renamed == expected


# ---- look-ahead ---------------------------------------------------------------------------------

BUSY = {"available": np.array([True, False]), "busy": np.array([False, True])}


def test_the_near_task_is_left_to_a_busy_robot_that_is_sooner_there():
    # waiting costs 2 (1 + 900) / 2 = 901;  900 + 1 (0 goes far, 1 near) < 100 + 901 (0 goes near, 1 waits)
    costs = np.array([[10, 30], [1, 40]], np.uint8)
    assert wait_units(costs, np.ones((2, 2), bool)) == 901
    assert actions("look_ahead", costs, **BUSY) == [2, 0]
    assert actions("hungarian", costs, **BUSY) == [1, 0]


def test_a_robot_waits_when_the_only_task_is_sooner_served_by_a_busy_one():
    assert actions("look_ahead", [[3], [2]], **BUSY) == [0, 0]
    assert actions("look_ahead", [[2], [3]], **BUSY) == [1, 0]
    assert actions("look_ahead", [[2], [2]], **BUSY) == [1, 0]  # on equal terms who is available goes


def test_nobody_waits_for_a_busy_robot_that_cannot_be_there():
    assert actions("look_ahead", [[200], [U]], **BUSY) == [1, 0]
    assert actions("look_ahead", [[200, U], [U, 1]], **BUSY) == [1, 0]  # far, but nobody else's


def test_a_robot_that_is_neither_available_nor_busy_is_promised_nothing():
    assert actions("look_ahead", [[3], [2]], available=np.array([True, False])) == [1, 0]


@given(problems())
def test_look_ahead_equals_hungarian_when_nobody_is_busy(snapshot):
    alone = replace(snapshot, busy=np.zeros_like(snapshot.busy))
    look_ahead, hungarian = (make_allocator(name, None, 1, 1) for name in ("look_ahead", "hungarian"))
    assert look_ahead.actions(alone).tolist() == hungarian.actions(alone).tolist()


@given(problems())
def test_who_waits_sees_the_cheapest_task_promised_to_another(snapshot):
    eligible = snapshot.eligible
    slots = assign_ahead(snapshot.costs_q, eligible, promisable(snapshot))
    assert one_to_one(slots)
    for robot in np.flatnonzero((slots < 0) & eligible.any(axis=1)):
        costs = np.where(eligible[robot], snapshot.costs_q[robot], U)
        assert set(np.flatnonzero(costs == costs.min())) <= set(slots.tolist())


def test_waiting_is_measured_on_the_scale_of_the_snapshot():
    draw = np.random.default_rng(3)
    for _ in range(100):
        costs = draw.permutation(127)[:60].reshape(6, 10).astype(np.uint8)
        busy = np.arange(6) % 2 == 0
        near = actions("look_ahead", costs, available=~busy, busy=busy)
        assert near == actions("look_ahead", 2 * costs, available=~busy, busy=busy)  # four times as long


def test_sixty_four_robots_that_all_tie_are_served():
    busy = np.arange(64) >= 40
    for code in (0, 1, 254):
        found = actions("look_ahead", np.full((64, 80), code), available=~busy, busy=busy)
        assert sum(action > 0 for action in found) == 40
        assert one_to_one(np.array(found) - 1)


# ---- nearest and fixed slot ---------------------------------------------------------------------


def test_nearest_asks_for_its_own_cheapest_whoever_else_does():
    assert actions("nearest", [[5, 3, 9], [7, 1, 8], [2, 2, 0]], waiting=np.array([True, True, False])) == [
        2,
        2,
        1,
    ]


@given(problems(), st.integers(0, 2**32 - 1))
def test_nearest_never_looks_at_its_neighbours(snapshot, seed):
    nearest = make_allocator("nearest", None, 1, 1)
    others = np.random.default_rng(seed).integers(0, 256, snapshot.costs_q.shape).astype(np.uint8)
    others[0] = snapshot.costs_q[0]
    assert nearest.allocate(snapshot).action == nearest.allocate(replace(snapshot, costs_q=others)).action


def test_every_robot_keeps_its_fixed_slot_and_takes_the_next_one_that_is_open():
    assert actions("fixed_slot", np.full((4, 3), 7)) == [1, 2, 3, 1]
    costs = [[1, 1, 1], [1, U, 1], [U, U, U]]
    assert actions("fixed_slot", costs, waiting=np.array([True, True, False])) == [1, 1, 0]


# ---- auction ------------------------------------------------------------------------------------


def test_an_auction_by_hand_takes_as_many_rounds_as_bids_are_answered():
    # both bid for slot 0 and robot 1 wins; then robot 0 bids for slot 1 and nobody answers
    result = auction(np.array([[4, 6], [3, 9]], np.uint8), np.ones((2, 2), bool))
    assert (result.slots.tolist(), result.rounds) == ([1, 0], 2)
    # robot 2 takes slot 1 from robot 1, which takes slot 0 from robot 0, which has nothing left
    chain = np.array([[5, U], [4, 3], [U, 2]], np.uint8)
    result = auction(chain, chain != U)
    assert (result.slots.tolist(), result.rounds) == ([-1, 0, 1], 2)


def test_an_auction_without_bids_needs_no_message():
    result = auction(np.full((2, 2), U, np.uint8), np.zeros((2, 2), bool))
    assert (result.slots.tolist(), result.rounds) == ([-1, -1], 0)


@given(cost_matrices(8))
def test_the_auction_ends_in_the_stable_matching_within_its_bound(costs):
    eligible = costs != U
    result = auction(costs, eligible)
    assert result.slots.tolist() == assign_greedily(costs, eligible).tolist()
    assert eligible.any() <= result.rounds <= (result.slots >= 0).sum()


# ---- IPSO-G -------------------------------------------------------------------------------------


def test_the_swarm_finds_the_order_in_which_greedy_is_optimal():
    # robot 0 first: 1 + 100; robot 1 first: 4 + 9
    costs = np.array([[1, 3], [2, 10]], np.uint8)
    for draw in range(50):
        assert swarm_assignment(costs, np.ones((2, 2), bool), draw, SwarmSettings()).tolist() == [1, 0]


def test_the_swarm_serves_as_many_as_it_can():
    costs = np.array([[0, U], [0, 254]], np.uint8)
    assert swarm_assignment(costs, costs != U, 1, SwarmSettings()).tolist() == [0, 1]


@given(cost_matrices(), st.integers(0, 2**64 - 1))
@settings(deadline=None)
def test_a_swarm_gives_one_eligible_task_to_one_robot(costs, draw):
    slots = swarm_assignment(costs, costs != U, draw, SwarmSettings())
    assert one_to_one(slots)
    assert all(costs[robot, slot] != U for robot, slot in enumerate(slots.tolist()) if slot >= 0)


def test_a_longer_search_costs_less():
    draw = np.random.default_rng(8)
    totals = np.zeros(2)
    for seed in range(30):
        costs = draw.integers(0, 255, (12, 12)).astype(np.uint8)
        for column, iterations in enumerate((0, 30)):
            slots = swarm_assignment(costs, costs != U, seed, SwarmSettings(iterations=iterations))
            totals[column] += units(costs)[np.flatnonzero(slots >= 0), slots[slots >= 0]].sum()
    assert totals[1] < 0.95 * totals[0]


def test_robots_and_rounds_have_swarms_of_their_own():
    costs = np.random.default_rng(4).integers(0, 255, (20, 20))
    rounds = [actions("ipso_g", costs, round=number) for number in range(4)]
    assert len({tuple(found) for found in rounds}) == 4
    assert any(len(set(found)) < 20 for found in rounds)  # they disagree: somebody is asked for twice


def test_the_swarms_draws_never_change():
    # recorded runs depend on it
    costs = np.random.default_rng(5).permutation(254)[:64].reshape(8, 8)
    assert actions("ipso_g", costs, seed=3, round=7) == [8, 6, 1, 3, 4, 5, 2, 7]
