"""What happens to the fleet in a run of `hippomat-bench radio`: deaths, reboots and partitions."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from hippomat_sim.bench.radio_settings import RadioSettings

Kind: TypeAlias = Literal["kill", "boot", "part", "heal"]

_GRID_US = 100_000
_PARTITION_US, _DEAD_US, _SCRIPT_US = 10_000_000, 8_000_000, 60_000_000


@dataclass(frozen=True, slots=True, order=True)
class Fault:
    """At at_us: stations are killed or (re)booted, or the first of two parts is cut off, or that ends."""

    at_us: int
    kind: Kind
    stations: tuple[int, ...] = ()


class Living:
    """Who dies for good when, and who lives at a time."""

    def __init__(self, settings: RadioSettings, rng: random.Random, start_us: int, end_us: int) -> None:
        self._nodes = settings.nodes
        latest_us = end_us - settings.settling_us
        doomed = rng.sample(range(settings.nodes), settings.deaths)
        self.death_us = {station: _some_time(rng, start_us, latest_us) for station in doomed}

    def at(self, at_us: int) -> list[int]:
        return [k for k in range(self._nodes) if k not in self.death_us or self.death_us[k] > at_us]


def faults_of(settings: RadioSettings, start_us: int, end_us: int) -> list[Fault]:
    """In order of time; the same for the same seed. Nobody who died for good is ever booted again."""
    rng = random.Random(f"faults {settings.seed}")
    living = Living(settings, rng, start_us, end_us)
    faults = [*_script(settings, rng, living, start_us, end_us)] if settings.script else []
    faults += _counted(settings, rng, living, start_us, end_us)
    return sorted(faults)


def _script(
    settings: RadioSettings, rng: random.Random, living: Living, start_us: int, end_us: int
) -> Iterator[Fault]:
    """Every minute a death with return, a reboot (every other time of the lowest id), and a partition."""
    for count, begin_us in enumerate(range(start_us, end_us, _SCRIPT_US)):
        return_us, reboot_us = begin_us + 3_000_000 + _DEAD_US, begin_us + 20_000_000
        dead = (rng.choice(living.at(return_us)),)
        there = living.at(reboot_us)
        rebooted = (there[0] if count % 2 else rng.choice(there),)
        yield Fault(begin_us + 3_000_000, "kill", dead)
        yield Fault(return_us, "boot", dead)
        yield Fault(reboot_us, "boot", rebooted)
        yield from _partition(settings, rng, begin_us + 35_000_000, _PARTITION_US)


def _counted(
    settings: RadioSettings, rng: random.Random, living: Living, start_us: int, end_us: int
) -> Iterator[Fault]:
    """As many of each as asked for, spread over the run; a partition lasts half of its share of it."""
    for station, death_us in living.death_us.items():
        yield Fault(death_us, "kill", (station,))
    for _ in range(settings.reboots):
        at_us = _some_time(rng, start_us, end_us - settings.settling_us)
        yield Fault(at_us, "boot", (rng.choice(living.at(at_us)),))
    for k in range(settings.partitions):
        span_us = (end_us - start_us) // settings.partitions // _GRID_US * _GRID_US
        yield from _partition(settings, rng, start_us + k * span_us, span_us // 2)


def _partition(settings: RadioSettings, rng: random.Random, at_us: int, length_us: int) -> Iterator[Fault]:
    cut_off = rng.sample(range(settings.nodes), rng.randint(1, settings.nodes - 1))
    yield Fault(at_us, "part", tuple(cut_off))
    yield Fault(at_us + length_us, "heal")


def _some_time(rng: random.Random, start_us: int, end_us: int) -> int:
    return rng.randrange(start_us, max(end_us, start_us + _GRID_US), _GRID_US) // _GRID_US * _GRID_US
