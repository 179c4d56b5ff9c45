"""One robot's run in figures, read record by record: one pass, bounded memory.

Definitions follow the paper where it has them (CF1, total travel cost); docs/metrics.md has all. Knows
records, no files and no other robot. Times are those of the robot's own log until fleet.py moves them.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.config import Config
from hippomat_core.control.recovery import DRIVE, FREE
from hippomat_core.wire import frames
from hippomat_logs.definitions import Task, c_max_s, cost_s
from hippomat_logs.metrics.latency import LatencyReading, Passages
from hippomat_logs.metrics.links import LinkMetrics, LinkReading
from hippomat_logs.metrics.machines import ComputerMetrics, ComputerReading, RadioReading
from hippomat_logs.metrics.samples import Samples
from hippomat_logs.records import DropRecord, ProcessRecord, TimingRecord

MIN_STEP_M = 0.02  # shorter moves are no way driven: an estimate trembles where a robot stands


@dataclass(frozen=True, slots=True)
class Completed:
    """A completed task as its robot recorded it."""

    robot: int
    task: Task
    at_s: float
    cost_s: float  # the claim's frozen cost, out of its code
    travel_s: float  # from the request to the goal: until completion, less the dwell time


@dataclass(slots=True)
class RobotMetrics:
    """One robot's run. Seconds since 1970 by its log's clock, or by the fleet's (fleet.py)."""

    robot: int
    duration_s: float = 0.0
    begun_s: float = math.nan
    completed: list[Completed] = field(default_factory=list)
    requested: dict[Task, float] = field(default_factory=dict)  # task -> first request
    confirmed: dict[Task, float] = field(default_factory=dict)
    seen: dict[Task, float] = field(default_factory=dict)  # task -> when it was known here
    requests: int = 0  # claims requested, repeated ones too
    conflicts: dict[str, int] = field(default_factory=dict)  # by cause
    guard_limited: int = 0  # ticks (20 per second) in which the scan guard slowed or stopped it
    guard_nearest_m: float = math.inf  # then, from the footprint to the nearest thing
    recoveries: dict[str, int] = field(default_factory=dict)  # "step: cause" of each attempt to get free
    alarms: dict[str, int] = field(default_factory=dict)  # code -> how often it was raised
    sweeps: dict[str, int] = field(default_factory=dict)  # Localized.phase -> lidar sweeps
    sweep_score: Samples = field(default_factory=Samples)  # of all sweeps
    computer: ComputerMetrics = field(default_factory=ComputerMetrics)
    frames_sent: int = 0
    states_sent: int = 0  # of them
    frames_given_up: int = 0
    radio: dict[str, int] = field(default_factory=dict)  # RadioStatus counters: their growth in this run
    radio_reboots: int = 0
    links: list[LinkMetrics] = field(default_factory=list)
    air_ms: Samples = field(default_factory=Samples)  # radio to radio, both by fleet time
    radio_to_host_ms: Samples = field(default_factory=Samples)  # above the fastest of each 2 s
    passages: Passages = field(default_factory=Passages)
    records_lost: dict[str, int] = field(default_factory=dict)  # by the recorder: cause -> records
    lacks: list[str] = field(default_factory=list)  # why its log is not whole, if it is not
    on_fleet_clock: bool = True  # False: its times of day are its own, and mean nothing to other robots
    driven_m: float = 0.0
    path: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 2), np.float32))
    # (n, 2) x, y [m], map frame: a point for every MIN_STEP_M

    @property
    def compute_ms(self) -> Samples:
        return self.computer.compute_ms

    @property
    def travel_cost_s(self) -> float:
        return sum(one.cost_s for one in self.completed)

    @property
    def travel_time_s(self) -> float:
        return sum(one.travel_s for one in self.completed)

    @property
    def frames_received(self) -> int:
        return sum(link.received for link in self.links)

    @property
    def frames_lost(self) -> int:
        return sum(link.lost for link in self.links)

    @property
    def allocation_s(self) -> list[float]:
        """Task known here -> our claim on it confirmed."""
        return [at_s - self.seen[task] for task, at_s in self.confirmed.items() if task in self.seen]

    @property
    def settling_s(self) -> list[float]:
        """Our request -> its confirmation."""
        return [
            at_s - self.requested[task] for task, at_s in self.confirmed.items() if task in self.requested
        ]

    def moved(self, common_s: Callable[[float], float]) -> RobotMetrics:
        """The same with all times of day on another clock."""

        def table(times: dict[Task, float]) -> dict[Task, float]:
            return {task: common_s(at_s) for task, at_s in times.items()}

        return replace(
            self,
            begun_s=self.begun_s if math.isnan(self.begun_s) else common_s(self.begun_s),
            completed=[replace(one, at_s=common_s(one.at_s)) for one in self.completed],
            requested=table(self.requested),
            confirmed=table(self.confirmed),
            seen=table(self.seen),
        )


class Stamped(Protocol):
    """What a reading is fed with: hippomat_logs.reader.Record, or anything like it."""

    @property
    def log_time_ns(self) -> int: ...
    @property
    def message(self) -> Any: ...


class MetricsReading:
    """Collects one robot's metrics, from a log or from memory: feed() records in order, result() once."""

    def __init__(self, robot: int, config: Config) -> None:
        self._metrics = RobotMetrics(robot)
        self._dwell_s = config.fleet.dwell_s
        self._config = config
        self._c_max_s = config.fleet.c_max_s
        self._links = LinkReading(robot, config.fleet.size, config.fleet.round_s)
        self._latency, self._computer, self._radio = LatencyReading(), ComputerReading(), RadioReading()
        self._path = array("f")
        self._agreed = False  # our radio's fleet time is the fleet's
        self._first_ns = self._last_ns = self._log_time_ns = 0
        self._see: dict[type, Callable[[Any], None]] = {
            kind: getattr(self, name) for kind, name in _HANDLERS.items()
        }

    def feed(self, record: Stamped) -> None:
        """Records that say nothing of interest only make the run longer."""
        self._log_time_ns = record.log_time_ns
        self._first_ns = self._first_ns or record.log_time_ns
        self._last_ns = max(self._last_ns, record.log_time_ns)
        see = self._see.get(type(record.message))
        if see is not None:
            see(record.message)

    def result(self) -> RobotMetrics:
        found = self._metrics
        self._latency.close()
        found.begun_s = self._first_ns / 1e9 if self._first_ns else math.nan
        found.duration_s = (self._last_ns - self._first_ns) / 1e9
        found.links, found.computer = self._links.result(), self._computer.result()
        found.radio, found.radio_reboots = self._radio.counts, self._radio.reboots
        found.air_ms, found.radio_to_host_ms = self._latency.air_ms, self._latency.radio_to_host_ms
        found.passages = self._latency.passages
        found.path = np.array(self._path, np.float32).reshape(-1, 2)
        return found

    @property
    def _now_s(self) -> float:
        return self._log_time_ns / 1e9

    # ---- tasks ----

    def _turned(self, message: m.TaskTurned) -> None:
        self._metrics.seen.setdefault((message.slot, message.generation), self._now_s)

    def _claim(self, claim: m.ClaimChanged) -> None:
        task, found, at_s = (claim.slot, claim.generation), self._metrics, self._now_s
        if claim.what == "requested":
            found.requests += 1
            found.requested.setdefault(task, at_s)
        elif claim.what == "confirmed":
            found.confirmed.setdefault(task, at_s)
        elif claim.what == "completed":
            begun_s = found.requested.get(task, at_s)
            travel_s = max(0.0, at_s - begun_s - self._dwell_s)
            found.completed.append(
                Completed(found.robot, task, at_s, cost_s(claim.cost, self._c_max_s), travel_s)
            )

    def _conflict(self, message: m.ConflictSeen) -> None:
        _count(self._metrics.conflicts, message.cause)

    def _map(self, message: m.MapReceived) -> None:
        self._c_max_s = c_max_s(self._config, message)

    # ---- motion ----

    def _pose(self, pose: m.PoseEstimated) -> None:
        path = self._path
        step_m = math.hypot(pose.x_m - path[-2], pose.y_m - path[-1]) if path else math.inf
        if step_m >= MIN_STEP_M:
            self._metrics.driven_m += step_m if path else 0.0
            path.extend((pose.x_m, pose.y_m))

    def _localized(self, message: m.Localized) -> None:
        _count(self._metrics.sweeps, message.phase)
        self._metrics.sweep_score.add(message.score)

    def _guard(self, message: m.GuardLimited) -> None:
        self._metrics.guard_limited += 1
        self._metrics.guard_nearest_m = min(self._metrics.guard_nearest_m, message.nearest_m)

    def _recovery(self, message: m.RecoveryChanged) -> None:
        if message.step not in (DRIVE, FREE):
            _count(self._metrics.recoveries, f"{message.step}: {message.cause}")

    # ---- radio ----

    def _heard(self, message: m.RelayHeard | m.TasksHeard | m.StopHeard) -> None:
        self._links.heard(message)

    def _heard_state(self, message: m.StateHeard) -> None:
        self._links.heard(message)
        self._latency.heard(message, self._log_time_ns, self._agreed)

    def _frame_sent(self, message: m.FrameSent) -> None:
        self._metrics.frames_sent += message.sent
        self._metrics.states_sent += message.sent and message.kind == frames.STATE
        self._metrics.frames_given_up += not message.sent
        self._latency.sent(message)

    def _send_state(self, _message: m.SendState) -> None:
        self._latency.decided_state(self._log_time_ns)

    def _status(self, message: m.RadioStatus) -> None:
        self._latency.status(message)
        self._radio.status(message)

    def _round(self, message: m.RoundEnded) -> None:
        self._agreed = message.agreed

    # ---- the rest ----

    def _decided(self, message: m.RoundDecided) -> None:
        self._links.decided(message)

    def _timing(self, message: TimingRecord) -> None:
        self._computer.timing(message)

    def _process(self, message: ProcessRecord) -> None:
        self._computer.process(message)

    def _alarm(self, message: m.AlarmRaised) -> None:
        _count(self._metrics.alarms, message.code)

    def _dropped(self, message: DropRecord) -> None:
        lost = self._metrics.records_lost
        lost[message.cause] = lost.get(message.cause, 0) + message.last - message.first + 1

    def _tick(self, _message: object) -> None:
        """Time passes."""


_HANDLERS: dict[type, str] = {
    m.Started: "_tick",
    m.Tick: "_tick",
    m.TaskTurned: "_turned",
    m.ClaimChanged: "_claim",
    m.ConflictSeen: "_conflict",
    m.MapReceived: "_map",
    m.PoseEstimated: "_pose",
    m.Localized: "_localized",
    m.GuardLimited: "_guard",
    m.RecoveryChanged: "_recovery",
    m.StateHeard: "_heard_state",
    m.RelayHeard: "_heard",
    m.TasksHeard: "_heard",
    m.StopHeard: "_heard",
    m.FrameSent: "_frame_sent",
    m.SendState: "_send_state",
    m.RoundEnded: "_round",
    m.RadioStatus: "_status",
    m.RoundDecided: "_decided",
    TimingRecord: "_timing",
    ProcessRecord: "_process",
    m.AlarmRaised: "_alarm",
    DropRecord: "_dropped",
}
KINDS = tuple(_HANDLERS)  # the records that a reading looks at


def _count(counts: dict[str, int], name: str) -> None:
    counts[name] = counts.get(name, 0) + 1
