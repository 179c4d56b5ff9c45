"""The common snapshot of a round: every robot's last row, and which robots and tasks take part.

Decides who is available and what waits; everyone who heard the same rows computes the same. Our own row is
what we broadcast, not what we know by now: others decide on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.port import Decision, Problem
from hippomat_core.fleet.claims import Basis
from hippomat_core.fleet.state import FleetState
from hippomat_core.messages import RoundDecided
from hippomat_core.wire.frames import (
    CLAIMED,
    FLAG_LOCALIZED,
    FLAG_STOPPED,
    IDLE,
    NO_SLOT,
    UNREACHABLE,
    WAITING,
    StateFrame,
)


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """The problem and the ledger of the rows that it was made from."""

    problem: Problem
    digests_agree: NDArray[np.bool_]  # (N,)
    sequence: NDArray[np.uint32]  # (N,)
    boot: NDArray[np.uint32]  # (N,)
    age_ms: NDArray[np.uint16]  # (N,) 65535 = never heard
    rssi_dbm: NDArray[np.int8]  # (N,)
    slot: NDArray[np.uint8]  # (N,) of the row's claim

    def basis(self, allocator: str) -> Basis:
        problem = self.problem
        return Basis(problem.ages_rounds, problem.available, self.digests_agree, allocator)


def take_snapshot(fleet: FleetState, stamp_ns: int, number: int) -> Snapshot:
    """The rows held at `stamp_ns`, the end of round `number`."""
    n, m = len(fleet.peers), len(fleet.tasks.generations)
    costs = np.full((n, m), UNREACHABLE, np.uint8)
    available, present, assigned, agree = (np.zeros(n, np.bool_) for _ in range(4))
    ages_ns = np.full(n, np.inf)
    sequence, boot = np.zeros(n, np.uint32), np.zeros(n, np.uint32)
    rssi, slot = np.zeros(n, np.int8), np.full(n, NO_SLOT, np.uint8)
    for robot, frame, stamp in _rows(fleet):
        ages_ns[robot] = stamp_ns - stamp
        peer = fleet.peers[robot]
        if peer is not None:
            sequence[robot], boot[robot], rssi[robot] = peer.sequence, peer.boot, peer.rssi_dbm
            if not peer.agrees:
                continue
        slot[robot] = frame.claim.slot
        costs[robot] = frame.costs
        present[robot] = peer is None or stamp_ns - peer.alive_ns <= fleet.timing.dead_ns
        assigned[robot] = frame.claim.slot != NO_SLOT
        available[robot] = present[robot] and is_available(frame)
        agree[robot] = frame.generations_digest == fleet.tasks.digest
    if fleet.sent_generations is not None and fleet.robot >= 0:
        costs[fleet.robot, fleet.sent_generations != fleet.tasks.generations] = UNREACHABLE
    problem = Problem(
        costs_q=costs,
        available=available,
        waiting=waiting_tasks(fleet, stamp_ns),
        present=present,
        assigned=assigned,
        ages_rounds=(ages_ns / fleet.timing.round_ns).astype(np.float32),
        self_index=max(fleet.robot, 0),
        round=number,
        seed=fleet.config.seed,
    )
    age_ms = np.minimum(ages_ns / 1e6, 65535).astype(np.uint16)
    return Snapshot(problem, agree, sequence, boot, age_ms, rssi, slot)


def _rows(fleet: FleetState) -> list[tuple[int, StateFrame, int]]:
    rows = [(peer.robot, peer.frame, peer.stamp_ns) for peer in fleet.peers if peer is not None]
    if fleet.sent is not None:
        rows.append((fleet.robot, fleet.sent, fleet.last_round_ns))
    return sorted(rows, key=lambda row: row[0])


def is_available(frame: StateFrame) -> bool:
    """Whether a row's robot can be given a task: idle, without a claim, localized and not stopped."""
    able = frame.flags & FLAG_LOCALIZED and not frame.flags & FLAG_STOPPED
    return bool(able) and frame.status == IDLE and frame.claim.slot == NO_SLOT


def live_claims(fleet: FleetState) -> NDArray[np.bool_]:
    """(M,) True where somebody alive claims the newest generation, ourselves included."""
    claimed = np.zeros(len(fleet.tasks.generations), np.bool_)
    claims = [peer.claim for peer in fleet.peers if peer is not None]
    claims.append(fleet.own_claim.id if fleet.own_claim is not None else None)
    for claim in claims:
        if claim is not None and claim.generation == fleet.tasks.generations[claim.slot]:
            claimed[claim.slot] = True
    return claimed


def waiting_tasks(fleet: FleetState, stamp_ns: int) -> NDArray[np.bool_]:
    """(M,) True where a task is open, unclaimed and known for long enough that rows price it."""
    settled = stamp_ns - fleet.tasks.changed_ns >= fleet.timing.settle_ns
    waiting: NDArray[np.bool_] = (fleet.tasks.states == WAITING) & settled & ~live_claims(fleet)
    return waiting


def task_states(fleet: FleetState) -> NDArray[np.uint8]:
    """(M,) for STATE: as in the table, CLAIMED where somebody alive claims the newest generation."""
    claimed = (fleet.tasks.states == WAITING) & live_claims(fleet)
    return np.where(claimed, CLAIMED, fleet.tasks.states).astype(np.uint8)


def round_decided(
    fleet: FleetState, snapshot: Snapshot, decision: Decision, action: int, reason: str
) -> RoundDecided:
    """The decision with everything it was made from."""
    problem = snapshot.problem
    return RoundDecided(
        round=problem.round,
        allocator=fleet.allocator.name,
        row_sequence=snapshot.sequence,
        row_boot=snapshot.boot,
        row_age_ms=snapshot.age_ms,
        row_rssi_dbm=snapshot.rssi_dbm,
        row_available=problem.available.astype(np.uint8),
        row_slot=snapshot.slot,
        costs=problem.costs_q.reshape(-1),
        generations=fleet.tasks.generations,
        task_states=task_states(fleet),
        logits=decision.logits,
        action=action,
        reason=reason,
    )
