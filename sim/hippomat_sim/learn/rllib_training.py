"""A training run through RLlib's PPO: the same networks, environment, log and checkpoint as training.py.

The run's directory also holds rllib/, Ray's own checkpoint: with it a run goes on with optimiser and
schedules, in new episodes. Import after ray_session has begun.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from hippomat_core.errors import ConfigError
from hippomat_sim.learn.checkpoint import load_checkpoint, save_checkpoint
from hippomat_sim.learn.frozen_set import Evaluation, FrozenSet
from hippomat_sim.learn.rllib_config import environment_settings, module_names, ppo_config
from hippomat_sim.learn.rllib_module import load_modules, module_weights
from hippomat_sim.learn.train_settings import TrainSettings, settings_to_dict
from hippomat_sim.learn.training import Clock, check_finite, evaluated_tasks, fresh_network
from hippomat_sim.learn.training_log import TrainingLog
from hippomat_sim.learn.world_pool import WorldPool

Row = dict[str, Any]
RLLIB_FOLDER = "rllib"


class RayTraining:
    """One run in `folder`, while Ray runs; it begins with the weights that training.py begins with."""

    def __init__(
        self, settings: TrainSettings, pool: WorldPool, folder: Path, device: torch.device, runners: int = 0
    ) -> None:
        """runners: processes beside this one that play the environments."""
        self.settings, self.pool, self.folder, self.device = settings, pool, folder, device
        self.agents = environment_settings(settings).agents
        self.network = fresh_network(settings)
        self.clock = Clock()
        self.evaluation: Evaluation = {}
        self.rows: list[Row] = []
        budget, tasks = settings.budget, evaluated_tasks(settings)
        self._frozen = FrozenSet(pool, budget.evaluate_sizes, tasks, budget.evaluate_episodes)
        self._modules = module_names(self.network, self.agents)
        self._algorithm = ppo_config(settings, self.network, device, runners).build_algo()
        begun = {name: module_weights(self.network, at) for at, name in enumerate(self._modules)}
        self._algorithm.set_weights({name: _prefixed(weights) for name, weights in begun.items()})

    @property
    def done(self) -> bool:
        return self.clock.agent_steps >= self.settings.budget.agent_steps

    def run(self, show: Callable[[Row], None], stop: Callable[[], bool]) -> list[Row]:
        """Trains until the budget is used up or stop(), then writes checkpoints; returns all rows so far."""
        self.folder.mkdir(parents=True, exist_ok=True)
        log = TrainingLog(self.folder, self.clock.update)
        try:
            while not self.done and not stop():
                row = self.update()
                log.add(row)
                show(row)
            self.save()
        finally:
            log.close()
        self.rows = log.rows
        return log.rows

    def update(self) -> Row:
        """One iteration of RLlib's PPO."""
        result = self._algorithm.train()
        clock = self.clock
        clock.update += 1
        clock.agent_steps = self.agents * int(result["env_runners"]["num_env_steps_sampled_lifetime"])
        clock.collect_s += float(result["timers"]["env_runner_sampling_timer"])
        clock.learn_s += float(result["timers"]["learner_update_timer"])
        weights = self._algorithm.learner_group.get_weights()
        load_modules(self.network, [_unprefixed(weights[name]) for name in self._modules])
        row: Row = {"update": clock.update, "agent_steps": clock.agent_steps, "agents": self.agents}
        losses = self._losses(result["learners"])
        check_finite(losses, self.folder, clock.update)
        row |= _earned(result["env_runners"], self.agents) | losses
        every = self.settings.budget.evaluate_every
        if self.done or (every and clock.update % every == 0):
            self.evaluation = self._frozen.play(self.network, torch.device("cpu"))
            row["evaluation"] = self.evaluation
        return {**row, "collect_s": clock.collect_s, "learn_s": clock.learn_s}

    def save(self) -> Path:
        """checkpoint.pt with the network, as training.py writes it, and Ray's own checkpoint beside it."""
        new = self.folder / f"{RLLIB_FOLDER}.new"
        shutil.rmtree(new, ignore_errors=True)
        self._algorithm.save_to_path(new.absolute())
        shutil.rmtree(self.folder / RLLIB_FOLDER, ignore_errors=True)
        new.rename(self.folder / RLLIB_FOLDER)
        return save_checkpoint(
            self.folder,
            {
                "settings": json.dumps(settings_to_dict(self.settings)),
                "pool": self.pool.hash,
                "network": self.network.state_dict(),
                "clock": {name: getattr(self.clock, name) for name in Clock.__slots__},
                "evaluation": json.dumps(self.evaluation),
            },
        )

    def restore(self) -> None:
        """Goes on where save() stopped. ConfigError where the folder holds no run through RLlib."""
        state, path = load_checkpoint(self.folder), self.folder / RLLIB_FOLDER
        if not path.is_dir():
            raise ConfigError(f"--resume {self.folder}: there is no {RLLIB_FOLDER}/; resume it without --ray")
        self._algorithm.restore_from_path(str(path.absolute()))
        self.network.load_state_dict(state["network"])
        self.clock = Clock(**state["clock"])
        self.evaluation = json.loads(state["evaluation"])

    def close(self) -> None:
        """Ends Ray's processes of this run."""
        self._algorithm.stop()

    def _losses(self, learners: dict[str, Any]) -> Row:
        """Means over the modules, named as in training.py; the gradient only if it is clipped."""
        names = {
            "policy_loss": "policy_loss",
            "value_loss": "vf_loss",
            "entropy": "entropy",
            "gradient": "gradients_default_optimizer_global_norm",
        }
        return {
            ours: sum(float(learners[module][theirs]) for module in self._modules) / len(self._modules)
            for ours, theirs in names.items()
            if theirs in learners[self._modules[0]]
        }


def _earned(played: dict[str, Any], agents: int) -> Row:
    """Mean r_i(t) and R(t) over the last episodes that ended; nothing before the first one does."""
    if not played.get("num_episodes_lifetime"):
        return {}
    team_reward = float(played["episode_return_mean"]) / float(played["episode_len_mean"])
    return {"reward": team_reward / agents, "team_reward": team_reward}


def _prefixed(weights: dict[str, torch.Tensor]) -> dict[str, Any]:
    """Under the names that AllocationModule gives them."""
    return {f"network.{name}": value.numpy() for name, value in weights.items()}


def _unprefixed(weights: dict[str, Any]) -> dict[str, Any]:
    return {name.removeprefix("network."): value for name, value in weights.items()}
