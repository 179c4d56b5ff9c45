"""The training runs that the tables need, by name: the paper's networks are built for one size each.

A run is a preset with the size and the turnover of one fleet. Its directory under `runs` has its name.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from hippomat_sim.learn.train_settings import TrainSettings, load_train_settings

POLICY_NAME = "policy.safetensors"

# Updates of the runs for one fleet each, where nobody says otherwise: the same for every size, because an
# update is as many steps of each agent, whatever their number. An hour or two of one core for all.
UPDATES = {"paper": 200, "no_neighbours": 40, "mappo_gcn": 40}
LONGER = {"paper_on_claim_10x30": 400}  # the paper's curves


@dataclass(frozen=True, slots=True)
class Fleet:
    """What a method is asked to work for. turnover: as EnvSettings has it."""

    agents: int
    tasks: int
    turnover: str


@dataclass(frozen=True, slots=True)
class Run:
    """preset: one of the packaged ones. fleet: what it is trained for; None: for what the preset says."""

    preset: str
    fleet: Fleet | None = None

    @property
    def name(self) -> str:
        if self.fleet is None:
            return self.preset
        return f"{self.preset}_{self.fleet.turnover}_{self.fleet.agents}x{self.fleet.tasks}"

    def policy(self, runs: Path) -> Path:
        """The weights that the run ends with."""
        return runs / self.name / POLICY_NAME

    def settings(self, agent_steps: int | None = None) -> TrainSettings:
        """The preset's, for this fleet. agent_steps: another length of the run."""
        preset = load_train_settings(self.preset)
        budget = replace(preset.budget, agent_steps=agent_steps or self._usual_steps(preset))
        if self.fleet is None:
            return replace(preset, budget=budget)
        agents, tasks = (self.fleet.agents,) * 2, (self.fleet.tasks,) * 2
        episodes = (
            replace(episode, turnover=self.fleet.turnover, agents=agents, tasks=tasks)
            for episode in preset.episodes
        )
        budget = replace(budget, evaluate_sizes=agents[:1])
        return replace(preset, episodes=tuple(dict.fromkeys(episodes)), budget=budget)

    def _usual_steps(self, preset: TrainSettings) -> int:
        if self.fleet is None or self.preset not in UPDATES:
            return preset.budget.agent_steps
        agents, tasks = self.fleet.agents, self.fleet.tasks
        each = preset.episodes[0].copies_of(agents, tasks) * preset.episodes[0].fragment_steps
        return LONGER.get(self.name, UPDATES[self.preset]) * each * agents


def missing(wanted: Iterable[Run], runs: Path) -> list[Run]:
    """Those that have not ended yet, once each."""
    return [run for run in dict.fromkeys(wanted) if not run.policy(runs).is_file()]
