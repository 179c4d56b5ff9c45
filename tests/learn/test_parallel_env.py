"""The PettingZoo environment: its API, and the same trajectories as VectorEnv."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test

from hippomat_sim.learn.env import VectorEnv
from hippomat_sim.learn.parallel_env import FLAGS, AllocationParallelEnv, Observation, agent_name
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.settings import EnvSettings, WorldSettings
from hippomat_sim.learn.world_pool import WorldPool, make_pool

SMALL_WORLD = WorldSettings(
    size_m=(14, 14, 8), obstacles=5, obstacle_side_m=(2, 3), sites=24, airborne_sites=4, starts=16, worlds=2
)
SETTINGS = {
    "fixed": EnvSettings(agents=5, tasks=4, episode_steps=12, world=SMALL_WORLD),
    "continuous": EnvSettings(agents=4, tasks=6, turnover="on_claim", episode_steps=20, world=SMALL_WORLD),
    "until served": EnvSettings(
        agents=4, tasks=6, turnover="on_completion", episode_steps=20, airborne_tasks=0.3, world=SMALL_WORLD
    ),
    "loss": EnvSettings(
        agents=4, tasks=6, turnover="on_claim", episode_steps=20, loss=0.4, relay=False, world=SMALL_WORLD
    ),
}


@pytest.fixture(scope="module")
def pool() -> WorldPool:
    return make_pool(SMALL_WORLD, cache=False)


def policy(masks: np.ndarray, round_number: int) -> np.ndarray:
    """(N,) some actions that depend on what is seen; now and then one that is not allowed."""
    random = np.random.default_rng(round_number)
    scores = random.random(masks.shape) + masks * (round_number % 5 != 0)
    return scores.argmax(axis=1)


@pytest.mark.parametrize("name", SETTINGS)
def test_pettingzoos_own_test_passes_without_a_warning(name: str, pool: WorldPool) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(AllocationParallelEnv(SETTINGS[name], pool), num_cycles=300)


@pytest.mark.parametrize("name", SETTINGS)
def test_every_observation_lies_in_its_space(name: str, pool: WorldPool) -> None:
    env = AllocationParallelEnv(SETTINGS[name], pool, seed=4)
    observations, _ = env.reset()
    for number in range(60):
        for agent, seen in observations.items():
            assert env.observation_space(agent).contains(seen), agent
        if not env.agents:
            observations, _ = env.reset()
        masks = np.stack([observations[agent]["action_mask"] for agent in env.agents])
        actions = dict(zip(env.agents, policy(masks, number), strict=True))
        observations, _, _, _, _ = env.step(actions)


@pytest.mark.parametrize("name", SETTINGS)
def test_its_trajectories_are_those_of_the_vectorised_environment(name: str, pool: WorldPool) -> None:
    env, vector = (
        AllocationParallelEnv(SETTINGS[name], pool, seed=7),
        VectorEnv(SETTINGS[name], pool, 1, seed=7),
    )
    observations, _ = env.reset()
    assert_same(observations, held(vector, vector.reset()))
    ends = 0
    for number in range(90):
        masks = np.stack([observations[agent]["action_mask"] for agent in env.agents])
        chosen = policy(masks, number)
        observations, rewards, terminated, truncated, infos = env.step(
            dict(zip(env.agents, chosen, strict=True))
        )
        step = vector.step(chosen[None])
        assert list(rewards.values()) == step.rewards[0].tolist()
        assert set(terminated.values()) == {bool(step.terminated[0])}
        assert set(truncated.values()) == {bool(step.truncated[0])}
        assert [info["allocated"] for info in infos.values()] == step.events.allocated[0].tolist()
        assert [info["travel_s"] for info in infos.values()] == (step.events.travel_ms[0] / 1000.0).tolist()
        if step.final is not None:
            assert env.agents == []
            assert_same(observations, step.final)
            observations, _ = env.reset()
            ends += 1
        assert_same(observations, held(vector, step.problems))
    assert ends >= 2


def test_a_seed_begins_the_same_episodes_again(pool: WorldPool) -> None:
    env = AllocationParallelEnv(SETTINGS["continuous"], pool, seed=1)
    first, _ = env.reset(seed=11)
    other, _ = env.reset()
    again, _ = env.reset(seed=11)
    name = agent_name(0)
    np.testing.assert_array_equal(first[name]["costs_q"], again[name]["costs_q"])
    assert (first[name]["costs_q"] != other[name]["costs_q"]).any()


def test_an_observation_stays_as_it_was_when_the_environment_goes_on(pool: WorldPool) -> None:
    env = AllocationParallelEnv(SETTINGS["continuous"], pool, seed=1)
    before, _ = env.reset()
    kept = {name: value.copy() for name, value in before[agent_name(1)].items()}
    for _ in range(5):
        env.step(dict.fromkeys(env.agents, 1))
    for name, value in before[agent_name(1)].items():
        np.testing.assert_array_equal(value, kept[name])


def test_who_says_nothing_requests_nothing(pool: WorldPool) -> None:
    silent, explicit = (AllocationParallelEnv(SETTINGS["fixed"], pool, seed=3) for _ in range(2))
    silent.reset()
    explicit.reset()
    assert silent.step({})[1] == explicit.step(dict.fromkeys(explicit.agents, 0))[1]


def held(env: VectorEnv, problems: ProblemBatch) -> ProblemBatch:
    return problems if env.settings.loss == 0.0 else env.views()


def assert_same(observations: dict[str, Observation], seen: ProblemBatch) -> None:
    for robot, observed in enumerate(observations.values()):
        problem = seen.problem(robot if len(seen) > 1 else 0, robot)
        assert observed["self_index"] == robot
        np.testing.assert_array_equal(observed["observation"], problem.observations()[robot])
        np.testing.assert_array_equal(observed["action_mask"][1:], problem.eligible[robot])
        for name in ("costs_q", "ages_rounds", *FLAGS):
            np.testing.assert_array_equal(observed[name], getattr(problem, name))
