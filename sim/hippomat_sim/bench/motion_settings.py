"""What `hippomat-bench motion` is asked for, checked. Knows no map."""

from __future__ import annotations

from dataclasses import dataclass

from hippomat_core.config import PLANNERS
from hippomat_core.errors import ConfigError

NAMES = {"ours": "window", **{name: name for name in PLANNERS}}  # on the command line


@dataclass(frozen=True, slots=True)
class MotionSettings:
    """The command line of `hippomat-bench motion`, one to one."""

    map: str = "random:0.2"
    agents: int = 30
    steps: int = 2000
    seeds: int = 5
    loss: float = 0.0
    planner: str = "ours"
    speeds_mps: tuple[float, ...] = (1.0,)
    uav: bool = False
    diagonals: bool = False
    idle: int = 0
    rounds: int = 3


def checked(settings: MotionSettings) -> MotionSettings:
    """The same settings; ConfigError names the first option that is out of range."""
    limits = {
        "--agents": (settings.agents, 1, 200),
        "--steps": (settings.steps, 1, 1_000_000),
        "--seeds": (settings.seeds, 1, 1000),
        "--loss": (settings.loss, 0, 0.95),
        "--idle": (settings.idle, 0, settings.agents - 1),
        "--rounds": (settings.rounds, 1, 20),
    }
    for option, (value, low, high) in limits.items():
        if not low <= value <= high:
            raise ConfigError(f"{option} {value:g} is outside {low} .. {high}")
    if settings.planner not in NAMES:
        raise ConfigError(f"--planner {settings.planner}: choose one of {', '.join(NAMES)}")
    for speed_mps in settings.speeds_mps:
        if not 0.01 <= speed_mps <= 100:
            raise ConfigError(f"--speeds {speed_mps:g} is outside 0.01 .. 100 m/s")
    return settings
