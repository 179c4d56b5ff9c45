"""The environment for Ray RLlib, registered as `hippomat-allocation` when this module is imported.

    PPOConfig().environment("hippomat-allocation", env_config={"settings": EnvSettings(agents=10, tasks=10)})

env_config: "settings" an EnvSettings (its defaults where left out), "seed" a number, "team_reward" true pays
every agent R(t), the sum of all rewards, instead of its own r_i(t). Knows no rule and no reward of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from ray.rllib.env.multi_agent_env import MultiAgentEnv
from ray.tune.registry import register_env

from hippomat_sim.learn.parallel_env import AllocationParallelEnv, Observation
from hippomat_sim.learn.settings import EnvSettings, WorldSettings
from hippomat_sim.learn.world_pool import WorldPool, make_pool

ENV_NAME = "hippomat-allocation"
_SEEDS_PER_WORKER = (
    100_003  # RLlib seeds env i of worker w with seed + w + i: two workers would play the same
)


class AllocationMultiAgentEnv(MultiAgentEnv):  # type: ignore[misc]
    """AllocationParallelEnv with the key "__all__" that RLlib asks for."""

    def __init__(
        self, settings: EnvSettings, seed: int = 0, team_reward: bool = False, worker: int = 0
    ) -> None:
        super().__init__()
        self._seed_offset = worker * _SEEDS_PER_WORKER
        self._env = AllocationParallelEnv(settings, _pool(settings.world), seed + self._seed_offset)
        self._team_reward = team_reward
        self.possible_agents = self._env.possible_agents
        self.agents = list(self.possible_agents)
        self.observation_spaces = {name: self._env.observation_space(name) for name in self.agents}
        self.action_spaces = {name: self._env.action_space(name) for name in self.agents}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        return self._env.reset(None if seed is None else seed + self._seed_offset, options)

    def step(self, action_dict: dict[str, int]) -> tuple[dict[str, Any], ...]:
        observations, rewards, terminated, truncated, infos = self._env.step(action_dict)
        if self._team_reward:
            rewards = dict.fromkeys(rewards, sum(rewards.values()))
        over = {"__all__": all(terminated.values())}
        cut_off = {"__all__": all(truncated.values())}
        return observations, rewards, terminated | over, truncated | cut_off, infos


@lru_cache(maxsize=2)
def _pool(world: WorldSettings) -> WorldPool:
    """One pool for all copies of a process; another process finds it on the disk."""
    return make_pool(world)


def _made(context: Mapping[str, Any]) -> AllocationMultiAgentEnv:
    return AllocationMultiAgentEnv(
        context.get("settings", EnvSettings()),
        context.get("seed", 0),
        context.get("team_reward", False),
        getattr(context, "worker_index", 0),
    )


def register() -> None:
    """Makes the name known. Importing does it too; a Ray that is started later has to be told again."""
    register_env(ENV_NAME, _made)


register()
