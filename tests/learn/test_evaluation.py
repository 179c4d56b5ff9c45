"""How methods are measured: rounds, conflicts, costs, and that everyone meets the same problems."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from world_samples import SMALL

from hippomat_core.errors import ConfigError
from hippomat_sim.learn.env import VectorEnv
from hippomat_sim.learn.evaluation import (
    fleet_actions,
    play_continuous,
    play_first_requests,
    play_one_shot,
    play_optimum,
    play_permuted,
    resolve,
)
from hippomat_sim.learn.instances import Instances, draw_instances
from hippomat_sim.learn.method_registry import Sources, make_method
from hippomat_sim.learn.methods import Actions, AllocatorMethod, Method, distinct
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.runs import Fleet
from hippomat_sim.learn.settings import EnvSettings
from hippomat_sim.learn.world_pool import WorldPool, make_pool

WORLD = replace(SMALL, sites=40, starts=24)


@pytest.fixture(scope="module")
def pool() -> WorldPool:
    return make_pool(WORLD, "test", cache=False)


def method(name: str, agents: int, tasks: int) -> Method:
    """A method that needs no weights."""
    return make_method(name, Fleet(agents, tasks, "never"), Sources(Path("nowhere")))


def instances_of(costs_ms: list[list[int]]) -> Instances:
    """One instance; a code is a hundredth of its time."""
    travel = np.array([costs_ms], np.uint16)
    return Instances(travel, (travel // 100).astype(np.uint8), np.zeros(1, np.int64))


@dataclass(frozen=True)
class Scripted:
    """Says the same to every problem. fixed: (N,) actions."""

    fixed: tuple[int, ...]
    fingerprint: str = ""

    def actions(self, problems: ProblemBatch, seeds: Actions, round_number: int) -> Actions:  # noqa: ARG002
        return np.tile(self.fixed, (len(problems), 1))

    def own_actions(self, views: ProblemBatch, selves: Actions, seeds: Actions, round_number: int) -> Actions:
        return self.actions(views, seeds, round_number)[np.arange(len(views)), selves]


def test_losers_ask_again_until_all_are_served() -> None:
    # Both want slot 0; robot 1 is nearer. In the second round robot 0 takes slot 1.
    figures = play_one_shot(method("nearest", 2, 2), instances_of([[300, 2000], [200, 1500]]))
    assert {name: values.tolist() for name, values in figures.items()} == {
        "single": [0],
        "rounds": [2],
        "clean": [1],
        "cost_ms": [2200],
        "left": [0],
        "world": [0],
    }


def test_equal_codes_go_to_the_smaller_id() -> None:
    problems = instances_of([[310, 900], [390, 100]]).problems(
        np.array([0]), np.ones((1, 2), np.bool_), np.ones((1, 2), np.bool_)
    )
    winners, asking = resolve(np.array([[1, 1]]), problems)
    assert winners.tolist() == [[0, -1]]
    assert asking.tolist() == [[2, 0]]


def test_what_cannot_be_had_is_no_request() -> None:
    travel, codes = np.array([[[100, 65535]]], np.uint16), np.array([[[1, 255]]], np.uint8)
    instances = Instances(travel, codes, np.zeros(1, np.int64))
    free, waiting = np.ones((1, 1), np.bool_), np.array([[False, True]])
    for action in (1, 2):
        winners, asking = resolve(np.array([[action]]), instances.problems(np.array([0]), free, waiting))
        assert (winners.max(), asking.sum()) == (-1, 0)


def test_who_asks_for_nothing_is_given_what_is_left_and_it_costs() -> None:
    figures = play_one_shot(Scripted((2, 0)), instances_of([[300, 2000], [200, 1500]]))
    assert (figures["left"].tolist(), figures["cost_ms"].tolist()) == ([1], [2200])
    assert figures["rounds"].tolist() == [2]  # the second one showed that nobody asks


def test_no_method_is_cheaper_than_the_optimum_and_hungarian_nearly_reaches_it(pool: WorldPool) -> None:
    instances = draw_instances(pool, 40, 6, 6, seed=1)
    least = play_optimum(instances)["cost_ms"]
    for name in ("hungarian", "greedy", "nearest", "random", "fixed_slot", "auction", "ipso_g"):
        figures = play_one_shot(method(name, 6, 6), instances)
        assert (figures["cost_ms"] >= least).all(), name
        assert (figures["left"] == 0).all(), name
        if name in ("hungarian", "greedy", "fixed_slot", "auction"):
            assert (figures["single"] == 6).all(), name
            assert (figures["rounds"] == 1).all(), name
    gap = play_one_shot(method("hungarian", 6, 6), instances)["cost_ms"].sum() / least.sum() - 1.0
    assert gap < 0.01  # the rounding to 8 bits alone


def test_more_instances_begin_with_the_same_ones(pool: WorldPool) -> None:
    few, many = draw_instances(pool, 3, 4, 5, seed=7), draw_instances(pool, 8, 4, 5, seed=7)
    assert np.array_equal(few.travel_ms, many.travel_ms[:3])
    assert not np.array_equal(few.travel_ms, draw_instances(pool, 3, 4, 5, seed=8).travel_ms)


def test_a_size_that_no_world_holds_is_refused(pool: WorldPool) -> None:
    with pytest.raises(ConfigError, match="too many"):
        draw_instances(pool, 1, 4, 1000, seed=0)


def test_permuted_slots_tell_who_looks_at_the_tasks(pool: WorldPool) -> None:
    instances = draw_instances(pool, 20, 5, 5, seed=3)
    blind = play_permuted(method("fixed_slot", 5, 5), instances, seed=0)
    assert np.array_equal(blind["same_slot"], blind["asked"])
    seeing = play_permuted(method("hungarian", 5, 5), instances, seed=0)
    assert seeing["same_task"].sum() >= 0.9 * seeing["asked"].sum()  # ties may go another way
    assert seeing["same_slot"].sum() < seeing["asked"].sum()


def test_robots_with_the_same_view_share_one_decision() -> None:
    view = instances_of([[300, 2000], [200, 1500]]).problems(
        np.array([0, 0, 0]), np.ones((3, 2), np.bool_), np.ones((3, 2), np.bool_)
    )
    view.costs_q[1, 0, 0] += 1
    first, which = distinct(view)
    assert (first.tolist(), which.tolist()) == ([0, 1], [0, 1, 0])
    selves, seeds = np.array([0, 1, 1]), np.zeros(3, np.int64)
    greedy = method("greedy", 2, 2)
    alone = AllocatorMethod(greedy.allocator, alone=True)  # type: ignore[attr-defined]
    assert np.array_equal(
        greedy.own_actions(view, selves, seeds, 0), alone.own_actions(view, selves, seeds, 0)
    )


def test_continuous_figures_add_up(pool: WorldPool) -> None:
    settings = EnvSettings(agents=4, tasks=8, turnover="on_claim", episode_steps=60, world=WORLD)
    figures = play_continuous(method("hungarian", 4, 8), settings, pool, 3, seed=0, warm_up_steps=10)
    assert (figures["steps"] == 60).all()
    assert (figures["served"] > 0).all()
    assert np.array_equal(
        figures["served"], figures["requested"]
    )  # nobody asks for what another one asks for
    assert (figures["contested"] == 0).all()
    assert (figures["cost_ms"] > 0).all()
    crowded = play_continuous(method("nearest", 4, 8), settings, pool, 3, seed=0, warm_up_steps=10)
    assert crowded["contested"].sum() > 0
    again = play_continuous(method("nearest", 4, 8), settings, pool, 2, seed=0, warm_up_steps=10)
    assert np.array_equal(again["cost_ms"], crowded["cost_ms"][:2])  # fewer copies are the first ones


def test_losses_make_conflicts_and_relays_remove_them(pool: WorldPool) -> None:
    def share(loss: float, relay: bool) -> float:
        settings = EnvSettings(agents=5, tasks=5, loss=loss, relay=relay, world=WORLD)
        figures = play_first_requests(method("hungarian", 5, 5), settings, pool, 60, seed=0)
        return float(figures["single"].mean()) / 5

    assert share(0.0, True) == 1.0
    assert share(0.5, False) < share(0.5, True)


def test_figures_say_in_which_world_they_are(pool: WorldPool) -> None:
    instances = draw_instances(pool, 40, 4, 4, seed=2)
    assert set(instances.world.tolist()) == set(range(len(pool.travel_ms)))
    for travel, world in zip(instances.travel_ms, instances.world, strict=True):
        assert np.isin(travel[0], pool.travel_ms[world, 0]).all()
    greedy = method("greedy", 4, 4)
    assert np.array_equal(play_one_shot(greedy, instances)["world"], instances.world)
    assert np.array_equal(play_permuted(greedy, instances, 0)["world"], instances.world)


def test_a_copy_of_continuous_tasks_stays_in_its_world(pool: WorldPool) -> None:
    settings = EnvSettings(agents=4, tasks=8, turnover="on_claim", episode_steps=60, world=WORLD)
    hungarian = method("hungarian", 4, 8)
    figures = play_continuous(hungarian, settings, pool, 30, seed=0, warm_up_steps=10)
    env = VectorEnv(replace(settings, episode_steps=71), pool, 30, seed=0)
    problems = env.reset()
    worlds = env.hidden.world.copy()
    assert set(worlds.tolist()) == set(range(len(pool.travel_ms)))
    for number in range(70):
        problems = env.step(fleet_actions(hungarian, env, problems, number)).problems
    assert np.array_equal(env.hidden.world, worlds)
    assert np.array_equal(figures["world"], worlds)
