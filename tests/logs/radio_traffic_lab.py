"""Logs of a made-up fleet: frames on the air, and what robots with wrong clocks wrote of them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hippomat_core import messages as m
from hippomat_core.wire.frames import STOP, Header, StopFrame
from hippomat_logs.reader import Run, reading_store
from hippomat_logs.schema import TOPICS, blank
from hippomat_logs.walk import RawMessage

YEAR_S = 31_557_600
ROUND_S = 0.1
WANDER_S = 1200.0


@dataclass(frozen=True)
class Clock:
    """Of a robot's log: how it stands to true time, which begins at 0."""

    offset_ns: int = 0
    drift_ppm: float = 0.0
    wander_ns: float = 0.0  # its rate follows a temperature that goes up and down in WANDER_S

    def at_ns(self, true_s: float) -> int:
        wandered_ns = self.wander_ns * math.sin(2 * math.pi * true_s / WANDER_S)
        return self.offset_ns + round(true_s * 1e9) + round(true_s * 1e3 * self.drift_ppm + wandered_ns)


@dataclass(frozen=True)
class Robot:
    clock: Clock = Clock()
    radio_drift_ppm: float = 0.0
    least_latency_s: float = 0.0002  # of its USB
    reboots_s: tuple[float, ...] = ()  # of its radio
    from_s: float = 0.0
    until_s: float = 1e9
    radio_id: int | None = None  # None: its place in the fleet


@dataclass
class Air:
    loss: float = 0.1
    least_s: Callable[[int, int], float] = lambda _sender, _receiver: 0.00008
    deaf: frozenset[tuple[int, int]] = field(default_factory=frozenset)  # (sender, receiver)


class ToldRun(Run):
    """A run whose records are in memory."""

    told: list[RawMessage]

    def raw_messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        return (raw for raw in self.told if raw.topic in topics)


def fleet(robots: Sequence[Robot], seconds: float, seed: int, air: Air | None = None) -> list[ToldRun]:
    """One run per robot. Each sends once in a round, in its own slot."""
    rng, air = np.random.default_rng(seed), air or Air()
    desks = [_Desk(number, robot, rng) for number, robot in enumerate(robots)]
    for round_ in range(int(seconds / ROUND_S)):
        for number, desk in enumerate(desks):
            at_s = (round_ + (number + 0.3 * rng.random()) / len(desks)) * ROUND_S
            if (frame := desk.sends(at_s)) is None:
                continue
            for other, ear in enumerate(desks):
                if other != number and (number, other) not in air.deaf and rng.random() >= air.loss:
                    held_up_s = rng.exponential(0.002) if rng.random() < 0.2 else 0.0
                    jitter_s = rng.uniform(0, 0.00003)
                    ear.hears(at_s + air.least_s(number, other) + jitter_s + held_up_s, *frame)
        if round_ % 10 == 0:
            for desk in desks:
                desk.status((round_ + 0.99) * ROUND_S)
    return [desk.run() for desk in desks]


class _Desk:
    """One robot with its radio."""

    def __init__(self, number: int, robot: Robot, rng: np.random.Generator) -> None:
        self.number, self.robot, self._rng = number, robot, rng
        self.id = number if robot.radio_id is None else robot.radio_id
        self._boots_s = [-1.0 - float(rng.random()), *robot.reboots_s]
        self._sequences = [0] * len(self._boots_s)
        self._told: list[tuple[float, int, m.Event]] = []  # true time, radio's clock, what was told

    def _boot(self, at_s: float) -> int:
        return sum(boot_s <= at_s for boot_s in self._boots_s) - 1

    def _is_on(self, at_s: float) -> bool:
        return self.robot.from_s <= at_s < self.robot.until_s

    def _radio_us(self, at_s: float) -> int:
        rate = 1 + self.robot.radio_drift_ppm / 1e6
        return int((at_s - self._boots_s[self._boot(at_s)]) * rate * 1e6)

    def _tell(self, at_s: float, event: m.Event) -> None:
        if self._is_on(at_s):
            self._told.append((at_s, len(self._told), event))

    def sends(self, at_s: float) -> tuple[int, int, int] | None:
        if not self._is_on(at_s):
            return None
        boot = self._boot(at_s)
        self._sequences[boot] += 1
        sequence = self._sequences[boot]
        self._tell(at_s, m.FrameSent(0, self._radio_us(at_s), STOP, sequence, True))
        return self.id, boot + 1, sequence

    def hears(self, at_s: float, sender: int, boot: int, sequence: int) -> None:
        header = Header(STOP, False, 1, sender, boot, sequence, 0)
        self._tell(at_s, m.StopHeard(0, self._radio_us(at_s), 0, -50, header, StopFrame(1, 0, 0)))

    def status(self, at_s: float) -> None:
        boot = self._boot(at_s)
        told = dataclasses.replace(
            blank(m.RadioStatus),
            boot_id=77 + boot,
            boot_counter=boot + 1,
            uptime_us=self._radio_us(at_s),
            robot=self.id,
        )
        self._tell(at_s, told)

    def run(self) -> ToldRun:
        """Records in the order of the radio, each read a little after; now and then stamped too early."""
        store, records, free_s = reading_store(), [], -1e9
        for number, (at_s, _, event) in enumerate(sorted(self._told, key=lambda told: told[:2])):
            read_s = at_s + self.robot.least_latency_s + self._rng.exponential(0.002)
            free_s = max(free_s, read_s)
            early_s = self._rng.uniform(0, 0.004) if self._rng.random() < 0.0005 else 0.0
            log_ns = self.robot.clock.at_ns(free_s - early_s)
            data = store.encode(event)
            records.append(RawMessage(number + 1, log_ns, TOPICS[type(event)], data))
        manifest = {"robot": str(self.number), "session_id": f"{self.number:08x}"}
        run = ToldRun((Path(f"robot{self.number:02d}_made_up_000.mcap"),), manifest)
        run.told = records
        return run
