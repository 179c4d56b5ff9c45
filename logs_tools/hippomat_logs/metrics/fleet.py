"""A fleet's run in figures: its robots' runs on one clock, and what takes more than one log to say."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import Config
from hippomat_core.errors import HippomatError, LogError
from hippomat_logs.alignment import Alignment, align_runs, how_sure
from hippomat_logs.definitions import Task, conflict_free_rate
from hippomat_logs.metrics.latency import LatencyMetrics, Times, whole_latencies
from hippomat_logs.metrics.robot import KINDS, Completed, MetricsReading, RobotMetrics
from hippomat_logs.metrics.samples import mean, together
from hippomat_logs.reader import Run, open_runs
from hippomat_logs.shortfalls import not_whole, shortfalls, whose_log

CommonNs = Callable[[Times], Times]  # a log's own times -> the fleet's


@dataclass(slots=True)
class FleetMetrics:
    """All robots of one fleet; times of different robots compare where run_metrics() made it."""

    robots: list[RobotMetrics]
    config: Config | None = None  # of the first robot
    clocks: str = ""  # how the robots' clocks were made one
    latencies: list[LatencyMetrics] = field(default_factory=list)  # core to core, by direction

    @property
    def duration_s(self) -> float:
        """From the first robot's first record to the last one's last."""
        spans = [(one.begun_s, one.begun_s + one.duration_s) for one in self._timed]
        spans = [span for span in spans if not math.isnan(span[0])]
        return max(end for _, end in spans) - min(begin for begin, _ in spans) if spans else 0.0

    @property
    def _timed(self) -> list[RobotMetrics]:
        """Those whose times can be compared."""
        return [robot for robot in self.robots if robot.on_fleet_clock]

    @property
    def recorded(self) -> int:
        """How many of the fleet's robots have a log here."""
        return len({robot.robot for robot in self.robots if robot.robot >= 0})

    @property
    def size(self) -> int:
        """Robots of the roster; all that recorded where no configuration is known."""
        return max(self.recorded, self.config.fleet.size if self.config is not None else 0)

    @property
    def coverage(self) -> str:
        """ "1 of 5 logs"; empty where every robot of the roster has one."""
        return f"{self.recorded} of {self.size} logs" if self.recorded < self.size else ""

    @property
    def not_whole(self) -> list[str]:
        """What the logs themselves say that they lack."""
        return [line for robot in self.robots for line in not_whole(whose_log(robot.robot), robot.lacks)]

    @property
    def completed(self) -> list[Completed]:
        return sorted((one for robot in self.robots for one in robot.completed), key=lambda one: one.at_s)

    @property
    def tasks_per_min(self) -> float:
        return 60.0 * len(self.completed) / self.duration_s if self.duration_s > 0.0 else math.nan

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
    def driven_m(self) -> float:
        return sum(robot.driven_m for robot in self.robots)

    @property
    def conflict_free_rate(self) -> float:
        """CF1: share of the requested tasks that exactly one robot requested; nan if there were none."""
        return conflict_free_rate((robot.robot, task) for robot in self.robots for task in robot.requested)

    @property
    def conflicts(self) -> dict[str, int]:
        """ConflictSeen by cause, of all robots: both sides of one conflict count."""
        return dict(sum((Counter(robot.conflicts) for robot in self.robots), Counter[str]()))

    @property
    def allocation_s(self) -> list[float]:
        """First robot to know a task -> first confirmed claim on it."""
        seen, confirmed = (_earliest(getattr(r, name) for r in self._timed) for name in ("seen", "confirmed"))
        return [max(0.0, at_s - seen[task]) for task, at_s in confirmed.items() if task in seen]

    @property
    def settling_s(self) -> list[float]:
        return [value for robot in self.robots for value in robot.settling_s]

    @property
    def all_allocated_s(self) -> float:
        """First task known -> the last task's first confirmed claim; nan where nothing was confirmed."""
        seen, confirmed = (_earliest(getattr(r, name) for r in self._timed) for name in ("seen", "confirmed"))
        return max(confirmed.values()) - min(seen.values()) if seen and confirmed else math.nan

    @property
    def compute_ms(self) -> NDArray[np.float64]:
        return together([robot.compute_ms for robot in self.robots])

    @property
    def air_ms(self) -> NDArray[np.float64]:
        return together([robot.air_ms for robot in self.robots])

    @property
    def radio_to_host_ms(self) -> NDArray[np.float64]:
        return together([robot.radio_to_host_ms for robot in self.robots])

    @property
    def latency_ms(self) -> float:
        """STATE from core to core: the mean over the links of each one's median."""
        return mean(one.median_ms for one in self.latencies)

    @property
    def delivery(self) -> float:
        """Share of the frames sent that were heard, over all directions; nan where there are none."""
        received = sum(robot.frames_received for robot in self.robots)
        total = received + sum(robot.frames_lost for robot in self.robots)
        return received / total if total else math.nan

    @property
    def rows_relayed(self) -> float:
        """Of the rows that were there in time, the share that a third robot passed on."""
        direct, relayed, _ = self._rows
        return relayed / (direct + relayed) if direct + relayed else math.nan

    @property
    def rows_in_time(self) -> float:
        """Of the rows that decisions wanted, the share that was of that round."""
        direct, relayed, late = self._rows
        return (direct + relayed) / (direct + relayed + late) if direct + relayed + late else math.nan

    @property
    def _rows(self) -> tuple[int, int, int]:
        links = [link for robot in self.robots for link in robot.links]
        direct, relayed = sum(link.rows_direct for link in links), sum(link.rows_relayed for link in links)
        return direct, relayed, sum(link.rows_late for link in links)


@dataclass(frozen=True, slots=True)
class Clocks:
    """How the logs of a fleet are put on one time; `text` says so."""

    alignment: Alignment
    text: str
    linked: bool = True  # False: nothing in the logs shows that the robots ran together


def run_metrics(paths: Sequence[Path]) -> FleetMetrics:
    """Metrics of the runs in these logs or directories of logs; raises LogError for a damaged one."""
    runs = open_runs([Path(path) for path in paths])
    return fleet_metrics(runs, [robot_metrics(run) for run in runs], clocks_of(runs))


def clocks_of(runs: Sequence[Run], *, trusted: bool = False) -> Clocks:
    """By the frames that the robots heard of each other; by their wall clocks where that cannot be.

    A robot that shares no frames keeps its own clock; the others' are one all the same.
    """
    if len(runs) < 2 or trusted:
        return Clocks(Alignment.trusting(runs), "the robots' wall clocks, trusted" if len(runs) > 1 else "")
    try:
        alignment = align_runs(runs, strangers=True)
    except LogError:
        raise
    except HippomatError:
        text = "the robots' wall clocks: no radio traffic links any two of them"
        return Clocks(Alignment.trusting(runs), text, linked=False)
    text = f"one clock by the frames they heard of each other, {how_sure(alignment)}"
    return Clocks(alignment, text + ", and the fleet's times leave it out" * bool(alignment.strangers))


def fleet_metrics(runs: Sequence[Run], robots: Sequence[RobotMetrics], clocks: Clocks) -> FleetMetrics:
    """The robots' figures, one for each run, on one clock."""
    common = [partial(clocks.alignment.common_ns_array, run) for run in runs]
    placed = [
        replace(robot, on_fleet_clock=not clocks.alignment.is_stranger(run))
        for run, robot in zip(runs, robots, strict=True)
    ]
    found = on_one_clock(placed, common, runs[0].config if runs else None, clocks.text)
    return replace(found, clocks=found.clocks + _doubt(found._timed))


def on_one_clock(
    robots: Sequence[RobotMetrics], common: Sequence[CommonNs], config: Config | None, clocks: str
) -> FleetMetrics:
    """common: for each robot, times of its own log [ns] -> the fleet's. clocks: says how they are one."""

    def common_s(clock: CommonNs) -> Callable[[float], float]:
        return lambda at_s: int(clock(np.array([round(at_s * 1e9)], np.int64))[0]) / 1e9

    moved = [robot.moved(common_s(clock)) for robot, clock in zip(robots, common, strict=True)]
    halves = [(robot.robot, robot.passages) for robot in moved]
    latencies = whole_latencies(halves, lambda place, times_ns: common[place](times_ns))
    return FleetMetrics(moved, config, clocks, latencies)


def _doubt(robots: Sequence[RobotMetrics]) -> str:
    """Where the time between runs is longer than all of them: their clocks are not one, or their trials."""
    spans_s = sorted((one.begun_s, one.duration_s) for one in robots if not math.isnan(one.begun_s))
    gaps_s = [late - early - length for (early, length), (late, _) in pairwise(spans_s)]
    if max(gaps_s, default=0.0) <= sum(length for _, length in spans_s):
        return ""
    return f"; but runs lie {max(gaps_s):,.0f} s apart: no time between robots means anything"


def robot_metrics(run: Run) -> RobotMetrics:
    """One run's, by its own clock."""
    reading = MetricsReading(run.robot, run.config)
    for record in run.records_in_order(KINDS):
        reading.feed(record)
    return replace(reading.result(), lacks=shortfalls(run))


def _earliest(tables: Iterable[dict[Task, float]]) -> dict[Task, float]:
    merged: dict[Task, float] = {}
    for table in tables:
        for task, at_s in table.items():
            merged[task] = min(at_s, merged.get(task, at_s))
    return merged
