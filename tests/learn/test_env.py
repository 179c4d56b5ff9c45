"""The learning environment against the rules in plain Python: requests, rewards, time, turnover, episodes."""

from __future__ import annotations

import numpy as np
import pytest
from env_lab import (
    UNREACHABLE_CODE,
    corridor,
    env_of,
    expected_codes,
    expected_round,
    held,
    random_actions,
    small_pool,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.observation import observations
from hippomat_core.errors import ConfigError
from hippomat_sim.learn.settings import UAV, UGV, RewardSettings

TURNOVERS = ("never", "on_claim", "on_completion")


def hungarian(env, problems) -> np.ndarray:
    allocator = make_allocator("hungarian", None, env.settings.agents, env.settings.tasks)
    return np.stack([allocator.actions(problems.problem(e)) for e in range(len(problems))])


# ---- a round ----


@settings(max_examples=25, deadline=None)
@given(
    st.integers(1, 9),
    st.integers(1, 9),
    st.sampled_from(TURNOVERS),
    st.sampled_from((0.0, 0.5)),
    st.integers(0, 2**32),
)
def test_requests_conflicts_and_rewards_are_those_of_the_rules_in_plain_python(
    agents, tasks, turnover, airborne, seed
):
    prices = RewardSettings(conflict=0.9, idle=0.4, low_cost_bonus=0.3, low_cost=0.1, busy_request=0.6)
    env = env_of(
        seed=seed,
        agents=agents,
        tasks=tasks,
        turnover=turnover,
        airborne_tasks=airborne,
        episode_steps=7,
        rewards=prices,
    )
    rng = np.random.default_rng(seed)
    before = held(env.reset())
    for _ in range(10):
        actions = random_actions(rng, env)
        step = env.step(actions)
        for e in range(env.copies):
            expected = expected_round(before, e, actions[e].tolist(), prices)
            assert step.events.allocated[e].tolist() == expected.allocated
            np.testing.assert_allclose(step.rewards[e], expected.rewards, atol=1e-6)
            assert step.team_reward[e] == pytest.approx(sum(expected.rewards), abs=1e-4)
            assert step.events.requested_tasks[e] == expected.requested
            assert step.events.conflicted_tasks[e] == expected.conflicted
        before = held(step.problems)


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 8), st.integers(1, 8), st.sampled_from(TURNOVERS), st.integers(0, 2**32))
def test_codes_are_the_cores_quantised_times_until_each_agent_could_be_there(agents, tasks, turnover, seed):
    env = env_of(seed=seed, agents=agents, tasks=tasks, turnover=turnover, airborne_tasks=0.3, dwell_s=0.4)
    rng = np.random.default_rng(seed)
    problems = env.reset()
    for _ in range(12):
        np.testing.assert_array_equal(problems.costs_q, expected_codes(env))
        assert turnover == "never" or (problems.available == (env.hidden.busy_ms == 0)).all()
        problems = env.step(random_actions(rng, env)).problems


def test_a_round_by_hand():
    """Two agents ask for the same task, a third for nothing, a fourth is alone with its request."""
    env = env_of(copies=1, agents=4, tasks=5, uav_share=0.0)
    codes = env.reset().costs_q[0].astype(int)
    smaller = int(codes[1, 2] < codes[0, 2])  # of equal costs the smaller id has it
    step = env.step([[3, 3, 0, 5]])
    cost, other = (codes[smaller, 2] / 254) ** 2, (codes[3, 4] / 254) ** 2
    expected = [-1.0, -1.0, -0.5, -other + 0.2 * (other <= 0.2)]
    expected[smaller] = -cost + 0.2 * (cost <= 0.2)
    np.testing.assert_allclose(step.rewards[0], expected, atol=1e-6)
    assert step.team_reward[0] == pytest.approx(sum(expected))
    assert step.events.allocated[0, smaller] == 2
    assert (step.events.requested_tasks[0], step.events.conflicted_tasks[0]) == (2, 1)
    again = env.step([[0] * 2 + [3, 1]])
    assert again.rewards[0, smaller] == 0.0, "has a task and asks for none"
    assert again.rewards[0, 2] == -1.0, "the task is another one's"
    assert again.rewards[0, 3] == -0.5, "has a task and asks for one more"


def test_x_i_is_built_by_the_cores_function():
    env = env_of(agents=5, tasks=6, turnover="on_claim")
    rng = np.random.default_rng(1)
    for _ in range(6):
        problems = env.step(random_actions(rng, env)).problems
    problem = problems.problem(2)
    expected = observations(
        problems.costs_q[2], problems.assigned[2], problems.waiting[2], problems.present[2]
    )
    np.testing.assert_array_equal(problem.observations(), expected)
    np.testing.assert_array_equal(expected[:, 0], np.where(env.hidden.busy_ms[2] > 0, 1.0, -1.0))


def test_what_flies_reaches_the_sites_in_the_air_and_what_drives_does_not():
    env = env_of(copies=30, agents=6, tasks=10, airborne_tasks=0.5, uav_share=0.5)
    problems = env.reset()
    aloft = env.hidden.site >= 22
    assert 0.3 < aloft.mean() < 0.7
    assert env.classes.tolist() == [UGV] * 3 + [UAV] * 3
    unreachable = problems.costs_q == UNREACHABLE_CODE
    assert unreachable[:, :3][aloft[:, None, :].repeat(3, 1)].all()
    assert not unreachable[:, 3:].any()
    step = env.step(np.full((30, 6), 1))
    assert not (step.events.allocated[aloft[:, 0], :3] >= 0).any(), "a request for it is none"


# ---- turnover and time ----


def test_fixed_tasks_are_all_given_in_one_step_where_nobody_collides():
    env = env_of(copies=8, agents=6, tasks=6)
    problems = env.reset()
    step = env.step(hungarian(env, problems))
    assert step.terminated.all()
    assert not step.truncated.any()
    assert np.sort(step.events.allocated, axis=1).tolist() == [list(range(6))] * 8
    assert step.events.conflicted_tasks.sum() == 0
    assert step.final is not None
    assert step.final.assigned.all()
    assert not step.final.waiting.any()
    assert not step.final.busy.any(), "nobody moves"
    assert step.problems.available.all(), "the next episode has begun"


@pytest.mark.parametrize(("agents", "tasks"), [(3, 7), (7, 3)])
def test_fixed_rounds_go_on_until_nobody_can_get_a_task(agents, tasks):
    env = env_of(copies=1, agents=agents, tasks=tasks, airborne_tasks=0.4, uav_share=0.4)
    problems = held(env.reset())
    allocated = 0
    for _ in range(30):
        eligible = problems.problem(0).eligible
        assert eligible.any()
        step = env.step([[int(np.argmax(row)) + 1 if row.any() else 0 for row in eligible]])
        allocated += int((step.events.allocated >= 0).sum())
        if step.final is not None:
            assert not step.final.problem(0).eligible.any()
            assert (1 - step.final.waiting[0]).sum() == allocated
            return
        problems = held(step.problems)
    pytest.fail("it never ended")


def test_a_task_that_is_claimed_is_replaced_at_once_by_one_elsewhere():
    env = env_of(copies=6, agents=4, tasks=5, turnover="on_claim")
    problems = env.reset()
    for _ in range(40):
        sites, world = env.hidden.site.copy(), env.hidden.world.copy()
        step = env.step(hungarian(env, problems))
        problems = step.problems
        assert problems.waiting.all()
        for e, i in np.argwhere(step.events.allocated >= 0):
            slot = step.events.allocated[e, i]
            assert env.hidden.site[e, slot] != sites[e, slot]
            start_to_site = env.pool.travel_ms[world[e], env.classes[i], :, sites[e, slot]]
            assert step.events.travel_ms[e, i] in start_to_site
        assert all(len(set(row)) == 5 for row in env.hidden.site.tolist())
    assert not step.terminated.any()


def test_a_winner_is_busy_for_its_travel_time_and_dwell_and_then_free_at_the_site():
    env = env_of(copies=1, agents=1, tasks=3, turnover="on_claim", step_s=0.25, dwell_s=0.5, uav_share=0.0)
    problems = env.reset()
    slot = int(np.argmax(problems.costs_q[0, 0]))
    site = int(env.hidden.site[0, slot])
    step = env.step([[slot + 1]])
    due_ms = int(step.events.travel_ms[0, 0]) + 500
    busy_steps = 1
    while step.problems.busy[0, 0]:
        assert env.hidden.busy_ms[0, 0] == due_ms - 250 * busy_steps
        assert not step.problems.available[0, 0]
        step = env.step([[0]])
        busy_steps += 1
    assert busy_steps == -(-due_ms // 250)
    assert step.events.completed[0] == 1
    assert env.hidden.place[0, 0] == env.pool.settings.starts + site
    np.testing.assert_array_equal(step.problems.costs_q, expected_codes(env))


def test_on_completion_a_task_keeps_its_slot_until_it_is_served():
    env = env_of(copies=5, agents=4, tasks=4, turnover="on_completion")
    problems = env.reset()
    served = allocated = 0
    for _ in range(60):
        before, sites = held(problems), env.hidden.site.copy()
        step = env.step(hungarian(env, problems))
        problems = step.problems
        served, allocated = (
            served + step.events.completed.sum(),
            allocated + (step.events.allocated >= 0).sum(),
        )
        busy_slots = np.zeros_like(problems.waiting)
        rows, robots = np.nonzero(env.hidden.slot >= 0)
        busy_slots[rows, env.hidden.slot[rows, robots]] = True
        np.testing.assert_array_equal(problems.waiting, ~busy_slots)
        changed = env.hidden.site != sites
        assert changed.sum() == step.events.completed.sum()
        assert not (changed & problems.waiting & before.waiting)[step.events.completed == 0].any()
    assert allocated - served == problems.busy.sum()


# ---- episodes ----


@pytest.mark.parametrize("turnover", TURNOVERS)
def test_truncation_ends_an_episode_with_what_would_have_come_next(turnover):
    env = env_of(copies=3, agents=3, tasks=3, turnover=turnover, episode_steps=4)
    env.reset()
    for number in range(1, 9):
        step = env.step(np.zeros((3, 3), int))
        assert not step.terminated.any()
        assert step.truncated.all() == (number % 4 == 0)
        assert (step.final is None) == (number % 4 != 0)
    assert len(step.final) == 3
    assert (step.final.costs_q != step.problems.costs_q).any()


@settings(max_examples=10, deadline=None)
@given(st.sampled_from(TURNOVERS), st.sampled_from((0.0, 0.4)), st.integers(0, 2**32))
def test_a_copy_does_the_same_whatever_the_number_of_copies(turnover, loss, seed):
    parts = {"agents": 4, "tasks": 4, "turnover": turnover, "loss": loss, "episode_steps": 5, "seed": seed}
    few, many = env_of(copies=2, **parts), env_of(copies=5, **parts)
    rng = np.random.default_rng(seed)
    for _ in range(12):
        actions = random_actions(rng, many)
        one, other = few.step(actions[:2]), many.step(actions)
        np.testing.assert_array_equal(one.rewards, other.rewards[:2])
        np.testing.assert_array_equal(one.problems.costs_q, other.problems.costs_q[:2])
        np.testing.assert_array_equal(few.views().costs_q, many.views().costs_q[: 2 * 4])
        np.testing.assert_array_equal(few.views().ages_rounds, many.views().ages_rounds[: 2 * 4])


@pytest.mark.parametrize("loss", [0.0, 0.4])
def test_a_restored_environment_goes_on_as_the_one_that_gave_its_state(loss):
    parts = {
        "copies": 3,
        "agents": 4,
        "tasks": 5,
        "turnover": "on_completion",
        "loss": loss,
        "handover_gain_s": 0.5,
    }
    one, other = env_of(seed=1, **parts), env_of(seed=2, **parts)
    rng = np.random.default_rng(0)
    for _ in range(9):
        one.step(random_actions(rng, one))
    other.restore(one.state())
    for _ in range(9):
        actions = random_actions(rng, one)
        np.testing.assert_array_equal(one.step(actions).rewards, other.step(actions).rewards)
        np.testing.assert_array_equal(one.views().costs_q, other.views().costs_q)
        np.testing.assert_array_equal(one.views().ages_rounds, other.views().ages_rounds)


def test_other_seeds_and_copies_have_other_worlds():
    sites = [env_of(copies=3, seed=seed, agents=3, tasks=6).hidden.site for seed in (0, 1)]
    rows = {tuple(row) for array in sites for row in array.tolist()}
    assert len(rows) == 6


def test_starts_and_sites_are_all_different_and_cover_the_pool():
    env = env_of(copies=40, agents=24, tasks=22)
    for e in range(40):
        ugvs, uavs = env.hidden.place[e, :12], env.hidden.place[e, 12:]
        assert len(set(ugvs.tolist())) == len(set(uavs.tolist())) == 12
    assert set(env.hidden.site.ravel().tolist()) == set(range(22))
    assert set(env.hidden.world.tolist()) == {0, 1, 2}


# ---- handover ----


def on_its_way(gain_s: float):
    """Agent 0 has a long way to slot 0; agent 1 serves slot 1 close by, and is then the nearer one."""
    env = env_of(
        copies=1,
        pool=corridor(),
        agents=2,
        tasks=2,
        uav_share=0.0,
        turnover="on_completion",
        handover_gain_s=gain_s,
        step_s=0.25,
        episode_steps=1000,
    )
    state, cells = env.hidden, env.pool.places_cell[0, UGV, :, 0]
    starts, sites = np.argsort(cells[:20]), np.argsort(cells[20:])
    state.place[0] = starts[0], starts[-1]
    state.taken[0] = False
    state.site[0] = sites[-2], sites[-1]
    state.taken[0, state.site[0]] = True
    state.new_row[0] = True
    env.step([[0, 0]])
    return env


def served_after(env, patience: int = 100) -> int:
    """Steps until slot 0 is served, where a free agent takes slot 0 if it waits, agent 1 slot 1 at first."""
    generation = env.hidden.generation[0, 0]
    problems = env.step([[1, 2]]).problems
    for number in range(2, patience):
        actions = [0, 0]
        for agent in range(2):
            if problems.problem(0).eligible[agent, 0]:
                actions[agent] = 1
        problems = env.step([actions]).problems
        if env.hidden.generation[0, 0] != generation:
            return number
    raise AssertionError("never served")


def test_a_task_is_handed_over_to_an_idle_agent_that_is_there_sooner_and_time_is_saved():
    assert served_after(on_its_way(1.0)) < served_after(on_its_way(np.inf)) - 4
    assert served_after(on_its_way(60.0)) == served_after(on_its_way(np.inf)), "not for a gain of less"


def test_who_hands_over_stops_where_it_is_and_leaves_that_task_alone():
    env = on_its_way(1.0)
    step = env.step([[1, 2]])
    elapsed_ms = 0
    while not step.events.released[0, 0]:
        elapsed_ms += 250
        step = env.step([[0, 0]])
    problems, state = step.problems, env.hidden
    assert problems.available[0].all()
    assert problems.waiting[0, 0]
    assert problems.costs_q[0, 0, 0] == UNREACHABLE_CODE
    assert problems.costs_q[0, 1, 0] != UNREACHABLE_CODE
    begun_x = env.pool.places_cell[0, UGV, state.origin[0, 0], 0]
    assert state.own_cell[0, 0, 0] - begun_x == pytest.approx(elapsed_ms / 1000 * 3.0, abs=0.6)
    row = env.pool.row_from(0, UGV, state.own_cell[0, 0])
    assert problems.costs_q[0, 0, 1] == env.pool.code_of_ms[row[state.site[0, 1]]]
    step = env.step([[1, 1]])
    assert step.events.allocated[0].tolist() == [-1, 0]
    assert env.hidden.destination[0, 1] == env.hidden.site[0, 0]


# ---- what is refused ----


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"turnover": "sometimes"}, "turnover = 'sometimes': must be one of never, on_claim"),
        ({"agents": 0}, "agents = 0"),
        ({"agents": 25}, "agents = 25: the radio and 24 starts have room for 1 .. 24"),
        ({"tasks": 23}, "tasks = 23"),
        ({"tasks": 22, "turnover": "on_claim"}, "tasks = 22"),
        ({"loss": 1.5}, "loss = 1.5"),
        ({"step_s": float("nan")}, "step_s = nan"),
        ({"loss": 0.1, "step_s": 0.01}, "step_s = 0.01: 10 STATEs take 0.010 s of air"),
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(wrong, says):
    with pytest.raises(ConfigError, match=says.replace(".", r"\.")):
        env_of(**wrong)


def test_airborne_tasks_need_airborne_sites():
    with pytest.raises(ConfigError, match="needs worlds with airborne_sites"):
        env_of(pool=corridor(), airborne_tasks=0.5)


@pytest.mark.parametrize("actions", [[[0, 4]], [[0, -1]], [[0]], [0, 0]])
def test_actions_of_another_shape_or_range_are_refused(actions):
    env = env_of(copies=1, agents=2, tasks=3, pool=small_pool())
    with pytest.raises(ValueError, match="actions"):
        env.step(actions)
