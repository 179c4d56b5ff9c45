"""A training run: collect, learn, look up now and then; stops at any update and goes on as if it had not.

The run's directory holds run.json (what it was told), metrics.jsonl, tensorboard/, checkpoint.pt and, in the
end, policy.safetensors and the curves. On a CPU a resumed run is equal, bit by bit, to one that was never
interrupted.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from hippomat_core.allocation.graphsage_settings import GraphSageSettings
from hippomat_core.errors import ConfigError, HippomatError
from hippomat_sim.learn.checkpoint import load_checkpoint, save_checkpoint
from hippomat_sim.learn.frozen_set import Evaluation, FrozenSet
from hippomat_sim.learn.ippo import Ippo
from hippomat_sim.learn.networks import PolicyNetwork, make_network
from hippomat_sim.learn.networks.graphsage import GraphSageNetwork
from hippomat_sim.learn.rollout import Collector, Rollout
from hippomat_sim.learn.train_settings import TrainSettings, settings_from_dict, settings_to_dict
from hippomat_sim.learn.training_log import TrainingLog
from hippomat_sim.learn.world_pool import WorldPool

Row = dict[str, Any]
_MOST_THREADS = 4


class TrainingDiverged(HippomatError):
    """A loss or a gradient is no number any more."""


@dataclass(slots=True)
class Clock:
    """Where a run stands; survives an interruption."""

    update: int = 0
    agent_steps: int = 0
    collect_s: float = 0.0  # environment and acting
    learn_s: float = 0.0  # advantages and all passes over the batch


class Training:
    """One run in `folder`. threads: of the learner, settled once, because the weights depend on them."""

    def __init__(
        self, settings: TrainSettings, pool: WorldPool, folder: Path, device: torch.device, threads: int = 0
    ) -> None:
        self.settings, self.pool, self.folder, self.device = settings, pool, folder, device
        self.threads = threads or settings.budget.threads or min(os.cpu_count() or 1, _MOST_THREADS)
        torch.set_num_threads(1)  # an operation is small: whole passes are shared out instead
        self.network = fresh_network(settings)
        self.ippo = Ippo(self.network, settings.ppo, settings.signals, settings.seed, device, self.threads)
        self.collector = Collector(settings, pool)
        self.clock = Clock()
        budget = settings.budget
        self.frozen = FrozenSet(
            pool, budget.evaluate_sizes, evaluated_tasks(settings), budget.evaluate_episodes
        )
        self.evaluation: Evaluation = {}

    @classmethod
    def resumed(
        cls, folder: Path, make: Callable[[TrainSettings], WorldPool], device: torch.device
    ) -> Training:
        """The run of this directory, as its checkpoint left it. make: the pool of its settings."""
        state = load_checkpoint(folder)
        if "optimiser" not in state:
            raise ConfigError(f"--resume {folder}: it was trained through RLlib: add --ray")
        settings = settings_from_dict(json.loads(state["settings"]), str(folder))
        pool = make(settings)
        if pool.hash != state["pool"]:
            raise ConfigError(
                f"--resume {folder}: trained in worlds {state['pool'][:12]}, this version makes "
                f"{pool.hash[:12]}: start the run anew"
            )
        training = cls(settings, pool, folder, device, state["threads"])
        training.network.load_state_dict(state["network"])
        training.ippo.optimiser.load_state_dict(state["optimiser"])
        training.ippo.random.set_state(state["random"])
        training.collector.restore(state["collector"])
        training.clock = Clock(**state["clock"])
        training.evaluation = json.loads(state["evaluation"])
        return training

    @property
    def done(self) -> bool:
        return self.clock.agent_steps >= self.settings.budget.agent_steps

    def run(self, show: Callable[[Row], None], stop: Callable[[], bool]) -> list[Row]:
        """Trains until the budget is used up or, after an update, stop(); then writes a checkpoint.

        Returns all rows so far.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        log = TrainingLog(self.folder, self.clock.update)
        saved_s = time.monotonic()
        try:
            stopped = False
            while not self.done and not stopped:
                row = self.update()
                stopped = stop()
                log.add(row)
                show(row)
                if time.monotonic() - saved_s > self.settings.budget.checkpoint_s:
                    self.save()
                    saved_s = time.monotonic()
            self.save()
        finally:
            log.close()
        return log.rows

    def update(self) -> Row:
        """One rollout and what is learned from it."""
        progress = min(1.0, self.clock.agent_steps / self.settings.budget.agent_steps)
        started_s = time.perf_counter()
        rollout = self.collector.collect(self.ippo.act)
        collected_s = time.perf_counter()
        losses = self.ippo.learn(rollout, progress)
        check_finite(losses, self.folder, self.clock.update + 1)
        learned_s = time.perf_counter()
        clock = self.clock
        clock.update += 1
        clock.agent_steps += rollout.agent_steps
        clock.collect_s += collected_s - started_s
        clock.learn_s += learned_s - collected_s
        row = {"update": clock.update, "agent_steps": clock.agent_steps, **_earned(rollout), **losses}
        every = self.settings.budget.evaluate_every
        if self.done or (every and clock.update % every == 0):
            self.evaluation = self.frozen.play(
                shipped(self.network, self.settings).to(self.device), self.device
            )
            row["evaluation"] = self.evaluation
        return {**row, "collect_s": clock.collect_s, "learn_s": clock.learn_s}

    def save(self) -> Path:
        """Everything that resumed() needs."""
        return save_checkpoint(
            self.folder,
            {
                "settings": json.dumps(settings_to_dict(self.settings)),
                "pool": self.pool.hash,
                "threads": self.threads,
                "network": self.network.state_dict(),
                "optimiser": self.ippo.optimiser.state_dict(),
                "random": self.ippo.random.get_state(),
                "collector": self.collector.state(),
                "clock": {name: getattr(self.clock, name) for name in Clock.__slots__},
                "evaluation": json.dumps(self.evaluation),
            },
        )


def check_finite(losses: Row, folder: Path, update: int) -> None:
    """TrainingDiverged where one is no number: such weights must not overwrite the last checkpoint."""
    for name, value in losses.items():
        if not math.isfinite(value):
            raise TrainingDiverged(
                f"{folder}: {name} = {value} at update {update}: the run diverged, and would again from its "
                "checkpoint; lower [ppo] learning_rate or set gradient_clip, and train in another directory"
            )


def fresh_network(settings: TrainSettings) -> PolicyNetwork:
    """The settings' network with the initial weights of their seed."""
    agents, tasks = fixed_size(settings)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(settings.seed)
        network = make_network(settings.network.kind, settings.network.options, agents, tasks)
    if settings.signals.alone and isinstance(network, GraphSageNetwork):
        return network.with_settings(head=False)
    return network


def shipped(network: PolicyNetwork, settings: TrainSettings) -> PolicyNetwork:
    """What was trained, with the head that the preset asks for."""
    if isinstance(network, GraphSageNetwork):
        return network.with_settings(**GraphSageSettings.from_dict(settings.network.options).as_dict())
    return network


def fixed_size(settings: TrainSettings) -> tuple[int, int]:
    """Agents and tasks of a network that is built for one size; ours takes any, and the first is returned."""
    sizes = {(*episode.agents, *episode.sizes(episode.agents[1])) for episode in settings.episodes}
    least, most, fewest, tasks = next(iter(sorted(sizes)))
    if settings.network.kind != "graphsage" and (len(sizes) > 1 or least != most or fewest != tasks):
        raise ConfigError(
            f"network {settings.network.kind!r} is built for one number of agents and of tasks: "
            "give every [[episodes]] the same agents = [N, N] and tasks = [M, M]"
        )
    return most, tasks


def evaluated_tasks(settings: TrainSettings) -> int:
    """Of the frozen set: as many as agents, unless the network is built for a number."""
    return 0 if settings.network.kind == "graphsage" else fixed_size(settings)[1]


def _earned(rollout: Rollout) -> Row:
    """reward: mean r_i(t); team_reward: mean R(t); conflict_free: share of requested tasks, in percent."""
    single = rollout.requested - rollout.conflicted
    return {
        "agents": rollout.rewards.shape[2],
        "reward": float(rollout.rewards.mean()),
        "team_reward": float(rollout.team_rewards.mean()),
        "conflict_free": 100.0 * single / max(rollout.requested, 1),
    }
