"""One run of our schedule: real radio cores, faults as planned, then STOPs; what it achieved as numbers."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.wire.frames import RELAY, RESUME, STATE, STOP
from hippomat_core.wire.link import Command, encode_message
from hippomat_sim.bench.radio_faults import Fault, faults_of
from hippomat_sim.bench.radio_figures import (
    Agreement,
    DirectDelivery,
    Expectation,
    Share,
    Snapshots,
    kept,
    share,
)
from hippomat_sim.bench.radio_settings import RadioSettings
from hippomat_sim.medium import Medium
from hippomat_sim.radio.fleet import FleetSetup, RadioFleet

STEP_US = 20_000
_CHUNK_STEPS = 50
_STOP_PAUSE_US, _STOP_PATIENCE_US = 1_500_000, 3_000_000

Progress = Callable[[float], None]  # seconds of the run that are done


@dataclass(frozen=True, slots=True)
class Traffic:
    """Frames as the air saw them while the figures counted."""

    direct: Share  # of STATE, over pairs that are in each other's reach
    frames_per_round: float
    airtime: float  # of all stations, over the time
    collided: int  # receptions that a collision took


@dataclass(frozen=True, slots=True)
class OurFigures:
    """What our schedule achieved; shares of 1, times as named."""

    traffic: Traffic
    state_bytes: int
    relay_bytes: int
    relays_per_state: float
    rows: Share  # held by the end of the round, over all pairs that are not parted, directly or by relay
    told: Share  # rounds of which the hosts are told, of those in the time of settled stations
    sent: Share  # STATEs likewise
    complete: float
    identical: float
    judged: int
    wrong_rows: int
    agreement_us: tuple[float, float, float]  # median, 99th percentile, maximum of the widest difference
    steps_back: int
    stop_ms: tuple[float, ...]  # from each STOP raised until the last robot has it; NaN: not within 3 s
    faults: int  # that happened
    times_s: NDArray[np.float64]  # of the agreement's samples
    spreads_us: NDArray[np.int64]


class Counter:
    """Traffic between two moments, by the medium's counts."""

    def __init__(self, medium: Medium, now_us: int) -> None:
        self._medium, self._from_us = medium, now_us
        self._before = self._now()

    def _now(self) -> NDArray[np.int64]:
        counts = [(c.sent, c.air_us, c.collided) for c in self._medium.counts]
        totals: NDArray[np.int64] = np.array(counts, np.int64).sum(axis=0)
        return totals

    def traffic(self, now_us: int, round_us: int, direct: Share) -> Traffic:
        sent, air_us, collided = (self._now() - self._before).tolist()
        span_us = now_us - self._from_us
        return Traffic(direct, sent * round_us / span_us, air_us / span_us, collided)


class RadioRun:
    """Start, the measured time with its faults, then the STOPs."""

    def __init__(self, settings: RadioSettings, progress: Progress) -> None:
        self._settings, self._progress = settings, progress
        setup = FleetSetup(
            settings.nodes,
            settings.tasks,
            settings.round_us // 1000,
            seed=settings.seed,
            air=settings.air(),
            drift_ppm=settings.drift_ppm,
            answer_us=(1000, round(1000 * settings.answer_ms)),
        )
        self._fleet = RadioFleet(setup)
        self._expected = Expectation(reach(settings), settings.settling_us, settings.round_us)
        for station, boot_us in self._fleet.boot_us.items():
            self._expected.on(station, boot_us)
        self._begin_us = setup.boots_within_us + settings.settling_us
        self._end_us = self._begin_us + round(1e6 * settings.seconds) // STEP_US * STEP_US
        self._faults = faults_of(settings, self._begin_us, self._end_us)
        self._played = 0
        self._delivery = DirectDelivery(self._expected)
        self._snapshots = Snapshots(self._expected)
        self._agreement = Agreement(self._expected)

    def execute(self) -> OurFigures:
        """Once."""
        fleet = self._fleet
        fleet.run(self._begin_us)
        fleet.rounds()  # of the start: not judged
        self._update()
        counter = Counter(fleet.medium, fleet.now_us)
        fleet.on_ended.append(self._delivery)
        waiting = list(reversed(self._faults))
        while fleet.now_us < self._end_us:
            while waiting and waiting[-1].at_us <= fleet.now_us:
                self._do(waiting.pop())
            self._step()
        self._judge()
        direct = share(self._delivery.got, self._delivery.due)
        traffic = counter.traffic(fleet.now_us, self._settings.round_us, direct)
        self._rounds_due = self._expected.rounds_due(fleet.now_us)
        fleet.on_ended.clear()
        fleet.medium.heal()
        return self._figures(traffic, tuple(self._stops()))

    def _step(self) -> None:
        now_us = self._fleet.now_us + STEP_US
        self._fleet.run(now_us)
        self._agreement.sample(now_us, self._fleet.fleet_times_us())
        if now_us // STEP_US % _CHUNK_STEPS == 0:
            self._judge()
            self._progress((now_us - self._begin_us) / 1e6)
        self._update()

    def _judge(self) -> None:
        self._snapshots.add(self._fleet.rounds())

    def _update(self) -> None:
        self._expected.update(self._fleet.now_us, self._judge)

    def _do(self, fault: Fault) -> None:
        fleet, expected = self._fleet, self._expected
        self._played += 1
        for station in fault.stations if fault.kind in ("kill", "boot") else ():
            if fault.kind == "kill":
                fleet.kill(station)
                expected.off(station)
            else:
                fleet.boot(station)
                expected.on(station, fleet.now_us)
        if fault.kind == "part":
            others = set(range(self._settings.nodes)) - set(fault.stations)
            fleet.medium.partition((fault.stations, others))
            expected.part(fault.stations)
        elif fault.kind == "heal":
            fleet.medium.heal()
            expected.heal(fleet.now_us)
        self._update()

    def _stops(self) -> Iterator[float]:
        """Raises a STOP at some robot, waits for all, resumes it there, waits again; each in milliseconds."""
        rng = random.Random(f"stops {self._settings.seed}")
        self._fleet.run(self._fleet.now_us + _STOP_PAUSE_US)
        for _ in range(self._settings.stops):
            raiser = rng.choice(sorted(self._fleet.boot_us))
            began_us = self._fleet.now_us + rng.randrange(self._settings.round_us)
            self._fleet.run(began_us)
            self._fleet.tell(raiser, encode_message(Command(STOP, 0, 1)))
            self._fleet.run(began_us + _STOP_PATIENCE_US)
            latched_us = self._fleet.stopped_us()
            yield stop_took_ms([latched_us[station] for station in self._fleet.boot_us], began_us)
            counter = self._fleet.condition(raiser).stop_counter
            self._fleet.tell(raiser, encode_message(Command(RESUME, counter, 0)))
            self._fleet.run(self._fleet.now_us + _STOP_PAUSE_US)

    def _figures(self, traffic: Traffic, stop_ms: tuple[float, ...]) -> OurFigures:
        delivery, snapshots = self._delivery, self._snapshots
        spreads_us = np.array(self._agreement.spread_us, np.int64)
        nothing = [math.nan] * 3
        widest = np.percentile(spreads_us, (50, 99, 100)).tolist() if len(spreads_us) else nothing
        median_us, p99_us, max_us = widest
        rounds_due = self._rounds_due
        return OurFigures(
            traffic=traffic,
            state_bytes=delivery.mean_bytes(STATE),
            relay_bytes=delivery.mean_bytes(RELAY),
            relays_per_state=delivery.frames[RELAY] / max(delivery.frames[STATE], 1),
            rows=share(snapshots.got, snapshots.due),
            told=kept(snapshots.told, rounds_due),
            sent=kept(delivery.sent, rounds_due),
            complete=snapshots.complete / max(snapshots.judged, 1),
            identical=snapshots.identical / max(snapshots.rounds, 1),
            judged=snapshots.judged,
            wrong_rows=snapshots.wrong_rows,
            agreement_us=(median_us, p99_us, max_us),
            steps_back=self._fleet.steps_back(),
            stop_ms=stop_ms,
            faults=self._played,
            times_s=(np.array(self._agreement.at_us) - self._begin_us) / 1e6,
            spreads_us=spreads_us,
        )


def stop_took_ms(latched_us: Sequence[int | None], began_us: int) -> float:
    """Until the last had it; NaN where somebody has none, or still has one that was raised before."""
    reached_us = [time_us for time_us in latched_us if time_us is not None and time_us >= began_us]
    return (max(reached_us) - began_us) / 1000 if len(reached_us) == len(latched_us) else math.nan


def reach(settings: RadioSettings) -> NDArray[np.bool_]:
    """(S, S) which pairs are not hidden from each other."""
    hears = ~np.eye(settings.nodes, dtype=bool)
    for a, b in settings.air().hidden:
        hears[a, b] = hears[b, a] = False
    return hears
