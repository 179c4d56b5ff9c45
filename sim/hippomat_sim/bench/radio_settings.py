"""What `hippomat-bench radio` is asked for, checked. Knows no radio."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from hippomat_core.config import MAX_ROBOTS, MAX_TASK_SLOTS, ROBOTS_PER_SECOND_OF_ROUND
from hippomat_core.errors import ConfigError
from hippomat_sim.air import AirSettings, hidden_pairs

_SETTLING_US, _SETTLING_ROUNDS = 2_000_000, 5


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

    @property
    def settling_us(self) -> int:
        """After a start or a repaired partition, before the figures count."""
        return max(_SETTLING_US, _SETTLING_ROUNDS * self.round_us)

    def air(self) -> AirSettings:
        return AirSettings(
            loss=self.loss,
            bursts=self.bursts,
            burst_s=self.burst_s,
            late=self.late,
            hidden=hidden_pairs(self.nodes, self.hidden, self.seed),
        )


@dataclass(frozen=True, slots=True)
class Range:
    """What an option may be; why: what a limit follows from, where it is not the option's own."""

    low: float
    high: float
    shown: str  # in --help
    why: str = ""


def ranges_of(settings: RadioSettings) -> dict[str, tuple[float, Range]]:
    """Of every option that is a number: its value and its range, given the other options."""
    return _own_ranges(settings) | _count_ranges(settings)


def _own_ranges(settings: RadioSettings) -> dict[str, tuple[float, Range]]:
    """Of those that depend on no other option."""
    return {
        "--nodes": (settings.nodes, _plain(2, MAX_ROBOTS, "the ids of robots are 0 .. 63")),
        "--rate": (settings.rate_hz, _plain(1, 20, "a round takes 50 .. 1000 ms")),
        "--tasks": (settings.tasks, _plain(1, MAX_TASK_SLOTS, "the slots that a STATE can hold")),
        "--seconds": (settings.seconds, _plain(5, 86_400, "five seconds to a day")),
        "--loss": (settings.loss, _plain(0, 0.99, "a probability, and not everything may be lost")),
        "--burst-s": (settings.burst_s, _plain(0.001, 60, "a millisecond to a minute")),
        "--hidden": (settings.hidden, _plain(0, 1, "a share of the pairs")),
        "--late": (settings.late, _plain(0, 1, "a share of the receptions")),
        "--drift": (settings.drift_ppm, _plain(0, 1000, "a clock off by more is broken")),
        "--answer-ms": (settings.answer_ms, _plain(1, 1000, "no sooner than 1 ms, within the longest round")),
        "--stops": (settings.stops, _plain(0, 100, "each takes 6 s of simulated time")),
        "--seed": (settings.seed, _plain(0, 2**31 - 1, "31 bits")),
    }


def _count_ranges(settings: RadioSettings) -> dict[str, tuple[float, Range]]:
    """Of what happens to the fleet: by its size and the time that there is."""
    nodes, seconds = settings.nodes, settings.seconds if math.isfinite(settings.seconds) else 0.0
    return {
        "--deaths": (
            settings.deaths,
            Range(0, nodes - 2, "0 .. N - 2", f"two of --nodes {nodes} must live on"),
        ),
        "--reboots": (
            settings.reboots,
            Range(0, int(seconds), "0 .. one a second", f"one a second of --seconds {seconds:g}"),
        ),
        "--partitions": (
            settings.partitions,
            Range(0, int(seconds // 10), "0 .. one in 10 s", f"one in ten seconds of --seconds {seconds:g}"),
        ),
    }


def _plain(low: float, high: float, why: str) -> Range:
    return Range(low, high, f"{shown(low)} .. {shown(high)}", why)


def shown(value: float) -> str:
    """Whole numbers in full, without an exponent."""
    return f"{value:.0f}" if math.isfinite(value) and value == int(value) else f"{value:g}"


def checked(settings: RadioSettings) -> RadioSettings:
    """The same settings; ConfigError names the first option that is out of range, and why."""
    for option, (value, allowed) in ranges_of(settings).items():
        if not allowed.low <= value <= allowed.high:
            limits = f"{shown(allowed.low)} .. {shown(allowed.high)}"
            raise ConfigError(f"{option} {shown(value)} is outside {limits}: {allowed.why}")
    round_ms = 1000 / settings.rate_hz
    if not math.isclose(round_ms, round(round_ms)):
        raise ConfigError(f"--rate {settings.rate_hz:g}: a round must take whole milliseconds (try 10)")
    highest_hz = ROBOTS_PER_SECOND_OF_ROUND / settings.nodes
    if settings.rate_hz > highest_hz:
        fitting_hz = max(hz for hz in range(1, 21) if hz <= highest_hz and 1000 % hz == 0)
        raise ConfigError(
            f"--nodes {settings.nodes} do not fit into a round of {round_ms:g} ms, which holds "
            f"{int(ROBOTS_PER_SECOND_OF_ROUND / settings.rate_hz)}: --rate {fitting_hz} or less"
        )
    return settings
