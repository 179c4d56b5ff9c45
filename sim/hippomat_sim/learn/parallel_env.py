"""The environment as a PettingZoo ParallelEnv, for others' algorithms: one copy of VectorEnv, agents by name.

Every agent sees what it holds: the common snapshot, or under loss its own view of it. Knows no rule and no
reward of its own. API: https://pettingzoo.farama.org/api/parallel/
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from hippomat_core.allocation.port import Problem
from hippomat_sim.learn.env import Step, VectorEnv
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.settings import EnvSettings
from hippomat_sim.learn.world_pool import WorldPool, make_pool

Observation = dict[str, Any]  # see observation_space_of
FLAGS = ("available", "busy", "waiting", "present", "assigned")  # of Problem


def agent_name(robot: int) -> str:
    return f"agent_{robot}"


def observation_space_of(settings: EnvSettings) -> spaces.Dict:
    """What an agent observes: x_i, what it may request, its index, and the snapshot as Problem has it."""
    agents, tasks = settings.agents, settings.tasks
    return spaces.Dict(
        {
            "observation": spaces.Box(-1.0, 1.0, (1 + 2 * tasks,), np.float32),  # x_i of the paper
            "action_mask": spaces.MultiBinary(1 + tasks),  # 1 = reachable and waiting; no request is always 1
            "self_index": spaces.Discrete(agents),
            "costs_q": spaces.Box(0, 255, (agents, tasks), np.uint8),
            "available": spaces.MultiBinary(agents),
            "busy": spaces.MultiBinary(agents),
            "waiting": spaces.MultiBinary(tasks),
            "present": spaces.MultiBinary(agents),
            "assigned": spaces.MultiBinary(agents),
            "ages_rounds": spaces.Box(0.0, np.inf, (agents,), np.float32),
        }
    )


def action_space_of(settings: EnvSettings) -> spaces.Space[Any]:
    """0 = no request, j = task slot j - 1."""
    return spaces.Discrete(1 + settings.tasks)


class AllocationParallelEnv(ParallelEnv[str, Observation, int]):  # type: ignore[misc]  # it has no types
    """All agents act in every step and end together. Same seed, same actions: the trajectory of VectorEnv.

    infos: "allocated" (the slot that the agent got, else -1) and "travel_s" (its path time, 0 without).
    """

    metadata = {"name": "hippomat_allocation_v0", "render_modes": [], "is_parallelizable": True}  # noqa: RUF012

    def __init__(self, settings: EnvSettings, pool: WorldPool | None = None, seed: int = 0) -> None:
        """pool: None makes (or finds in the cache) the training worlds of settings.world."""
        self.settings = settings
        self.possible_agents = [agent_name(robot) for robot in range(settings.agents)]
        self.agents: list[str] = []
        self._pool = make_pool(settings.world) if pool is None else pool
        self._env = VectorEnv(settings, self._pool, 1, seed)
        self._begun: ProblemBatch | None = None  # the next episode, which VectorEnv begins by itself
        self._observation_spaces = {name: observation_space_of(settings) for name in self.possible_agents}
        self._action_spaces = {name: action_space_of(settings) for name in self.possible_agents}

    def observation_space(self, agent: str) -> spaces.Space[Observation]:
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        return self._action_spaces[agent]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002 - there are none
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begins the next episode; a seed begins a new sequence of episodes."""
        if seed is not None:
            self._env = VectorEnv(self.settings, self._pool, 1, seed)
            self._begun = None
        seen = self._held(self._env.reset()) if self._begun is None else self._begun
        self._begun = None
        self.agents = list(self.possible_agents)
        return self._observations(seen), {name: {} for name in self.agents}

    def step(
        self, actions: dict[str, int]
    ) -> tuple[
        dict[str, Observation],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """An agent without an action requests nothing. The observations of the last step end the episode."""
        names = self.possible_agents
        chosen = np.array([[actions.get(name, 0) for name in names]], np.int64)
        step = self._env.step(chosen)
        rewards = {name: float(reward) for name, reward in zip(names, step.rewards[0], strict=True)}
        terminated, truncated = bool(step.terminated[0]), bool(step.truncated[0])
        infos, seen = self._infos(step), self._held(step.problems)
        if step.final is not None:
            self._begun, seen, self.agents = seen, step.final, []
        observations = self._observations(seen)
        return observations, rewards, dict.fromkeys(names, terminated), dict.fromkeys(names, truncated), infos

    def _held(self, problems: ProblemBatch) -> ProblemBatch:
        """What the agents hold, copied: one snapshot for all, or under loss one for each."""
        held = problems if self.settings.loss == 0.0 else self._env.views()
        return held.take(np.arange(len(held)))

    def _observations(self, seen: ProblemBatch) -> dict[str, Observation]:
        """Agents that hold the same snapshot share its arrays."""
        shared = [_observation_arrays(seen.problem(index)) for index in range(len(seen))]
        return {
            name: _own(shared[robot if len(shared) > 1 else 0], robot)
            for robot, name in enumerate(self.possible_agents)
        }

    def _infos(self, step: Step) -> dict[str, dict[str, Any]]:
        slots, travel_ms = step.events.allocated[0], step.events.travel_ms[0]
        return {
            name: {"allocated": int(slot), "travel_s": float(time_ms) / 1000.0 if slot >= 0 else 0.0}
            for name, slot, time_ms in zip(self.possible_agents, slots, travel_ms, strict=True)
        }


def _observation_arrays(problem: Problem) -> dict[str, NDArray[Any]]:
    """Everything of an observation that does not depend on whose it is; x and masks of all robots."""
    flags = {name: getattr(problem, name).astype(np.int8) for name in FLAGS}
    masks = np.ones((len(problem.available), 1 + len(problem.waiting)), np.int8)
    masks[:, 1:] = problem.eligible
    return {
        "observation": problem.observations(),
        "action_mask": masks,
        "costs_q": problem.costs_q,
        "ages_rounds": problem.ages_rounds,
        **flags,
    }


def _own(arrays: dict[str, NDArray[Any]], robot: int) -> Observation:
    own = {"observation": arrays["observation"][robot], "action_mask": arrays["action_mask"][robot]}
    return arrays | own | {"self_index": np.int64(robot)}
