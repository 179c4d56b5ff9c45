"""One robot's part in a fleet's story, as values: what it decided, claimed, said and learnt, and when.

Robots are compared by allocation round, which counts fleet time and so is the same for all; log times are
each robot's own. Knows no files and draws no conclusions.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.wire.frames import WAITING, StateFrame
from hippomat_logs.definitions import Task

NO_ROUND = -1  # a row never heard, or of a frame that is not in the log


@dataclass(frozen=True, slots=True)
class Moment:
    """When, three ways: the allocation round that had ended last, the robot's own log time, the record."""

    round: int
    log_time_ns: int
    record: int


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """One round end of one robot. N rows in id order, M task slots."""

    robot: int
    at: Moment
    decided: m.RoundDecided
    common: bool  # the radios ended the round, and agreed on fleet time; else the robot counted alone
    held: int  # bitmap of the radio: row k of this round was heard; 0 where the robot counted alone
    row_round: NDArray[np.int64]  # (N,) of fleet time, in which its owner sent the row; NO_ROUND
    row_claim: tuple[Task | None, ...]  # (N,) that the row carries
    ages_rounds: NDArray[np.float32]  # (N,) as the allocator was given it
    present: NDArray[np.bool_]  # (N,) heard of within T_dead, if only through others
    settled: NDArray[np.bool_]  # (M,) the generation was known for long enough to be allocated

    @property
    def costs(self) -> NDArray[np.uint8]:
        """(N, M) codes"""
        return np.asarray(self.decided.costs, np.uint8).reshape(len(self.row_round), -1)

    @property
    def available(self) -> NDArray[np.bool_]:
        return np.asarray(self.decided.row_available, np.bool_)

    @property
    def busy(self) -> NDArray[np.bool_]:
        return np.asarray(self.decided.row_busy, np.bool_)

    @property
    def waiting(self) -> NDArray[np.bool_]:
        """(M,) tasks that could be allocated here."""
        waiting: NDArray[np.bool_] = (np.asarray(self.decided.task_states) == WAITING) & self.settled
        return waiting

    @property
    def late(self) -> NDArray[np.bool_]:
        """(N,) the row is not of this round."""
        late: NDArray[np.bool_] = self.row_round < self.at.round
        return late

    @property
    def requested(self) -> Task | None:
        if self.decided.action < 1:
            return None
        slot = self.decided.action - 1
        return slot, int(self.decided.generations[slot])


@dataclass(slots=True, eq=False)
class Claim:
    """One claim of one robot from its request to its end. Codes are quantised costs; positions: map frame."""

    robot: int
    task: Task
    tag: int
    code: int
    goal_m: tuple[float, float]
    requested: Moment
    decision: Decision | None = None  # in which it was requested
    on_air: tuple[int, int] | None = None  # round and sequence of the first STATE that carried it
    changes: list[tuple[str, str, Moment]] = field(default_factory=list)  # confirmed / unconfirmed, why, when
    votes: dict[int, Moment] = field(default_factory=dict)  # robot -> when its endorsement was first heard
    ended: Moment | None = None  # None: alive where the log ends
    end: str = ""  # dropped, released, completed
    why: str = ""
    driven_m: float = 0.0
    paths: list[tuple[Moment, float, str]] = field(default_factory=list)  # length [m], cause
    recoveries: list[tuple[Moment, str, str]] = field(default_factory=list)  # step, cause
    guarded: int = 0  # ticks in which the scan guard slowed or stopped it

    def alive_in(self, number: int) -> bool:
        """At the end of round `number`."""
        return self.requested.round <= number and (self.ended is None or number < self.ended.round)

    def confirmed_rounds(self) -> list[tuple[int, int | None]]:
        """Half-open spans of rounds; None: until the log ends."""
        spans: list[tuple[int, int | None]] = []
        for what, _, at in self.changes:
            if what == "confirmed":
                spans.append((at.round, None))
            elif spans and spans[-1][1] is None:
                spans[-1] = spans[-1][0], at.round
        if spans and spans[-1][1] is None and self.ended is not None:
            spans[-1] = spans[-1][0], self.ended.round
        return spans

    def confirmed_in(self, number: int) -> bool:
        return any(
            begun <= number and (end is None or number < end) for begun, end in self.confirmed_rounds()
        )


@dataclass(slots=True, eq=False)
class RobotStory:
    """What one robot's log tells. Lists are in the order of the log."""

    robot: int
    size: int  # robots in the roster
    slots: int
    rounds: tuple[int, int] = (NO_ROUND, NO_ROUND)  # first and last that it ended
    begun_ns: int = 0
    claims: list[Claim] = field(default_factory=list)
    decisions: dict[int, Decision] = field(default_factory=dict)  # by round; those that were asked for
    conflicts: list[tuple[Moment, m.ConflictSeen]] = field(default_factory=list)
    turned: list[tuple[Moment, m.TaskTurned]] = field(default_factory=list)
    sent: dict[int, tuple[int, bool]] = field(default_factory=dict)  # STATE by round: sequence, on the air
    said: dict[int, StateFrame] = field(default_factory=dict)  # STATE by round in which it was on the air
    peers: list[tuple[Moment, m.PeerClaimSeen]] = field(default_factory=list)  # what it heard of their claims
    map: m.MapReceived | None = None
    lost: list[str] = field(default_factory=list)
    recovered: bool = False

    def covers(self, number: int) -> bool:
        """Whether the log says what this robot did in that round."""
        return self.rounds[0] <= number <= self.rounds[1]

    def generation_in(self, slot: int, number: int) -> int:
        """The newest one it knew of at the end of that round; -1: none."""
        known = [
            turned.generation for at, turned in self.turned if turned.slot == slot and at.round <= number
        ]
        return known[-1] if known else -1
