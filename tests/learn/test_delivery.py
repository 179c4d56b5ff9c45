"""What agents hold under loss: ages, rows never heard, claims as far as known; relays against real radios."""

from __future__ import annotations

import numpy as np
import pytest
from env_lab import UNREACHABLE_CODE, env_of, held, random_actions
from hypothesis import given, settings
from hypothesis import strategies as st

from hippomat_sim.bench.radio_run import RadioRun
from hippomat_sim.bench.radio_settings import RadioSettings
from hippomat_sim.learn.delivery import air_of, held_after_a_round
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.settings import EnvSettings

TURNOVERS = ("never", "on_claim", "on_completion")
ROW_ARRAYS = ("available", "busy", "assigned", "present")


def by_agent(views: ProblemBatch, agents: int) -> dict[str, np.ndarray]:
    """(E, N, N, ..) [copy, holder, row]; waiting: (E, N, M)."""
    names = (*ROW_ARRAYS, "costs_q", "ages_rounds", "waiting")
    return {name: getattr(views, name).reshape(-1, agents, *getattr(views, name).shape[1:]) for name in names}


# ---- rows and their ages ----


@settings(max_examples=12, deadline=None)
@given(st.sampled_from(TURNOVERS), st.booleans(), st.sampled_from((0.1, 0.6)), st.integers(0, 2**32))
def test_a_row_is_new_or_one_round_older_than_it_was(turnover, relay, loss, seed):
    agents = 5
    env = env_of(
        copies=3, seed=seed, agents=agents, tasks=4, turnover=turnover, loss=loss, relay=relay, dead_s=np.inf
    )
    rng = np.random.default_rng(seed)
    truth = env.reset()
    before = None
    ended = np.ones(3, bool)
    for _ in range(10):
        now = by_agent(held(env.views()), agents)
        ages = now["ages_rounds"]
        assert (ages[:, np.arange(agents), np.arange(agents)] == 0).all(), "one's own row is what one sends"
        for e, i, k in np.ndindex(*ages.shape):
            if ages[e, i, k] == 0:
                assert (now["costs_q"][e, i, k] == truth.costs_q[e, k]).all()
                assert all(now[name][e, i, k] == getattr(truth, name)[e, k] for name in ROW_ARRAYS)
            elif np.isinf(ages[e, i, k]):
                assert ended[e] or np.isinf(before["ages_rounds"][e, i, k])
                assert not any(now[name][e, i, k] for name in ROW_ARRAYS)
                assert (now["costs_q"][e, i, k] == UNREACHABLE_CODE).all()
            else:
                assert ages[e, i, k] == before["ages_rounds"][e, i, k] + 1
                assert (now["costs_q"][e, i, k] == before["costs_q"][e, i, k]).all()
                assert all(now[name][e, i, k] == before[name][e, i, k] for name in ROW_ARRAYS)
        before = now
        step = env.step(random_actions(rng, env))
        truth, ended = step.problems, step.terminated | step.truncated


def test_without_relay_frames_arrive_as_often_as_they_should():
    held_rows = held_after_a_round(EnvSettings(agents=12, loss=0.3, relay=False), 400, 0)
    others = ~np.eye(12, dtype=bool)
    assert held_rows[:, others].mean() == pytest.approx(0.7, abs=0.01)
    assert held_rows[:, ~others].all()
    assert np.abs(held_rows.mean(0)[others] - 0.7).max() < 0.1


def test_who_is_unheard_for_too_long_takes_no_part_until_heard_again():
    env = env_of(
        copies=1, agents=4, tasks=4, turnover="on_claim", loss=0.9, relay=False, dead_s=1.0, episode_steps=500
    )
    env.reset()
    seen_late = seen_dead = 0
    for _ in range(200):
        now = by_agent(env.views(), 4)
        ages, heard = now["ages_rounds"][0], np.isfinite(now["ages_rounds"][0])
        assert (now["present"][0] == (heard & (ages <= 4))).all()
        assert not (now["available"] & ~now["present"]).any()
        seen_late, seen_dead = seen_late + (ages > 0).sum(), seen_dead + (heard & (ages > 4)).sum()
        env.step([[0, 0, 0, 0]])
    assert seen_late
    assert seen_dead


def test_a_task_waits_for_those_who_have_not_heard_of_its_claim():
    agents, copies = 5, 20
    env = env_of(copies=copies, agents=agents, tasks=8, loss=0.7, relay=False)
    env.reset()
    env.step(np.tile([1, 2, 3, 0, 0], (copies, 1)))
    now, slot = by_agent(env.views(), agents), env.hidden.slot
    unaware = 0
    for e, i, k in np.ndindex(copies, agents, 3):
        assert slot[e, k] == k
        heard = now["ages_rounds"][e, i, k] == 0
        assert now["waiting"][e, i, k] == (not heard)
        unaware += not heard
    assert unaware
    assert now["waiting"][:, :, 3:].all()
    step = env.step(np.tile([0, 0, 0, 1, 1], (copies, 1)))
    assert (step.events.allocated == -1).all()
    assert (step.rewards[:, 3:] == -1.0).all(), "the task is another one's: as if both had asked at once"
    assert (step.events.conflicted_tasks == 1).all()


def test_the_final_views_of_an_episode_are_those_of_every_agent_before_the_next_begins():
    env = env_of(copies=3, agents=4, tasks=4, loss=0.6, relay=False, episode_steps=2, turnover="on_claim")
    env.reset()
    assert env.step(np.zeros((3, 4), int)).final is None
    step = env.step(np.zeros((3, 4), int))
    assert step.final is not None
    assert step.final.costs_q.shape == (12, 4, 4)
    assert np.isfinite(step.final.ages_rounds).sum() > np.isfinite(env.views().ages_rounds).sum()
    assert set(np.unique(env.views().ages_rounds)) <= {0.0, np.inf}, "nobody remembers the last episode"


def test_without_loss_every_view_is_the_common_snapshot():
    env = env_of(copies=2, agents=3, tasks=3)
    problems, views = env.reset(), env.views()
    np.testing.assert_array_equal(views.costs_q, problems.costs_q.repeat(3, axis=0))
    assert views.present.all()


def test_losses_leave_worlds_and_tasks_as_they_are():
    parts = {"agents": 4, "tasks": 4, "turnover": "on_claim"}
    quiet, lossy = env_of(**parts), env_of(**parts, loss=0.5)
    for _ in range(8):
        actions = random_actions(np.random.default_rng(3), quiet)
        np.testing.assert_array_equal(
            quiet.step(actions).problems.costs_q, lossy.step(actions).problems.costs_q
        )


# ---- relays ----


@pytest.mark.parametrize(
    ("robots", "loss", "tolerance"), [(10, 0.5, 0.01), (30, 0.3, 0.005), (30, 0.5, 0.02)]
)
def test_relays_complete_as_many_snapshots_as_those_of_real_radio_cores(robots, loss, tolerance):
    """Complete robots at the end of a round; radios estimate the loss of their links, the model knows it."""
    radios = RadioRun(
        RadioSettings(nodes=robots, tasks=30, loss=loss, seconds=15.0, stops=0), lambda _: None
    ).execute()
    asked = EnvSettings(agents=robots, tasks=30, step_s=0.1, loss=loss)
    model = held_after_a_round(asked, 500, 1)
    assert model.all(axis=2).mean() == pytest.approx(radios.complete, abs=tolerance)
    others = ~np.eye(robots, dtype=bool)
    assert model[:, others].mean() == pytest.approx(radios.rows.mean, abs=tolerance / 5)


@pytest.mark.parametrize(
    ("agents", "tasks", "step_s", "relays", "rows"),
    [
        (30, 30, 0.1, 2, 5),
        (30, 30, 0.05, 0, 5),
        (20, 30, 0.05, 1, 5),
        (32, 80, 0.1, 2, 2),
        (64, 30, 0.25, 2, 4),
    ],
)
def test_only_relays_that_fit_into_the_rounds_airtime_are_sent(agents, tasks, step_s, relays, rows):
    air = air_of(EnvSettings(agents=agents, tasks=tasks, step_s=step_s, loss=0.1))
    assert (air.relays, air.rows_per_relay) == (relays, rows)


def test_one_relay_phase_helps_and_two_help_more():
    complete = [
        held_after_a_round(EnvSettings(agents=20, tasks=30, step_s=step_s, loss=0.5), 200, 0)
        .all(axis=2)
        .mean()
        for step_s in (0.04, 0.05, 0.1)
    ]
    assert complete[0] < 0.01 < 0.4 < complete[1] < 0.95 < complete[2]
