"""What happens to the fleet in a run of `hippomat-bench radio`: deaths, reboots and partitions."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from hippomat_sim.bench.radio_settings import SETTLING_US, RadioSettings

Kind: TypeAlias = Literal["kill", "boot", "part", "heal"]

_GRID_US = 100_000
_PARTITION_US, _DEAD_US, _SCRIPT_US = 10_000_000, 8_000_000, 60_000_000


@dataclass(frozen=True, slots=True, order=True)
class Fault:
    """At at_us: stations are killed or (re)booted, or the first of two parts is cut off, or that ends."""

    at_us: int
    kind: Kind
    stations: tuple[int, ...] = ()


def faults_of(settings: RadioSettings, start_us: int, end_us: int) -> list[Fault]:
    """In order of time; the same for the same seed."""
    rng = random.Random(f"faults {settings.seed}")
    faults = [*_script(settings, rng, start_us, end_us)] if settings.script else []
    faults += _counted(settings, rng, start_us, end_us)
    return sorted(faults)


def _script(settings: RadioSettings, rng: random.Random, start_us: int, end_us: int) -> Iterator[Fault]:
    """Every minute a death with return, a reboot (every other time of the lowest id), and a partition."""
    for count, begin_us in enumerate(range(start_us, end_us, _SCRIPT_US)):
        dead = (rng.randrange(settings.nodes),)
        rebooted = (0 if count % 2 else rng.randrange(settings.nodes),)
        yield Fault(begin_us + 3_000_000, "kill", dead)
        yield Fault(begin_us + 3_000_000 + _DEAD_US, "boot", dead)
        yield Fault(begin_us + 20_000_000, "boot", rebooted)
        yield from _partition(settings, rng, begin_us + 35_000_000, _PARTITION_US)


def _counted(settings: RadioSettings, rng: random.Random, start_us: int, end_us: int) -> Iterator[Fault]:
    """As many of each as asked for, spread over the run; a partition lasts half of its share of it."""
    latest_us = end_us - SETTLING_US
    for station in rng.sample(range(settings.nodes), settings.deaths):
        yield Fault(_some_time(rng, start_us, latest_us), "kill", (station,))
    for _ in range(settings.reboots):
        yield Fault(_some_time(rng, start_us, latest_us), "boot", (rng.randrange(settings.nodes),))
    for k in range(settings.partitions):
        span_us = (end_us - start_us) // settings.partitions // _GRID_US * _GRID_US
        yield from _partition(settings, rng, start_us + k * span_us, span_us // 2)


def _partition(settings: RadioSettings, rng: random.Random, at_us: int, length_us: int) -> Iterator[Fault]:
    cut_off = rng.sample(range(settings.nodes), rng.randint(1, settings.nodes - 1))
    yield Fault(at_us, "part", tuple(cut_off))
    yield Fault(at_us + length_us, "heal")


def _some_time(rng: random.Random, start_us: int, end_us: int) -> int:
    return rng.randrange(start_us, max(end_us, start_us + _GRID_US), _GRID_US) // _GRID_US * _GRID_US
