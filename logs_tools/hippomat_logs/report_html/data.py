"""What a report shows, as values: no files, no records, no pixels.

Times are seconds: on a robot's own log until `assembly` has put all robots on one time base, then since the
first record of the fleet. Places are in the fleet's map frame [m]: x east, y north.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_logs.metrics import FleetMetrics

# What a robot does, by its own STATE.
IDLE, NOT_READY, REQUESTED, CONFIRMED, SERVING = "idle", "not ready", "requested", "confirmed", "serving"
STOPPED, LOST, RECOVERY = "stopped", "lost", "recovery"
PHASES = (IDLE, NOT_READY, REQUESTED, CONFIRMED, SERVING, RECOVERY, STOPPED, LOST)
NO_SLOT = -1

Clock = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # a log's times -> the fleet's
Stamped = TypeVar("Stamped", bound=Any)  # a dataclass


def on_clock(clock: Clock, stamped: Sequence[Stamped], *times: str) -> list[Stamped]:
    """The same with these fields on another clock; nan stays nan."""
    given = np.array([[getattr(one, name) for name in times] for one in stamped]).reshape(-1, len(times))
    moved = np.where(np.isnan(given), np.nan, clock(np.nan_to_num(given.ravel())).reshape(given.shape))
    return [
        replace(one, **dict(zip(times, row, strict=True)))
        for one, row in zip(stamped, moved.tolist(), strict=True)
    ]


@dataclass(frozen=True, slots=True)
class Span:
    """A robot did one thing for one claim."""

    begin_s: float
    end_s: float
    phase: str
    slot: int = NO_SLOT
    generation: int = 0
    x_m: float = math.nan  # destination
    y_m: float = math.nan

    @property
    def task(self) -> tuple[int, int]:
        return self.slot, self.generation


@dataclass(frozen=True, slots=True)
class Happening:
    """Something that one robot recorded at one time: an alarm, a conflict, a STOP, help of the guard."""

    at_s: float
    kind: str  # alarm, conflict, stop, guard, recovery
    level: int  # messages.INFO, WARNING, ERROR
    code: str
    text: str
    end_s: float = math.nan  # of what lasts


@dataclass(frozen=True, slots=True)
class Conflict:
    """This robot and another wanted one task."""

    at_s: float
    slot: int
    generation: int
    other: int
    kept: bool
    cause: str


@dataclass(frozen=True, slots=True)
class ClaimEnd:
    """How one of this robot's claims ended: completed, dropped, released."""

    at_s: float
    slot: int
    generation: int
    what: str
    cause: str


@dataclass(frozen=True, slots=True)
class Way:
    """A planned path from now on; empty: none."""

    at_s: float
    x_m: tuple[float, ...]  # corners
    y_m: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class TaskSeen:
    """A task became known, or was known to be over (closed), to one robot."""

    at_s: float
    slot: int
    generation: int
    x_m: float
    y_m: float
    closed: bool = False


@dataclass(frozen=True, slots=True)
class Body:
    """Outline of a robot, base frame (x forward, y left); corners empty: a disc."""

    radius_m: float
    corners: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Track:
    """Where a robot was. All (n,), by time."""

    at_s: NDArray[np.float64]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    yaw_rad: NDArray[np.float64]


@dataclass(slots=True)
class RobotView:
    """What one log says of one robot: its own, or a peer that it heard (`heard_by`)."""

    robot: int
    body: Body
    track: Track
    spans: list[Span] = field(default_factory=list)
    ends: list[ClaimEnd] = field(default_factory=list)
    ways: list[Way] = field(default_factory=list)
    happenings: list[Happening] = field(default_factory=list)
    conflicts: list[Conflict] = field(default_factory=list)
    heard_by: int | None = None

    def moved(self, clock: Clock) -> RobotView:
        """On another clock."""
        return replace(
            self,
            track=replace(self.track, at_s=clock(self.track.at_s)),
            spans=on_clock(clock, self.spans, "begin_s", "end_s"),
            ends=on_clock(clock, self.ends, "at_s"),
            ways=on_clock(clock, self.ways, "at_s"),
            happenings=on_clock(clock, self.happenings, "at_s", "end_s"),
            conflicts=on_clock(clock, self.conflicts, "at_s"),
        )


@dataclass(frozen=True, slots=True)
class TaskLife:
    """One task: from when somebody knew it until its slot had another, or it was served."""

    slot: int
    generation: int
    x_m: float
    y_m: float
    seen_s: float
    closed_s: float = math.inf  # no longer open to requests
    completed_s: float = math.nan
    completed_by: int = -1


@dataclass(frozen=True, slots=True)
class TaskConflict:
    """Two robots had a claim on one task at once."""

    at_s: float
    robots: tuple[int, int]
    slot: int
    generation: int
    kind: str
    cause: str
    text: str  # how it came about, and how it ended


@dataclass(frozen=True, slots=True)
class Frames:
    """Every robot's pose at the same instants. A robot that is not known to be anywhere is nan."""

    step_s: float
    x_m: NDArray[np.float32]  # (N, T)
    y_m: NDArray[np.float32]  # (N, T)
    yaw_rad: NDArray[np.float32]  # (N, T)


@dataclass(frozen=True, slots=True)
class Fact:
    """One line of the head. `bad`: the reader should mind it."""

    name: str
    text: str
    bad: bool = False


@dataclass(slots=True)
class ReportData:
    """A fleet's run. robots[k] is row k of every array over robots."""

    title: str
    begun_ns: int  # common time of second 0, since 1970
    span_s: float
    robots: list[RobotView]
    frames: Frames
    grid: OccupancyGrid | None
    tasks: list[TaskLife]
    conflicts: list[TaskConflict]
    explained: bool  # conflicts are every one of the fleet's, once; else each as one robot noticed it
    metrics: FleetMetrics
    age_counts: NDArray[np.int64]  # rows that decisions were made on, by age [ms]
    facts: list[Fact]
    warnings: list[str]  # of damaged, lossy and missing logs
