"""A fleet of real rc_fleet_time structs, each on a crystal of its own, that hear each other's stamps.

Drives the C as the radio core does: a frame per robot and round in its slot, stamped when it is sent;
a round is closed when the next begins. True time is a whole number of microseconds. Deterministic.
"""

from __future__ import annotations

import heapq
import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from c_values import ffi, lib

FRAME_BYTES = 124
SETTLED_US = 2_000_000  # after a boot or a merge, before agreement is promised
MEASURE_US = 20_000


@dataclass(frozen=True, slots=True)
class Air:
    """What happens to frames."""

    loss: float = 0.3
    way_us: tuple[int, int] = (60, 100)  # to the receiver's clock, without the airtime; uniform
    late: float = 0.0  # probability that a frame leaves up to late_us after its stamp
    late_us: int = 5_000


class Clock:
    """One boot of one radio: its own clock runs at `rate` from begun_us on, fleet time on top of it."""

    def __init__(self, robot: int, rate: float, booted_us: int, begun_us: int) -> None:
        self.robot, self.rate, self.booted_us, self.begun_us = robot, rate, booted_us, begun_us
        self.round, self.wakes, self.silent_until_us = 0, 0, 0
        self.shown_us, self.steps_back = 0, 0
        self.time: Any = ffi.new("rc_fleet_time *")
        lib.rc_fleet_time_init(self.time, begun_us)

    def own_us(self, now_us: int) -> int:
        return self.begun_us + math.floor((now_us - self.booted_us) * self.rate)

    def fleet_us(self, now_us: int) -> int:
        shown_us = int(lib.rc_fleet_time_at(self.time, self.own_us(now_us)))
        self.steps_back += shown_us < self.shown_us
        self.shown_us = shown_us
        return shown_us

    def when_us(self, fleet_us: int) -> int:
        """True time at which it shows fleet_us."""
        own_us = lib.rc_fleet_time_when(self.time, fleet_us)
        return self.booted_us + math.ceil((own_us - self.begun_us) / self.rate)


class Fleet:
    """`run` it, and change parts, air and clocks in between.

    spreads_us: peak to peak disagreement of each part of the fleet, every 20 ms after `excused_us`, of the
    robots that have been up for two seconds.
    """

    def __init__(
        self,
        seed: int,
        size: int = 30,
        round_ms: int = 100,
        slots: int = 32,
        ppm: float = 100.0,
        phases: int = 1,
    ):
        self.random = random.Random(f"clocks {seed}")
        self.air = Air()
        self.phases = phases  # in which each robot sends
        self.schedule = ffi.new("rc_schedule *", {"round_ms": round_ms, "slots": slots})
        self.rates = [1 + self.random.uniform(-ppm, ppm) / 1e6 for _ in range(size)]
        self.part = [0] * size  # robots of different parts do not hear each other
        self.clocks: dict[int, Clock] = {}
        self.spreads_us: list[int] = []
        self.steps_back = 0
        self.now_us, self.excused_us = 0, SETTLED_US
        self._ahead: list[tuple[int, int, Callable[..., None], tuple[Any, ...]]] = []
        self._created = 0
        for robot in range(size):
            self._at(self.random.randrange(500_000), self.boot, robot, self.random.randrange(10**9))
        self._at(0, self._measure)

    def boot(self, robot: int, begun_us: int = 0) -> None:
        """The robot's clock begins anew; what it was before is gone."""
        self.kill(robot)
        clock = Clock(robot, self.rates[robot], self.now_us, begun_us)
        self.clocks[robot] = clock
        clock.round = lib.rc_round_of(self.schedule, begun_us)
        self._wake(clock, 0)

    def kill(self, robot: int) -> None:
        gone = self.clocks.pop(robot, None)
        self.steps_back += gone.steps_back if gone else 0

    def excuse(self) -> None:
        """Agreement may take two seconds from now."""
        self.excused_us = self.now_us + SETTLED_US

    def run(self, seconds: float) -> None:
        end_us = self.now_us + round(seconds * 1e6)
        while self._ahead and self._ahead[0][0] <= end_us:
            self.now_us, _, function, arguments = heapq.heappop(self._ahead)
            function(*arguments)
        self.now_us = end_us

    def push(self, robot: int, gap_us: int) -> None:
        """The robot's fleet time is that much further, as if it came from another fleet."""
        clock = self.clocks[robot]
        clock.time.base_fleet_us += gap_us
        self._wake(clock, clock.wakes)

    def agreed(self) -> int:
        """How many clocks say that they agree."""
        return sum(lib.rc_fleet_time_agreed(clock.time) for clock in self.clocks.values())

    def settled(self) -> list[Clock]:
        return [clock for clock in self.clocks.values() if self.now_us - clock.booted_us >= SETTLED_US]

    def all_steps_back(self) -> int:
        return self.steps_back + sum(clock.steps_back for clock in self.clocks.values())

    def _at(self, at_us: int, function: Callable[..., None], *arguments: Any) -> None:
        self._created += 1
        heapq.heappush(self._ahead, (at_us, self._created, function, arguments))

    def _alive(self, clock: Clock) -> bool:
        return self.clocks.get(clock.robot) is clock

    def _wake(self, clock: Clock, wake: int) -> None:
        if not self._alive(clock) or wake != clock.wakes:
            return
        fleet_us = clock.fleet_us(self.now_us)
        number = lib.rc_round_of(self.schedule, fleet_us)
        if number != clock.round:
            lib.rc_fleet_time_end_round(clock.time, clock.own_us(self.now_us), self._round_us())
            clock.round = number
        turn = lib.rc_next_turn(self.schedule, clock.robot, clock.robot, max(fleet_us, clock.silent_until_us))
        if turn.start_us <= fleet_us:
            clock.silent_until_us = turn.latest_us + 1
            if turn.phase < self.phases:
                self._send(clock, fleet_us)
            turn = lib.rc_next_turn(self.schedule, clock.robot, clock.robot, clock.silent_until_us)
        next_us = min(turn.start_us, lib.rc_round_start_us(self.schedule, clock.round + 1))
        clock.wakes += 1
        self._at(max(clock.when_us(next_us), self.now_us + 1), self._wake, clock, clock.wakes)

    def _round_us(self) -> int:
        return int(self.schedule.round_ms) * 1000

    def _send(self, clock: Clock, stamp_us: int) -> None:
        if self.now_us - clock.booted_us < lib.RC_LISTEN_ROUNDS * self._round_us():
            return
        air, airtime_us = self.air, lib.rc_airtime_us(FRAME_BYTES, 6)
        left_us = self.now_us + airtime_us
        if self.random.random() < air.late:
            left_us += self.random.randrange(air.late_us)
        for other in list(self.clocks.values()):
            apart = self.part[other.robot] != self.part[clock.robot]
            if other is clock or apart or self.random.random() < air.loss:
                continue
            self._at(left_us + self.random.randint(*air.way_us), self._hear, other, stamp_us, airtime_us)

    def _hear(self, clock: Clock, stamp_us: int, airtime_us: int) -> None:
        if not self._alive(clock):
            return
        way_us = airtime_us + lib.RC_FRAME_DELAY_US
        verdict = lib.rc_fleet_time_heard(clock.time, clock.own_us(self.now_us), stamp_us, way_us)
        if verdict == lib.RC_TIME_JUMPED:
            self._wake(clock, clock.wakes)

    def _measure(self) -> None:
        parts: dict[int, list[int]] = {}
        for clock in self.settled():
            parts.setdefault(self.part[clock.robot], []).append(clock.fleet_us(self.now_us))
        if self.now_us >= self.excused_us:
            self.spreads_us += [max(shown) - min(shown) for shown in parts.values()]
        self._at(self.now_us + MEASURE_US, self._measure)
