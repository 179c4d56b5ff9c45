"""Everything that a training run is told, as one frozen tree read from TOML; presets lie in `presets/`.

Every number has a range; an unknown key or a value outside its range is refused by name.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from hippomat_core.errors import ConfigError
from hippomat_core.settings_tree import choice, number, parse_toml, read_table
from hippomat_sim.learn.settings import EnvSettings


@dataclass(frozen=True, slots=True)
class NetworkSettings:
    """Which network is trained, and the options that its own settings take."""

    kind: str = choice("graphsage", "graphsage", "paper_network", "gcn")
    options: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class EpisodeSettings:
    """One ingredient of the mixture. Every rollout draws an ingredient by share, then a fleet's size."""

    share: float = number(1.0, 0.0, 1e6)  # relative to the other ingredients
    turnover: str = choice("never", "never", "on_claim", "on_completion")
    agents: tuple[int, ...] = field(default=(6, 14), metadata={"low": 1, "high": 64})  # least, most
    tasks: tuple[int, ...] = field(default=(0, 0), metadata={"low": 0, "high": 80})  # 0: as many as agents
    fragment_steps: int = number(1, 1, 100_000)  # steps of every copy in one rollout
    episode_steps: int = number(1, 1, 100_000)  # truncation
    copies: int = number(0, 0, 100_000)  # 0: as many as `edges` allow
    edges: int = number(50_000, 1, 100_000_000)  # agent-task pairs in a batch, where copies = 0
    loss: float = number(0.0, 0.0, 0.99)  # of frames; above 0 every agent decides on the rows that it holds
    relay: bool = True  # with loss: peers pass rows on

    def sizes(self, agents: int) -> tuple[int, int]:
        """Least and most tasks for so many agents."""
        least, most = (tasks or agents for tasks in self.tasks)
        return least, max(least, most)

    def copies_of(self, agents: int, tasks: int) -> int:
        """Copies of the environment at this size."""
        views = agents if self.loss else 1
        return self.copies or max(1, self.edges // (self.fragment_steps * views * agents * tasks))


@dataclass(frozen=True, slots=True)
class PpoSettings:
    """Proximal policy optimisation, and Adam. The defaults are the paper's."""

    advantage: str = choice("gae", "gae", "counterfactual")
    reward: str = choice("individual", "individual", "team")  # r_i(t), or R(t) for a central critic
    gamma: float = number(0.99, 0.0, 1.0)
    gae_lambda: float = number(0.95, 0.0, 1.0)
    clip: float = number(0.2, 0.0, 1.0)
    epochs: int = number(10, 1, 1000)  # passes over a batch, the paper's SGD iterations
    minibatch: int = number(0, 0, 10_000_000)  # snapshots; 0 = the whole batch
    entropy: float = number(0.05, 0.0, 10.0)
    value_coefficient: float = number(0.5, 0.0, 10.0)
    normalise_advantages: bool = True
    learning_rate: float = number(1e-5, 0.0, 1.0)
    final_rate: float = number(1.0, 0.0, 1.0)  # of learning_rate at the end; linear in between
    rate_factors: dict[str, float] = field(default_factory=dict)  # parameter name prefix -> factor
    gradient_clip: float = number(0.0, 0.0, 1e6)  # norm of one step; 0 = none


@dataclass(frozen=True, slots=True)
class SignalSettings:
    """What the counterfactual advantage pays and what is taught beside it; costs in c_max (0 .. 1)."""

    task_value: float = number(1.0, 0.0, 100.0)  # V: must exceed the largest cost, which is 1
    conflict: float = number(0.08, 0.0, 100.0)  # lambda
    dual_price: float = number(0.0, 0.0, 1.0)  # share of the task's price that is added to its cost
    clone_start: float = number(0.0, 0.0, 1000.0)  # weight of cloning the optimal assignment, at the start
    clone_end: float = number(0.0, 0.0, 1000.0)  # and at the end; linear in between
    clone_head: dict[str, Any] = field(default_factory=dict)  # settings of the head while it is cloned
    alone: bool = False  # of ours: IPPO trains the learned part without its head, cloning the part with it


@dataclass(frozen=True, slots=True)
class BudgetSettings:
    """How long a run is, and how often it looks up. Schedules follow agent_steps, so that runs repeat."""

    agent_steps: int = number(10_000_000, 1, 10**12)
    threads: int = number(0, 0, 256)  # of the learner; 0 = as many as there are cores, at most 4
    checkpoint_s: float = number(60.0, 0.0, 1e6)
    evaluate_every: int = number(100, 0, 1_000_000)  # updates; 0 = only at the end
    evaluate_sizes: tuple[int, ...] = field(default=(5, 10, 20, 30), metadata={"low": 1, "high": 64})
    evaluate_episodes: int = number(64, 1, 100_000)


@dataclass(frozen=True, slots=True)
class TrainSettings:
    """The whole tree; sections have the names that the presets use."""

    network: NetworkSettings = field(default_factory=NetworkSettings)
    ppo: PpoSettings = field(default_factory=PpoSettings)
    signals: SignalSettings = field(default_factory=SignalSettings)
    budget: BudgetSettings = field(default_factory=BudgetSettings)
    environment: EnvSettings = field(default_factory=EnvSettings)  # sizes and turnover come from episodes
    episodes: tuple[EpisodeSettings, ...] = (EpisodeSettings(),)
    seed: int = number(0, 0, 2**31 - 1)


def presets() -> list[str]:
    """Names of the packaged presets."""
    folder = resources.files("hippomat_sim.learn") / "presets"
    return sorted(entry.name[: -len(".toml")] for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_train_settings(preset_or_file: str) -> TrainSettings:
    """Settings of a preset's name or of a TOML file; ConfigError where there is neither."""
    if preset_or_file in presets():
        text = (resources.files("hippomat_sim.learn") / "presets" / f"{preset_or_file}.toml").read_text(
            "utf-8"
        )
        return parse_train_settings(text, f"{preset_or_file}.toml")
    path = Path(preset_or_file)
    if not path.is_file():
        raise ConfigError(
            f"--config {preset_or_file}: there is no such file or preset; presets: {', '.join(presets())}"
        )
    return parse_train_settings(path.read_text("utf-8"), str(path))


def parse_train_settings(text: str, name: str) -> TrainSettings:
    """Settings of TOML text; ConfigError names file, section, key, value and range."""
    return settings_from_dict(parse_toml(text, name), name)


def settings_from_dict(tree: Mapping[str, Any], name: str) -> TrainSettings:
    """Settings of nested dictionaries (TOML, or a checkpoint's JSON)."""
    settings = read_table(TrainSettings, tree, f"{name}:")
    if not settings.episodes or not sum(episode.share for episode in settings.episodes) > 0.0:
        raise ConfigError(f"{name}: [[episodes]] is empty or has no share above 0: add one")
    for episode in settings.episodes:
        for key in ("agents", "tasks"):
            found = list(getattr(episode, key))
            if len(found) != 2 or 0 < found[1] < found[0]:
                raise ConfigError(f"{name}: [[episodes]] {key} = {found} must be [least, most]")
    return settings


def settings_to_dict(settings: TrainSettings) -> dict[str, Any]:
    """The inverse of settings_from_dict."""
    return dataclasses.asdict(settings)
