"""One robot's story out of its log, in one pass: claims, decisions, frames on the air.

Decides to which round and claim each record belongs. Remembers only what was asked for and what is rare, so
that a log of any length fits. Concludes nothing about other robots.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.config import Config
from hippomat_core.control.recovery import FREE
from hippomat_core.fleet.timing import Timing
from hippomat_core.wire.frames import NO_SLOT, STATE, StateFrame
from hippomat_logs.definitions import Task
from hippomat_logs.fleet_story.ledger import Ledger
from hippomat_logs.fleet_story.values import NO_ROUND, Claim, Decision, Moment, RobotStory
from hippomat_logs.reader import Record

_LONG_AGO = -(10**18)
# a record of these begins a new step of the core: effects behind it are its answer
_EVENTS = (m.RoundEnded, m.Tick, m.StateHeard, m.RelayHeard, m.TasksHeard, m.FrameSent, m.MapReceived)
KINDS = (
    *_EVENTS,
    m.RoundDecided,
    m.SendState,
    m.ClaimChanged,
    m.ConflictSeen,
    m.PeerClaimSeen,
    m.TaskTurned,
    m.PathPlanned,
    m.PoseEstimated,
    m.RecoveryChanged,
    m.GuardLimited,
)
Keep = Callable[[int, m.RoundDecided], bool]  # robot, its decision


def requests_only(_: int, decided: m.RoundDecided) -> bool:
    return decided.action > 0


class RobotReading:
    """Takes records in their order; `result` may be asked for once."""

    def __init__(
        self, robot: int, config: Config, keep: Keep = requests_only, said_in: Sequence[int] = ()
    ) -> None:
        """keep: which decisions to keep whole; said_in: rounds of which to keep the STATE on the air."""
        self._story = RobotStory(robot, config.fleet.size, config.fleet.task_slots)
        self._keep, self._said_in = keep, said_in
        self._timing = Timing.of(config.fleet)
        self._ledger = Ledger(robot, config.fleet.size, self._timing.round_us)
        self._changed_ns = np.full(config.fleet.task_slots, _LONG_AGO, np.int64)
        self._claim: Claim | None = None
        self._at = Moment(NO_ROUND, _LONG_AGO, 0)  # the last round end
        self._ended: m.RoundEnded | None = None  # the event whose answer we are reading, if it is one
        self._fleet_offset_us: int | None = None
        self._mailbox: StateFrame | None = None
        self._waits: list[Record] = []  # effects of a round end, before its RoundDecided says which
        self._place: tuple[float, float] | None = None
        self._handlers: dict[type, Callable[[Moment, Any], None]] = {
            m.StateHeard: self._state_heard,
            m.RelayHeard: lambda at, event: self._ledger.relay(at.log_time_ns, event),
            m.FrameSent: self._frame_sent,
            m.MapReceived: self._map_received,
            m.SendState: self._send_state,
            m.PathPlanned: self._path_planned,
            m.PoseEstimated: self._pose_estimated,
            m.RecoveryChanged: self._recovery_changed,
            m.GuardLimited: self._guard_limited,
        }

    def feed(self, record: Record) -> None:
        message = record.message
        if not self._story.begun_ns:
            self._story.begun_ns = record.log_time_ns
        if isinstance(message, _EVENTS):
            self._settle(self._at.round)
            self._ended = message if isinstance(message, m.RoundEnded) else None
            if self._ended is not None:
                self._fleet_offset_us = self._ended.fleet_time_us - self._ended.radio_time_us
        if isinstance(message, m.RoundDecided):
            self._round_decided(record, message)
        elif isinstance(message, m.ClaimChanged | m.ConflictSeen | m.TaskTurned | m.PeerClaimSeen):
            if isinstance(message, m.ClaimChanged) and message.what == "requested":  # comes behind it
                self._requested(self._moment(record), message)
            else:
                self._waits.append(record)
        elif type(message) in self._handlers:
            self._handlers[type(message)](self._moment(record), message)

    def result(self) -> RobotStory:
        self._settle(self._at.round)
        return self._story

    def _moment(self, record: Record) -> Moment:
        return Moment(self._at.round, record.log_time_ns, record.number)

    # ---- a round end ----

    def _settle(self, number: int) -> None:
        """What the step said before it came to its decision, if it did."""
        for record in self._waits:
            at = Moment(number, record.log_time_ns, record.number)
            message = record.message
            if isinstance(message, m.ClaimChanged):
                self._claim_changed(at, message)
            elif isinstance(message, m.TaskTurned):
                known_before = message.cause == "start"
                self._changed_ns[message.slot] = _LONG_AGO if known_before else at.log_time_ns
                self._story.turned.append((at, message))
            elif isinstance(message, m.PeerClaimSeen):
                self._story.peers.append((at, message))
            else:
                self._story.conflicts.append((at, message))
        self._waits = []

    def _round_decided(self, record: Record, decided: m.RoundDecided) -> None:
        self._settle(decided.round)
        story, before = self._story, self._at
        self._at = Moment(decided.round, record.log_time_ns, record.number)
        first = decided.round if story.rounds[0] == NO_ROUND else story.rounds[0]
        story.rounds = first, decided.round
        if self._keep(story.robot, decided):
            story.decisions[decided.round] = self._decision(decided, before)

    def _decision(self, decided: m.RoundDecided, before: Moment) -> Decision:
        ended, now_ns = self._ended, self._at.log_time_ns
        common = ended is not None and ended.round == decided.round
        rows = self._ledger.rows(now_ns, decided, before.log_time_ns, self._own_claim())
        timing = self._timing
        return Decision(
            robot=self._story.robot,
            at=self._at,
            decided=decided,
            common=common and ended is not None and ended.agreed,
            held=ended.held if common and ended is not None else 0,
            row_round=rows.rounds,
            row_claim=rows.claims,
            ages_rounds=(rows.ages_ns / timing.round_ns).astype(np.float32),
            present=rows.alive_ns <= timing.dead_ns,
            settled=self._settled(now_ns),
        )

    def _settled(self, now_ns: int) -> NDArray[np.bool_]:
        settled: NDArray[np.bool_] = now_ns - self._changed_ns >= self._timing.settle_ns
        return settled

    def _own_claim(self) -> Task | None:
        """In the STATE that others decide on."""
        frame = self._mailbox
        if frame is None or frame.claim.slot == NO_SLOT:
            return None
        return frame.claim.slot, frame.claim.generation

    # ---- claims ----

    def _requested(self, at: Moment, changed: m.ClaimChanged) -> None:
        task, goal_m = (changed.slot, changed.generation), (changed.x_m, changed.y_m)
        claim = Claim(self._story.robot, task, changed.tag, changed.cost, goal_m, at)
        claim.decision = self._story.decisions.get(at.round)
        self._story.claims.append(claim)
        self._claim = claim

    def _claim_changed(self, at: Moment, changed: m.ClaimChanged) -> None:
        claim = self._claim
        if claim is None or claim.task != (changed.slot, changed.generation):
            return  # of a claim made before this log began
        if changed.what in ("confirmed", "unconfirmed"):
            claim.changes.append((changed.what, changed.cause, at))
        else:
            claim.ended, claim.end, claim.why = at, changed.what, changed.cause
            self._claim = None

    # ---- the air ----

    def _state_heard(self, at: Moment, event: m.StateHeard) -> None:
        self._ledger.state(at.log_time_ns, event)
        claim, endorsed = self._claim, event.frame.endorsed
        robot, sender = self._story.robot, event.header.sender
        if claim is not None and robot < len(endorsed) and int(endorsed[robot]) == claim.tag:
            claim.votes.setdefault(sender, at)

    def _send_state(self, _: Moment, effect: m.SendState) -> None:
        self._mailbox = effect.frame

    def _frame_sent(self, _: Moment, event: m.FrameSent) -> None:
        if event.kind != STATE or self._fleet_offset_us is None:
            return
        number = (event.radio_time_us + self._fleet_offset_us) // self._timing.round_us
        self._story.sent[number] = event.sequence, event.sent
        frame, claim = self._mailbox, self._claim
        if not event.sent or frame is None:
            return
        if number in self._said_in:
            self._story.said[number] = frame
        carried = claim is not None and (frame.claim.slot, frame.claim.generation) == claim.task
        if claim is not None and carried and claim.on_air is None:
            claim.on_air = number, event.sequence

    def _map_received(self, _: Moment, event: m.MapReceived) -> None:
        self._story.map = event

    # ---- driving ----

    def _pose_estimated(self, _: Moment, pose: m.PoseEstimated) -> None:
        if self._claim is None:
            self._place = None
            return
        if self._place is not None:
            way_m = np.hypot(pose.x_m - self._place[0], pose.y_m - self._place[1])
            self._claim.driven_m += float(way_m)
        self._place = pose.x_m, pose.y_m

    def _path_planned(self, at: Moment, path: m.PathPlanned) -> None:
        if self._claim is not None:
            self._claim.paths.append((at, path.length_m, path.cause))

    def _recovery_changed(self, at: Moment, change: m.RecoveryChanged) -> None:
        if self._claim is not None and change.step != FREE:
            self._claim.recoveries.append((at, change.step, change.cause))

    def _guard_limited(self, _: Moment, __: m.GuardLimited) -> None:
        if self._claim is not None:
            self._claim.guarded += 1
