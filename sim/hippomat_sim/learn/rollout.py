"""Experience: environments of every size in the mixture, and what happened in a few steps of one of them.

Deterministic: the seed and the actions settle everything, and state() carries it over an interruption.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hippomat_core.errors import ConfigError
from hippomat_sim.learn.env import Step, VectorEnv
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.settings import EnvSettings
from hippomat_sim.learn.train_settings import EpisodeSettings, TrainSettings
from hippomat_sim.learn.world_pool import WorldPool

# Actions (E, N) int64 and the logits (E, N, M + 1) behind them.
Act = Callable[[ProblemBatch], tuple[Tensor, Tensor]]


@dataclass(frozen=True, slots=True, eq=False)
class Rollout:
    """T steps of E copies; where one axis stands for both, it is [step * E + copy].

    With loss every agent decides on a view of its own: V = T E N of them, [(step * E + copy) * N + agent].
    Without, V = T E and all agents share a snapshot.
    """

    problems: ProblemBatch  # (T E, ..) as they were
    views: ProblemBatch  # (V, ..) what was decided on; without loss the same
    own: Tensor | None  # (V,) int64 whose view it is; None = all agents'
    actions: Tensor  # (T E, N) int64
    logits: Tensor  # (V, N, M + 1) of the policy that acted
    rewards: Tensor  # (T, E, N) r_i(t)
    team_rewards: Tensor  # (T, E) R(t)
    terminated: Tensor  # (T, E) bool
    truncated: Tensor  # (T, E) bool
    last: ProblemBatch  # (E, ..) after the last step
    finals: (
        ProblemBatch | None
    )  # (K, ..) what followed the steps that ended an episode, before the next began
    final_at: Tensor  # (K,) int64 index of those steps on the joint axis
    requested: int  # tasks that somebody requested
    conflicted: int  # of those, by several

    @property
    def agent_steps(self) -> int:
        return self.actions.numel()


class Collector:
    """Draws an ingredient of the mixture and a fleet's size per rollout; keeps an environment for each."""

    def __init__(self, settings: TrainSettings, pool: WorldPool) -> None:
        check_loss(settings)
        self._settings, self._pool = settings, pool
        self._random = np.random.default_rng((settings.seed, 1))
        shares = np.array([episode.share for episode in settings.episodes])
        self._shares = shares / shares.sum()
        self._environments: dict[tuple[int, int, int], VectorEnv] = {}

    def collect(self, act: Act) -> Rollout:
        """The next rollout of the mixture."""
        ingredient = int(self._random.choice(len(self._shares), p=self._shares))
        episode = self._settings.episodes[ingredient]
        least, most = episode.agents
        agents = int(self._random.integers(least, most + 1))
        least, most = episode.sizes(agents)
        tasks = int(self._random.integers(least, most + 1))
        return _play(self._environment(ingredient, agents, tasks), episode.fragment_steps, act)

    def state(self) -> dict[str, Any]:
        """For save_checkpoint."""
        arrays = {
            " ".join(map(str, key)): {name: torch.from_numpy(array) for name, array in env.state().items()}
            for key, env in self._environments.items()
        }
        return {"random": json.dumps(self._random.bit_generator.state), "environments": arrays}

    def restore(self, state: dict[str, Any]) -> None:
        self._random.bit_generator.state = json.loads(state["random"])
        for key, arrays in state["environments"].items():
            ingredient, agents, tasks = (int(number) for number in key.split())
            held = {name: tensor.numpy() for name, tensor in arrays.items()}
            self._environment(ingredient, agents, tasks).restore(held)

    def _environment(self, ingredient: int, agents: int, tasks: int) -> VectorEnv:
        key = (ingredient, agents, tasks)
        if key not in self._environments:
            episode = self._settings.episodes[ingredient]
            chosen = environment_of(self._settings.environment, episode, agents, tasks)
            copies = episode.copies_of(agents, tasks)
            seed = int(np.random.SeedSequence((self._settings.seed, 2, *key)).generate_state(1)[0])
            self._environments[key] = VectorEnv(chosen, self._pool, copies, seed)
        return self._environments[key]


def check_loss(settings: TrainSettings) -> None:
    """ConfigError for losses that no training takes."""
    base = settings.environment
    if base.loss > 0.0 or not base.relay:
        raise ConfigError(
            f"[environment] loss = {base.loss}, relay = {str(base.relay).lower()}: give every ingredient its "
            "own: set loss and relay in [[episodes]]"
        )
    lossy = [episode for episode in settings.episodes if episode.loss > 0.0]
    if lossy and settings.ppo.advantage != "counterfactual":
        raise ConfigError(
            f'[[episodes]] loss with advantage = "{settings.ppo.advantage}": a value of a view that only its '
            'holder has is not learned; set loss = 0 or advantage = "counterfactual"'
        )
    for episode in lossy:  # elsewhere a view may show tasks that are gone, which nothing prices
        if episode.turnover != "on_claim":
            raise ConfigError(
                f'[[episodes]] loss with turnover = "{episode.turnover}": '
                'set loss = 0 or turnover = "on_claim"'
            )


def environment_of(base: EnvSettings, episode: EpisodeSettings, agents: int, tasks: int) -> EnvSettings:
    """The environment of one ingredient at one size."""
    return replace(
        base,
        agents=agents,
        tasks=tasks,
        turnover=episode.turnover,
        episode_steps=episode.episode_steps,
        loss=episode.loss,
        relay=episode.relay,
    )


def _play(env: VectorEnv, steps: int, act: Act) -> Rollout:
    seen, held, acted, logits, finals, final_at = [], [], [], [], [], []
    agents, lossy = env.settings.agents, env.settings.loss > 0.0
    outcomes = _Outcomes(steps, env.copies, agents)
    for step in range(steps):
        problems = joined([env.problems])
        if lossy:
            held.append(joined([env.views()]))
            actions, behind = act(held[-1])
            actions = actions.view(env.copies, agents, agents).diagonal(dim1=1, dim2=2).contiguous()
        else:
            actions, behind = act(problems)
        done = env.step(actions.cpu().numpy())
        outcomes.add(step, done)
        if done.final is not None and not lossy:  # a value of views is not learned
            finals.append(done.final)
            final_at.append(step * env.copies + np.flatnonzero(done.terminated | done.truncated))
        seen.append(problems)
        acted.append(actions)
        logits.append(behind)
    where = np.concatenate(final_at) if final_at else np.zeros(0, np.int64)
    whole = joined(seen)
    return Rollout(
        problems=whole,
        views=joined(held) if lossy else whole,
        own=torch.arange(agents).repeat(steps * env.copies) if lossy else None,
        actions=torch.cat(acted),
        logits=torch.cat(logits),
        rewards=torch.from_numpy(outcomes.rewards),
        team_rewards=torch.from_numpy(outcomes.team_rewards),
        terminated=torch.from_numpy(outcomes.terminated),
        truncated=torch.from_numpy(outcomes.truncated),
        last=joined([env.problems]),
        finals=joined(finals) if finals else None,
        final_at=torch.from_numpy(where),
        requested=outcomes.requested,
        conflicted=outcomes.conflicted,
    )


class _Outcomes:
    """What the steps of a rollout paid, copied out of the environment's buffers."""

    def __init__(self, steps: int, copies: int, agents: int) -> None:
        self.rewards: NDArray[np.float32] = np.empty((steps, copies, agents), np.float32)
        self.team_rewards: NDArray[np.float32] = np.empty((steps, copies), np.float32)
        self.terminated: NDArray[np.bool_] = np.empty((steps, copies), np.bool_)
        self.truncated: NDArray[np.bool_] = np.empty((steps, copies), np.bool_)
        self.requested = 0
        self.conflicted = 0

    def add(self, step: int, done: Step) -> None:
        self.rewards[step] = done.rewards
        self.team_rewards[step] = done.team_reward
        self.terminated[step] = done.terminated
        self.truncated[step] = done.truncated
        self.requested += int(done.events.requested_tasks.sum())
        self.conflicted += int(done.events.conflicted_tasks.sum())


def joined(batches: Sequence[ProblemBatch]) -> ProblemBatch:
    """One after the other, copied."""
    return ProblemBatch(
        *(np.concatenate([getattr(batch, field.name) for batch in batches]) for field in fields(ProblemBatch))
    )
