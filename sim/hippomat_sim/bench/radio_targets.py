"""What the radio has to achieve, and whether a run did. A target is judged only where it was set.

The others are listed all the same, with what was measured and why it is not judged."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from hippomat_sim.bench.radio_run import OurFigures
from hippomat_sim.bench.radio_settings import RadioSettings

MAX_AGREEMENT_US, MAX_AIRTIME, MAX_STOP_MS = 300.0, 0.4, 300.0
# Clocks part by their drift times the round, and a round corrects half: +-100 ppm and 1 s make 0.58 ms.
MAX_AGREEMENT_ROUND_US = 500_000
LEAST_TOLD = 99.0


@dataclass(frozen=True, slots=True)
class Target:
    """A value that must not be below (at_least) or above its bound. Values as shown: %, us, ms."""

    name: str
    value: float
    bound: float
    at_least: bool
    unit: str
    not_judged: str = ""  # why the target was not set for such a run; empty: it is judged

    @property
    def met(self) -> bool:
        """A value that could not be measured (NaN) meets nothing."""
        return self.value >= self.bound if self.at_least else self.value <= self.bound

    @property
    def missed(self) -> bool:
        return not self.not_judged and not self.met


def targets_of(settings: RadioSettings, ours: OurFigures) -> list[Target]:
    """The same ones for every run, judged or not."""
    both = settings, ours
    return [*_delivery(*both), *_snapshots(*both), *_rounds(ours), *_fleet_time(*both), *_stop(*both)]


def _first(*reasons: tuple[bool, str]) -> str:
    """The first reason that holds, else nothing."""
    return next((reason for holds, reason in reasons if holds), "")


def _delivery(settings: RadioSettings, ours: OurFigures) -> Iterator[Target]:
    """On a channel without losses, clean or with up to 20 % of the pairs hidden."""
    why_not = _first((settings.loss > 0, "loss > 0"), (settings.hidden > 0.2, "hidden > 0.2"))
    least = 99.5 if settings.hidden == 0 else 98.0
    direct, rows = ours.traffic.direct, ours.rows
    yield Target("delivery, direct", 100 * direct.mean, least, True, "%", why_not)
    yield Target("delivery, direct, worst pair", 100 * direct.worst, 95.0, True, "%", why_not)
    yield Target("delivery, with relays", 100 * rows.mean, least, True, "%", why_not)
    yield Target("delivery, with relays, worst pair", 100 * rows.worst, 95.0, True, "%", why_not)


def _snapshots(settings: RadioSettings, ours: OurFigures) -> Iterator[Target]:
    """Independent losses, nobody hidden, enough robots to relay, and rows of which five fit into a RELAY."""
    why_not = _first(
        (settings.nodes < 10, "fewer than 10 nodes"),
        (settings.nodes > 32, "more than 32 nodes"),
        (settings.tasks > 30, "more than 30 tasks"),
        (settings.hidden > 0, "hidden > 0"),
        (settings.bursts != "none" and settings.loss > 0, "losses in bursts"),
        (settings.loss > 0.5, "loss > 0.5"),
    )
    least = 99.9 if settings.loss <= 0.3 else 99.0
    yield Target("complete snapshots", 100 * ours.complete, least, True, "%", why_not)


def _rounds(ours: OurFigures) -> Iterator[Target]:
    """What the figures above are shares of must have happened."""
    yield Target("rounds that hosts are told", 100 * ours.told.mean, LEAST_TOLD, True, "%")
    yield Target("rounds in which STATE is sent", 100 * ours.sent.mean, LEAST_TOLD, True, "%")
    yield Target("rows that are not what was sent", ours.wrong_rows, 0, False, "")
    yield Target("airtime", 100 * ours.traffic.airtime, 100 * MAX_AIRTIME, False, "%")


def _fleet_time(settings: RadioSettings, ours: OurFigures) -> Iterator[Target]:
    longest_s = MAX_AGREEMENT_ROUND_US / 1e6
    why_not = _first((settings.round_us > MAX_AGREEMENT_ROUND_US, f"rounds longer than {longest_s:g} s"))
    widest_us = ours.agreement_us[2]
    yield Target("fleet time, widest difference", widest_us, MAX_AGREEMENT_US, False, "us", why_not)
    yield Target("steps back of fleet time", ours.steps_back, 0, False, "")


def _stop(settings: RadioSettings, ours: OurFigures) -> Iterator[Target]:
    """Its time is judged up to 30 % of independent loss; one that misses somebody is always a miss."""
    reached = not any(map(math.isnan, ours.stop_ms))
    why_not = _first(
        (not ours.stop_ms, "no STOP was raised"),
        (reached and settings.bursts != "none" and settings.loss > 0, "losses in bursts"),
        (reached and settings.loss > 0.3, "loss > 0.3"),
    )
    slowest = max(ours.stop_ms) if ours.stop_ms and reached else math.nan
    yield Target("STOP reaches everyone", slowest, MAX_STOP_MS, False, "ms", why_not)
