"""What `hippomat-bench radio` is asked for, checked. Knows no radio."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from hippomat_core.config import MAX_ROBOTS, MAX_TASK_SLOTS, ROBOTS_PER_SECOND_OF_ROUND
from hippomat_core.errors import ConfigError
from hippomat_sim.air import AirSettings, hidden_pairs

SETTLING_US = 2_000_000  # after a start or a repaired partition, before the figures count


@dataclass(frozen=True, slots=True)
class RadioSettings:
    """The command line of `hippomat-bench radio`, one to one."""

    nodes: int = 30
    rate_hz: float = 10.0
    tasks: int = 30
    seconds: float = 60.0
    loss: float = 0.0
    bursts: Literal["none", "link", "receiver"] = "none"
    burst_s: float = 0.3
    hidden: float = 0.0
    late: float = 0.0
    drift_ppm: float = 100.0
    answer_ms: float = 6.0
    deaths: int = 0
    reboots: int = 0
    partitions: int = 0
    script: bool = False
    stops: int = 3
    seed: int = 1

    @property
    def round_us(self) -> int:
        return round(1e6 / self.rate_hz)

    def air(self) -> AirSettings:
        return AirSettings(
            loss=self.loss,
            bursts=self.bursts,
            burst_s=self.burst_s,
            late=self.late,
            hidden=hidden_pairs(self.nodes, self.hidden, self.seed),
        )


def checked(settings: RadioSettings) -> RadioSettings:
    """The same settings; ConfigError names the first option that is out of range."""
    ranges: tuple[tuple[str, float, float, float], ...] = (
        ("--nodes", settings.nodes, 2, MAX_ROBOTS),
        ("--rate", settings.rate_hz, 1.0, 20.0),
        ("--tasks", settings.tasks, 1, MAX_TASK_SLOTS),
        ("--seconds", settings.seconds, 5.0, 86_400.0),
        ("--loss", settings.loss, 0.0, 0.99),
        ("--burst-s", settings.burst_s, 0.001, 60.0),
        ("--hidden", settings.hidden, 0.0, 1.0),
        ("--late", settings.late, 0.0, 1.0),
        ("--drift", settings.drift_ppm, 0.0, 1000.0),
        ("--answer-ms", settings.answer_ms, 1.0, 1000.0),
        ("--deaths", settings.deaths, 0, settings.nodes - 2),
        ("--reboots", settings.reboots, 0, settings.seconds),
        ("--partitions", settings.partitions, 0, settings.seconds / 10),
        ("--stops", settings.stops, 0, 100),
        ("--seed", settings.seed, 0, 2**31 - 1),
    )
    for option, value, low, high in ranges:
        if not low <= value <= high:
            raise ConfigError(f"{option} {value:g} is outside {low:g} .. {high:g}")
    round_ms = 1000 / settings.rate_hz
    if not math.isclose(round_ms, round(round_ms)):
        raise ConfigError(f"--rate {settings.rate_hz:g}: a round must take whole milliseconds (try 10)")
    highest_hz = ROBOTS_PER_SECOND_OF_ROUND / settings.nodes
    if settings.rate_hz > highest_hz:
        remedy = f"--rate {math.floor(highest_hz)} or less"
        raise ConfigError(f"{settings.nodes} nodes do not fit into a round of {round_ms:g} ms: {remedy}")
    return settings
