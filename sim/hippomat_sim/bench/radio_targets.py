"""What the radio has to achieve, and whether a run did. A target is judged only where it was set."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from hippomat_sim.bench.radio_run import OurFigures
from hippomat_sim.bench.radio_settings import RadioSettings

MAX_AGREEMENT_US, MAX_AIRTIME, MAX_STOP_MS = 300.0, 0.4, 300.0


@dataclass(frozen=True, slots=True)
class Target:
    """A value that must not be below (at_least) or above its bound. Values as shown: %, us, ms."""

    name: str
    value: float
    bound: float
    at_least: bool
    unit: str

    @property
    def met(self) -> bool:
        """A value that could not be measured (NaN) meets nothing."""
        return self.value >= self.bound if self.at_least else self.value <= self.bound


def targets_of(settings: RadioSettings, ours: OurFigures) -> list[Target]:
    """Those that were set for runs like this one."""
    return [*_delivery(settings, ours), *_snapshots(settings, ours), *_always(settings, ours)]


def _delivery(settings: RadioSettings, ours: OurFigures) -> Iterator[Target]:
    """On a channel without losses, clean or with up to 20 % of the pairs hidden."""
    if settings.loss > 0 or settings.hidden > 0.2:
        return
    least = 99.5 if settings.hidden == 0 else 98.0
    direct, rows = ours.traffic.direct, ours.rows
    yield Target("delivery, direct", 100 * direct.mean, least, True, "%")
    yield Target("delivery, direct, worst pair", 100 * direct.worst, 95.0, True, "%")
    yield Target("delivery, with relays", 100 * rows.mean, least, True, "%")
    yield Target("delivery, with relays, worst pair", 100 * rows.worst, 95.0, True, "%")


def _snapshots(settings: RadioSettings, ours: OurFigures) -> Iterator[Target]:
    """Independent losses, nobody hidden, enough robots to relay, and rows of which five fit into a RELAY."""
    fleet = 10 <= settings.nodes <= 32 and settings.tasks <= 30
    if fleet and settings.hidden == 0 and settings.bursts == "none" and settings.loss <= 0.5:
        least = 99.9 if settings.loss <= 0.3 else 99.0
        yield Target("complete snapshots", 100 * ours.complete, least, True, "%")


def _always(settings: RadioSettings, ours: OurFigures) -> Iterator[Target]:
    yield Target("airtime", 100 * ours.traffic.airtime, 100 * MAX_AIRTIME, False, "%")
    yield Target("fleet time, widest difference", ours.agreement_us[2], MAX_AGREEMENT_US, False, "us")
    yield Target("steps back of fleet time", ours.steps_back, 0, False, "")
    yield Target("rows that are not what was sent", ours.wrong_rows, 0, False, "")
    if ours.stop_ms and settings.loss <= 0.3 and settings.bursts == "none":
        slowest = math.nan if any(map(math.isnan, ours.stop_ms)) else max(ours.stop_ms)
        yield Target("STOP reaches everyone", slowest, MAX_STOP_MS, False, "ms")
