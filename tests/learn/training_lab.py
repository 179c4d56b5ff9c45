"""Small training runs: a small world, few agents, seconds of work."""

from __future__ import annotations

import multiprocessing
import os
import signal
from dataclasses import dataclass, replace

from env_lab import small_pool

from hippomat_sim.learn.runs import Run
from hippomat_sim.learn.settings import EnvSettings
from hippomat_sim.learn.train_settings import (
    BudgetSettings,
    EpisodeSettings,
    NetworkSettings,
    PpoSettings,
    SignalSettings,
    TrainSettings,
)

OURS = TrainSettings(
    network=NetworkSettings("graphsage", {"hops": 1, "width": 4, "hidden": 8, "heads": 2, "head_steps": 8}),
    ppo=PpoSettings(
        advantage="counterfactual", gamma=0.0, epochs=2, entropy=0.003, value_coefficient=0.0,
        learning_rate=5e-3, final_rate=0.1, gradient_clip=0.5,
    ),
    signals=SignalSettings(dual_price=0.5, conflict=0.12, clone_start=0.5, alone=True),
    budget=BudgetSettings(
        agent_steps=900, threads=1, evaluate_every=3, evaluate_sizes=(3,), evaluate_episodes=4
    ),
    environment=EnvSettings(world=small_pool().settings),
    episodes=(
        EpisodeSettings(agents=(3, 4), tasks=(0, 5), edges=200),
        EpisodeSettings(
            turnover="on_claim", agents=(3, 3), tasks=(6, 6), edges=200, fragment_steps=4, episode_steps=10
        ),
    ),
)  # fmt: skip
PAPER = replace(
    OURS,
    network=NetworkSettings("paper_network"),
    ppo=PpoSettings(epochs=2, minibatch=16, learning_rate=1e-3),
    signals=SignalSettings(),
    episodes=(
        EpisodeSettings(
            turnover="on_claim", agents=(3, 3), tasks=(4, 4), fragment_steps=20, episode_steps=15, copies=2
        ),
    ),
)
GCN = replace(PAPER, network=NetworkSettings("gcn"), ppo=replace(PAPER.ppo, reward="team"))
IMPOSSIBLE = replace(PAPER, episodes=OURS.episodes)  # of several sizes
_SETTINGS = {"ours": OURS, "paper": PAPER, "impossible": IMPOSSIBLE}


@dataclass(frozen=True, slots=True)
class SmallRun(Run):
    """A run of this module's settings. preset: their name, or what goes wrong in a process of its own."""

    def settings(self, agent_steps: int | None = None) -> TrainSettings:
        if multiprocessing.parent_process() is not None:
            if self.preset == "killed":
                os.kill(os.getpid(), signal.SIGKILL)
            if self.preset == "buggy":
                raise IndexError("a bug")
        settings = _SETTINGS.get(self.preset, OURS)
        steps = agent_steps or settings.budget.agent_steps
        return replace(settings, budget=replace(settings.budget, agent_steps=steps))
