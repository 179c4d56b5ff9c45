"""A small world pool, and the rules of the environment once more in plain Python."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from hippomat_core.allocation.quantise import quantise
from hippomat_sim.learn.env import VectorEnv
from hippomat_sim.learn.env_arrays import ON_THE_WAY
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.settings import EnvSettings, RewardSettings, WorldSettings
from hippomat_sim.learn.world_pool import WorldPool, make_pool

UNREACHABLE_CODE, UNREACHABLE_MS = 255, 65535


@cache
def small_pool() -> WorldPool:
    """Three worlds of 14 x 14 x 6 m, 30 sites of which 8 are in the air, 24 starts per class."""
    settings = WorldSettings(
        size_m=(14, 14, 6),
        obstacles=5,
        obstacle_height_m=(2, 5),
        sites=30,
        airborne_sites=8,
        starts=24,
        worlds=3,
    )
    return make_pool(settings, cache=False)


@cache
def corridor() -> WorldPool:
    """One straight aisle of 40 m, on the ground."""
    settings = WorldSettings(
        size_m=(40, 1, 1), obstacles=0, sites=12, airborne_sites=0, starts=20, worlds=1, seed=1
    )
    return make_pool(settings, cache=False)


def env_of(copies: int = 4, seed: int = 0, pool: WorldPool | None = None, **settings: object) -> VectorEnv:
    return VectorEnv(EnvSettings(**settings), pool or small_pool(), copies, seed)  # type: ignore[arg-type]


def random_actions(rng: np.random.Generator, env: VectorEnv, idle: float = 0.2) -> np.ndarray:
    """(E, N) anything, possible or not."""
    shape = (env.copies, env.settings.agents)
    actions = rng.integers(0, env.settings.tasks, shape, endpoint=True)
    return np.where(rng.random(shape) < idle, 0, actions)


def held(problems: ProblemBatch) -> ProblemBatch:
    """A copy that later steps leave alone."""
    return problems.take(np.arange(len(problems)))


def expected_codes(env: VectorEnv) -> np.ndarray:
    """(E, N, M) from the state and the core's quantise. Without handovers."""
    state, pool = env.hidden, env.pool
    codes = np.empty((env.copies, env.settings.agents, env.settings.tasks), np.uint8)
    for e, i, j in np.ndindex(*codes.shape):
        assert state.place[e, i] != ON_THE_WAY
        way_ms = int(pool.travel_ms[state.world[e], env.classes[i], state.place[e, i], state.site[e, j]])
        cost_s = np.inf if way_ms == UNREACHABLE_MS else (way_ms + int(state.busy_ms[e, i])) / 1000
        codes[e, i, j] = quantise(cost_s, pool.c_max_s)
    return codes


@dataclass
class Expected:
    allocated: list[int]
    rewards: list[float]
    requested: int
    conflicted: int


def expected_round(problems: ProblemBatch, e: int, actions: list[int], prices: RewardSettings) -> Expected:
    """The conflict rule and r_i, one agent after the other."""
    agents, tasks = problems.costs_q.shape[1:]
    codes = problems.costs_q[e].astype(int).tolist()
    free, waiting = problems.available[e].tolist(), problems.waiting[e].tolist()
    asking: dict[int, list[tuple[int, int]]] = {}
    for i, action in enumerate(actions):
        if action and free[i] and codes[i][action - 1] != UNREACHABLE_CODE:
            asking.setdefault(action - 1, []).append((codes[i][action - 1], i))
    winner = {slot: min(keys)[1] for slot, keys in asking.items() if waiting[slot]}
    allocated = [next((slot for slot, i in winner.items() if i == agent), -1) for agent in range(agents)]
    rewards = []
    for i, action in enumerate(actions):
        asked = any(i == agent for keys in asking.values() for _, agent in keys)
        if allocated[i] >= 0:
            cost = (codes[i][allocated[i]] / 254) ** 2
            rewards.append(-cost + (prices.low_cost_bonus if cost <= prices.low_cost else 0.0))
        elif not free[i]:
            rewards.append(-prices.busy_request if action else 0.0)
        elif asked:
            rewards.append(-prices.conflict)
        else:
            could = any(waiting[j] and codes[i][j] != UNREACHABLE_CODE for j in range(tasks))
            rewards.append(-prices.idle if could else 0.0)
    conflicted = sum(len(keys) > 1 or not waiting[slot] for slot, keys in asking.items())
    return Expected(allocated, rewards, len(asking), conflicted)
