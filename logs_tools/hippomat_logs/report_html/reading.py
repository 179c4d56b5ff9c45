"""What one log says of its robot, and of the peers that it heard: records in, RobotViews out.

Decides which record tells what: a robot's pose is its own estimate, what it does is what it broadcast. Peers
without a log of their own are seen through the STATEs that they sent. Knows one clock, the log's.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.config import Config
from hippomat_core.control.recovery import DRIVE, FREE
from hippomat_core.maps.map_event import grid_in
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.wire import frames as air
from hippomat_logs.reader import Record
from hippomat_logs.records import DropRecord
from hippomat_logs.report_html.data import (
    CONFIRMED,
    IDLE,
    LOST,
    NO_SLOT,
    NOT_READY,
    RECOVERY,
    REQUESTED,
    SERVING,
    STOPPED,
    Body,
    ClaimEnd,
    Conflict,
    Happening,
    RobotView,
    Span,
    TaskSeen,
    Track,
    Way,
)

SILENT_S = 1.0  # without a STATE: what a robot does is not known
GUARD_GAP_S = 0.3  # between two ticks in which the guard held: one intervention
ENDS = ("completed", "dropped", "released")


@dataclass(slots=True)
class LogReading:
    """Everything of one log that a report shows. Times: seconds since `first_ns` of that log."""

    first_ns: int = 0
    last_s: float = 0.0
    own: RobotView | None = None  # None: an observer's log
    heard: list[RobotView] = field(default_factory=list)
    tasks: list[TaskSeen] = field(default_factory=list)
    grid: OccupancyGrid | None = None
    age_counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(m.NEVER_HEARD_MS + 1, np.int64))


class ViewReader:
    """Feed every record of READ in order; `known`: robots whose own logs are at hand."""

    def __init__(self, robot: int, config: Config, known: Collection[int] = ()) -> None:
        self._found = LogReading()
        self._config, self._known = config, {*known, robot}
        body = Body(config.robot.radius_m, tuple((x, y) for x, y, *_ in config.robot.footprint))
        self._robot = robot
        self._own = _Watched(robot, body)
        self._peers: dict[int, _Watched] = {}
        self._closed: NDArray[np.bool_] | None = None
        self._begun = False
        self._handlers: dict[type, Callable[[float, Any], None]] = {
            kind: getattr(self, name) for kind, name in HANDLERS.items()
        }

    def feed(self, record: Record) -> None:
        if not self._begun:
            self._found.first_ns, self._begun = record.log_time_ns, True
        at_s = (record.log_time_ns - self._found.first_ns) / 1e9
        self._found.last_s = max(self._found.last_s, at_s)
        if handler := self._handlers.get(type(record.message)):
            handler(at_s, record.message)

    def result(self) -> LogReading:
        found = self._found
        if self._robot >= 0:
            found.own = self._own.view()
        found.heard = [replace(peer.view(), heard_by=self._robot) for peer in self._peers.values()]
        return found

    # ---- where it is and what it does ----

    def _pose(self, at_s: float, pose: m.PoseEstimated) -> None:
        self._own.stands(at_s, pose.x_m, pose.y_m, pose.yaw_rad)

    def _sent(self, at_s: float, sent: m.SendState) -> None:
        self._own.does(at_s, sent.frame)

    def _state_heard(self, at_s: float, heard: m.StateHeard) -> None:
        sender, frame = heard.header.sender, heard.frame
        if sender in self._known:
            return
        if sender not in self._peers:
            self._peers[sender] = _Watched(sender, Body(self._config.robot.radius_m))
        peer = self._peers[sender]
        if frame.flags & air.FLAG_LOCALIZED:
            peer.stands(at_s, frame.x_cm / 100, frame.y_cm / 100, frame.yaw_256 / 256 * math.tau)
        peer.does(at_s, frame)

    def _stop_heard(self, at_s: float, heard: m.StopHeard) -> None:
        what = "STOP" if heard.header.kind == air.STOP else "RESUME"
        origin = "an operator" if heard.frame.origin == air.OPERATOR else f"robot {heard.frame.origin}"
        code = f"{what} {heard.frame.counter}"
        if all(one.code != code for one in self._own.happenings):  # every radio repeats it
            text = f"{what} number {heard.frame.counter} of {origin}, reason {heard.frame.reason}"
            self._own.happenings.append(Happening(at_s, "stop", m.WARNING, code, text))

    # ---- tasks and claims ----

    def _turned(self, at_s: float, turned: m.TaskTurned) -> None:
        x_m, y_m = turned.x_cm / 100, turned.y_cm / 100
        self._found.tasks.append(TaskSeen(at_s, turned.slot, turned.generation, x_m, y_m))

    def _tasks_heard(self, at_s: float, heard: m.TasksHeard) -> None:
        if self._robot >= 0:  # a robot says itself what it learns from them
            return
        for slot in heard.frame.slots:
            over = slot.state in (air.INACTIVE, air.DONE)
            place_m = slot.x_cm / 100, slot.y_cm / 100
            self._found.tasks.append(TaskSeen(at_s, slot.slot, slot.generation, *place_m, closed=over))

    def _decided(self, at_s: float, decided: m.RoundDecided) -> None:
        ages = np.delete(decided.row_age_ms, self._robot) if self._robot >= 0 else decided.row_age_ms
        np.add.at(self._found.age_counts, ages, 1)
        closed = (decided.task_states == air.INACTIVE) | (decided.task_states == air.DONE)
        fresh = closed if self._closed is None else closed & ~self._closed
        for slot in np.flatnonzero(fresh).tolist():
            generation = int(decided.generations[slot])
            self._found.tasks.append(TaskSeen(at_s, slot, generation, math.nan, math.nan, closed=True))
        self._closed = closed

    def _claim(self, at_s: float, claim: m.ClaimChanged) -> None:
        if claim.what in ENDS:
            self._own.ends.append(ClaimEnd(at_s, claim.slot, claim.generation, claim.what, claim.cause))

    def _conflict(self, at_s: float, seen: m.ConflictSeen) -> None:
        conflict = Conflict(at_s, seen.slot, seen.generation, seen.other, seen.kept, seen.cause)
        self._own.conflicts.append(conflict)

    # ---- what went wrong ----

    def _recovery(self, at_s: float, changed: m.RecoveryChanged) -> None:
        self._own.recovering = changed.step not in (DRIVE, FREE)
        if self._own.recovering:
            text = f"stuck ({changed.cause}) for {changed.stalled_s:.1f} s: {changed.step}"
            self._own.happenings.append(Happening(at_s, "recovery", m.WARNING, changed.step, text))

    def _guard(self, at_s: float, held: m.GuardLimited) -> None:
        said, near = self._own.happenings, held.nearest_m
        last = next((k for k in range(len(said) - 1, -1, -1) if said[k].kind == "guard"), -1)
        text = "the scan guard slowed or stopped it"
        text += f"; the nearest thing is {100 * near:.0f} cm away" if math.isfinite(near) else ""
        if last >= 0 and at_s - said[last].end_s <= GUARD_GAP_S:
            said[last] = replace(said[last], end_s=at_s)
        else:
            said.append(Happening(at_s, "guard", m.INFO, "guard", text, at_s))

    def _alarm(self, at_s: float, alarm: m.AlarmRaised) -> None:
        self._own.happenings.append(Happening(at_s, "alarm", alarm.level, alarm.code, alarm.text))

    def _dropped(self, at_s: float, drop: DropRecord) -> None:
        text = f"records {drop.first} to {drop.last} lost: {drop.cause}"
        last = self._own.happenings[-1] if self._own.happenings else None
        if last is None or last.kind != "loss" or at_s - last.at_s > SILENT_S:  # shedding makes thousands
            self._own.happenings.append(Happening(at_s, "loss", m.WARNING, "lost records", text))

    # ---- the map ----

    def _map(self, _: float, said: m.MapReceived | m.MapDrawn) -> None:
        if said.width * said.height == len(said.cells) > 0:
            self._found.grid = grid_in(said)

    def _planned(self, at_s: float, planned: m.PathPlanned) -> None:
        grid = self._found.grid
        if grid is None:
            return
        ix, iy = _corners(planned.ix.astype(np.int64), planned.iy.astype(np.int64))
        x_m = grid.origin_x_m + (ix + 0.5) * grid.resolution_m
        y_m = grid.origin_y_m + (iy + 0.5) * grid.resolution_m
        self._own.ways.append(Way(at_s, tuple(x_m.round(3).tolist()), tuple(y_m.round(3).tolist())))


HANDLERS: dict[type, str] = {
    m.PoseEstimated: "_pose",
    m.SendState: "_sent",
    m.StateHeard: "_state_heard",
    m.TasksHeard: "_tasks_heard",
    m.StopHeard: "_stop_heard",
    m.RoundDecided: "_decided",
    m.TaskTurned: "_turned",
    m.ClaimChanged: "_claim",
    m.ConflictSeen: "_conflict",
    m.RecoveryChanged: "_recovery",
    m.GuardLimited: "_guard",
    m.PathPlanned: "_planned",
    m.MapReceived: "_map",
    m.MapDrawn: "_map",
    m.AlarmRaised: "_alarm",
    DropRecord: "_dropped",
}
KINDS = tuple(HANDLERS)


class _Watched:
    """One robot, as its poses and STATEs come in."""

    def __init__(self, robot: int, body: Body) -> None:
        self._robot, self._body = robot, body
        self._track = array("d")  # at_s, x_m, y_m, yaw_rad of each pose
        self._spans: list[Span] = []
        self.ends: list[ClaimEnd] = []
        self.ways: list[Way] = []
        self.happenings: list[Happening] = []
        self.conflicts: list[Conflict] = []
        self.recovering = False

    def stands(self, at_s: float, x_m: float, y_m: float, yaw_rad: float) -> None:
        self._track.extend((at_s, x_m, y_m, yaw_rad))

    def does(self, at_s: float, frame: air.StateFrame) -> None:
        """A STATE says what the robot does from now on."""
        claim = frame.claim
        phase = RECOVERY if self.recovering else phase_of(frame)
        last = self._spans[-1] if self._spans else None
        slot = NO_SLOT if claim.slot == air.NO_SLOT else claim.slot
        if last is not None and at_s - last.end_s <= SILENT_S:
            self._spans[-1] = replace(last, end_s=at_s)
            if (last.phase, last.slot, last.generation) == (phase, slot, claim.generation):
                return
        place_m = (claim.x_cm / 100, claim.y_cm / 100) if slot != NO_SLOT else (math.nan, math.nan)
        self._spans.append(Span(at_s, at_s, phase, slot, claim.generation, *place_m))

    def view(self) -> RobotView:
        table = np.array(self._track).reshape(-1, 4)
        track = Track(table[:, 0], table[:, 1], table[:, 2], table[:, 3])
        return RobotView(
            self._robot, self._body, track, self._spans, self.ends, self.ways, self.happenings, self.conflicts
        )


def phase_of(frame: air.StateFrame) -> str:
    """What a robot does, in the words of its STATE."""
    if frame.flags & air.FLAG_STOPPED:
        return STOPPED
    if frame.status == air.LOST:
        return LOST
    if frame.claim.slot == air.NO_SLOT:
        return IDLE if frame.status == air.IDLE else NOT_READY
    if frame.status == air.SERVING:
        return SERVING
    return CONFIRMED if frame.claim.confirmed else REQUESTED


def _corners(ix: NDArray[np.int64], iy: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The cells of a path at which it turns, with its ends."""
    if len(ix) < 3:
        return ix, iy
    dx, dy = np.diff(ix), np.diff(iy)
    turns = np.concatenate(([True], (dx[1:] != dx[:-1]) | (dy[1:] != dy[:-1]), [True]))
    return ix[turns], iy[turns]
