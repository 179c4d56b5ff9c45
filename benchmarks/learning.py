"""The cases of learning: what a step of the environment costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from benchmarks.measure import Result, compare
from hippomat_sim.learn.env import VectorEnv
from hippomat_sim.learn.parallel_env import AllocationParallelEnv
from hippomat_sim.learn.settings import EnvSettings, WorldSettings
from hippomat_sim.learn.world_pool import WorldPool, make_pool

AGENTS = TASKS = 30
COPIES = 256


def env_step_fixed() -> Result:
    """Every agent requests a slot of its own: each step ends an episode: the dearest step."""
    everyone_its_own = np.arange(1, AGENTS + 1)
    return _env_step("fixed", "never", np.tile(everyone_its_own, (1, COPIES, 1)))


def env_step_continuous() -> Result:
    """Random requests, after a while in which most agents have become busy."""
    return _env_step(
        "continuous", "on_claim", np.random.default_rng(0).integers(0, TASKS + 1, (64, COPIES, AGENTS))
    )


def _env_step(name: str, turnover: str, actions: NDArray[np.int64]) -> Result:
    """Per copy. actions: (K, E, N), over and over."""
    settings = EnvSettings(agents=AGENTS, tasks=TASKS, turnover=turnover)
    many, one = VectorEnv(settings, _pool(), COPIES, 0), AllocationParallelEnv(settings, _pool())
    one.reset()
    turns = cycle(actions)
    for _ in range(2 * len(actions)):
        many.step(next(turns))
    asked = cycle([dict(zip(one.possible_agents, row.tolist(), strict=True)) for row in actions[:, 0]])

    def step_of_one() -> None:
        one.step(next(asked))
        if not one.agents:
            one.reset()

    found = compare(
        f"environment step of one copy, {name}, N = M = {AGENTS}",
        lambda: many.step(next(turns)),
        "the same as a PettingZoo env",
        step_of_one,
        pairs=7,
    )
    return replace(found, ours_us=found.ours_us / COPIES, ratio=found.ratio * COPIES)


@cache
def _pool() -> WorldPool:
    """Worlds half as wide as the paper's: what a step costs does not depend on it, making them does."""
    settings = WorldSettings(size_m=(25, 25, 15), obstacles=10, starts=256, worlds=4)
    return make_pool(settings, cache=False)


CASES: dict[str, Callable[[], Result]] = {
    case.__name__: case for case in (env_step_fixed, env_step_continuous)
}
