"""What a fleet achieved, from the logs alone: tasks, travel cost, conflicts, allocation time, frames, paths.

Definitions follow the paper where it has them (CF1, total travel cost). Knows records, no pictures or tables.
Times of different robots are compared on the wall clock of their logs.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hippomat_core import messages as m
from hippomat_core.allocation.quantise import dequantise
from hippomat_core.config import Config
from hippomat_core.control.recovery import DRIVE, FREE
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.ground import ground_of
from hippomat_core.wire.frames import Header
from hippomat_logs.reader import Record, Run, open_runs
from hippomat_logs.records import TimingRecord

Task = tuple[int, int]  # slot, generation
HEARD = (m.StateHeard, m.RelayHeard, m.TasksHeard, m.StopHeard)


@dataclass(frozen=True, slots=True)
class Completed:
    """A completed task as its robot recorded it."""

    robot: int
    task: Task
    at_s: float  # wall clock
    cost_s: float  # the claim's frozen cost, out of its code
    travel_s: float  # from the request to the goal: until completion, less the dwell time


@dataclass(frozen=True, slots=True)
class LinkMetrics:
    """Frames of one sender as this robot heard them; lost = gaps in its sequence numbers, per boot."""

    sender: int
    received: int
    lost: int

    @property
    def loss(self) -> float:
        total = self.received + self.lost
        return self.lost / total if total else 0.0


@dataclass(slots=True)
class RobotMetrics:
    """One robot's run."""

    robot: int
    duration_s: float = 0.0
    completed: list[Completed] = field(default_factory=list)
    requested: dict[Task, float] = field(default_factory=dict)  # task -> first request, wall clock [s]
    confirmed: dict[Task, float] = field(default_factory=dict)
    seen: dict[Task, float] = field(default_factory=dict)  # task -> when it was known here
    conflicts: dict[str, int] = field(default_factory=dict)  # by cause
    guard_limited: int = 0  # ticks (20 per second) in which the scan guard slowed or stopped it
    guard_nearest_m: float = math.inf  # then, from the footprint to the nearest thing
    recoveries: dict[str, int] = field(default_factory=dict)  # "step: cause" of each attempt to get free
    compute_ms: list[float] = field(default_factory=list)  # per pass of the daemon's loop
    frames_sent: int = 0
    frames_given_up: int = 0
    links: list[LinkMetrics] = field(default_factory=list)
    path: list[tuple[float, float]] = field(default_factory=list)  # x, y [m], map frame

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

    @property
    def driven_m(self) -> float:
        steps = np.diff(np.array(self.path or [(0.0, 0.0)]), axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum()) if len(steps) else 0.0


@dataclass(slots=True)
class FleetMetrics:
    """All robots of one fleet."""

    robots: list[RobotMetrics]

    @property
    def completed(self) -> list[Completed]:
        return sorted((one for robot in self.robots for one in robot.completed), key=lambda one: one.at_s)

    @property
    def completed_twice(self) -> list[Task]:
        """Tasks (slot, generation) that were completed more than once, by whomever."""
        counts = Counter(one.task for one in self.completed)
        return sorted(task for task, count in counts.items() if count > 1)

    @property
    def travel_cost_s(self) -> float:
        return sum(robot.travel_cost_s for robot in self.robots)

    @property
    def travel_time_s(self) -> float:
        return sum(robot.travel_time_s for robot in self.robots)

    @property
    def conflict_free_rate(self) -> float:
        """CF1: share of the requested tasks that exactly one robot requested; nan if there were none."""
        requests = Counter(task for robot in self.robots for task in robot.requested)
        alone = sum(count == 1 for count in requests.values())
        return alone / len(requests) if requests else float("nan")

    @property
    def allocation_s(self) -> list[float]:
        """First robot to know a task -> first confirmed claim on it."""
        seen, confirmed = (_earliest(getattr(r, name) for r in self.robots) for name in ("seen", "confirmed"))
        return [max(0.0, at_s - seen[task]) for task, at_s in confirmed.items() if task in seen]

    @property
    def settling_s(self) -> list[float]:
        return [value for robot in self.robots for value in robot.settling_s]

    @property
    def compute_ms(self) -> list[float]:
        return [value for robot in self.robots for value in robot.compute_ms]


def run_metrics(paths: Sequence[Path]) -> FleetMetrics:
    """Metrics of the runs in these logs or directories of logs; raises LogError for a damaged one."""
    return FleetMetrics([robot_metrics(run) for run in open_runs([Path(path) for path in paths])])


def robot_metrics(run: Run) -> RobotMetrics:
    reading = MetricsReading(run.robot, run.config)
    for record in run.records_in_order():
        reading.feed(record)
    return reading.result()


def quantiles(values: Sequence[float]) -> tuple[float, float, float]:
    """(median, mean, 95th percentile); nan where there are no values."""
    if not values:
        return float("nan"), float("nan"), float("nan")
    array = np.asarray(values)
    return float(np.median(array)), float(array.mean()), float(np.percentile(array, 95))


def _earliest(tables: Iterable[dict[Task, float]]) -> dict[Task, float]:
    merged: dict[Task, float] = {}
    for table in tables:
        for task, at_s in table.items():
            merged[task] = min(at_s, merged.get(task, at_s))
    return merged


class MetricsReading:
    """Collects one robot's metrics record by record, from a log or from memory."""

    def __init__(self, robot: int, config: Config) -> None:
        self._metrics = RobotMetrics(robot)
        self._config = config
        self._c_max_s = config.fleet.c_max_s
        self._first_s: float | None = None
        self._sequences: dict[tuple[int, int], set[int]] = defaultdict(set)  # (sender, boot)

    def feed(self, record: Record) -> None:
        at_s, message = record.log_time_ns / 1e9, record.message
        self._first_s = at_s if self._first_s is None else self._first_s
        found = self._metrics
        found.duration_s = max(found.duration_s, at_s - self._first_s)
        if isinstance(message, m.PoseEstimated):
            found.path.append((message.x_m, message.y_m))
        elif isinstance(message, HEARD):
            self._heard(message.header)
        elif isinstance(message, m.ClaimChanged):
            self._claim(message, at_s)
        elif isinstance(message, m.TaskTurned):
            found.seen.setdefault((message.slot, message.generation), at_s)
        elif isinstance(message, TimingRecord):
            found.compute_ms.append(message.compute_ns / 1e6)
        else:
            self._rare(message)

    def _rare(self, message: Any) -> None:
        if isinstance(message, m.FrameSent):
            self._metrics.frames_sent += message.sent
            self._metrics.frames_given_up += not message.sent
        elif isinstance(message, m.ConflictSeen):
            conflicts = self._metrics.conflicts
            conflicts[message.cause] = conflicts.get(message.cause, 0) + 1
        elif isinstance(message, m.GuardLimited):
            self._metrics.guard_limited += 1
            self._metrics.guard_nearest_m = min(self._metrics.guard_nearest_m, message.nearest_m)
        elif isinstance(message, m.RecoveryChanged):
            if message.step not in (DRIVE, FREE):
                told, recoveries = f"{message.step}: {message.cause}", self._metrics.recoveries
                recoveries[told] = recoveries.get(told, 0) + 1
        elif isinstance(message, m.MapReceived) and not self._config.fleet.c_max_s:
            cells = np.array(message.cells).reshape(message.height, message.width)
            grid = OccupancyGrid(cells, message.resolution_m, message.origin_x_m, message.origin_y_m)
            self._c_max_s = ground_of(grid, message.epoch, self._config).c_max_s

    def _heard(self, header: Header) -> None:
        self._sequences[header.sender, header.boot].add(header.sequence)

    def _claim(self, claim: m.ClaimChanged, at_s: float) -> None:
        task, found = (claim.slot, claim.generation), self._metrics
        if claim.what == "requested":
            found.requested.setdefault(task, at_s)
        elif claim.what == "confirmed":
            found.confirmed.setdefault(task, at_s)
        elif claim.what == "completed":
            begun_s = found.requested.get(task, at_s)
            travel_s = max(0.0, at_s - begun_s - self._config.fleet.dwell_s)
            found.completed.append(Completed(found.robot, task, at_s, self._cost_s(claim.cost), travel_s))

    def _cost_s(self, code: int) -> float:
        return float(dequantise(np.array([code], np.uint8), self._c_max_s)[0]) if self._c_max_s else 0.0

    def result(self) -> RobotMetrics:
        received: Counter[int] = Counter()
        lost: Counter[int] = Counter()
        for (sender, _), sequences in self._sequences.items():
            received[sender] += len(sequences)
            lost[sender] += max(sequences) - min(sequences) + 1 - len(sequences)
        links = [LinkMetrics(sender, received[sender], lost[sender]) for sender in sorted(received)]
        self._metrics.links = links
        return self._metrics
