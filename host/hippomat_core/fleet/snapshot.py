"""The common snapshot of a round: every robot's last row, and which robots and tasks take part.

Decides who is available and what waits; everyone who holds the same rows computes the same, whoever passed
them on. Our own row is what we broadcast, not what we know by now: others decide on it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.port import Decision, Problem
from hippomat_core.fleet.claims import Basis
from hippomat_core.fleet.rows import HEARD_DIRECTLY, Row, own_row
from hippomat_core.fleet.state import FleetState
from hippomat_core.messages import NEVER_HEARD_MS, RoundDecided
from hippomat_core.wire.frames import (
    CLAIMED,
    NO_SLOT,
    UNREACHABLE,
    WAITING,
)

LATE_ROUNDS = 1.5  # rounds by our own count: a row older than this was not refreshed in its round


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """The problem and the ledger of the rows that it was made from."""

    problem: Problem
    late: NDArray[np.bool_]  # (N,) no row of this round is held
    digests_agree: NDArray[np.bool_]  # (N,) as far as the row says
    sequence: NDArray[np.uint32]  # (N,) this, boot and RSSI: of the frame that brought the row
    boot: NDArray[np.uint32]  # (N,)
    age_ms: NDArray[np.uint16]  # (N,) NEVER_HEARD_MS: never heard
    rssi_dbm: NDArray[np.int8]  # (N,)
    via: NDArray[np.uint8]  # (N,) who passed the row on; HEARD_DIRECTLY
    slot: NDArray[np.uint8]  # (N,) of the row's claim

    def basis(self, allocator: str) -> Basis:
        return Basis(self.late, self.problem.available, self.digests_agree, allocator)


def take_snapshot(fleet: FleetState, stamp_ns: int) -> Snapshot:
    """The rows held at `stamp_ns`, the end of round `fleet.clock.round`."""
    n, m = len(fleet.peers), len(fleet.tasks.generations)
    costs = np.full((n, m), UNREACHABLE, np.uint8)
    available, busy, present, assigned, agree = (np.zeros(n, np.bool_) for _ in range(5))
    late, ages_ns = np.ones(n, np.bool_), np.full(n, np.inf)
    sequence, boot = np.zeros(n, np.uint32), np.zeros(n, np.uint32)
    rssi, slot = np.zeros(n, np.int8), np.full(n, NO_SLOT, np.uint8)
    via = np.full(n, HEARD_DIRECTLY, np.uint8)
    for row in _rows(fleet):
        k = row.robot
        ages_ns[k] = stamp_ns - row.stamp_ns
        sequence[k], boot[k], rssi[k], via[k] = row.sequence, row.boot, row.rssi_dbm, row.via
        if not row.agrees:
            continue
        late[k] = _is_late(fleet, stamp_ns, row)
        slot[k] = row.slot
        costs[k] = row.costs
        present[k] = stamp_ns - row.alive_ns <= fleet.timing.dead_ns
        assigned[k] = row.slot != NO_SLOT
        available[k] = present[k] and row.available
        busy[k] = present[k] and row.busy
        agree[k] = row.generations_digest in (None, fleet.tasks.digest)
    if fleet.sent_generations is not None and fleet.robot >= 0:
        costs[fleet.robot, fleet.sent_generations != fleet.tasks.generations] = UNREACHABLE
    problem = Problem(
        costs_q=costs,
        available=available,
        busy=busy,
        waiting=waiting_tasks(fleet, stamp_ns),
        present=present,
        assigned=assigned,
        ages_rounds=(ages_ns / fleet.timing.round_ns).astype(np.float32),
        self_index=max(fleet.robot, 0),
        round=fleet.clock.round,
        seed=fleet.config.seed,
    )
    age_ms = np.minimum(ages_ns / 1e6, NEVER_HEARD_MS).astype(np.uint16)
    return Snapshot(problem, late, agree, sequence, boot, age_ms, rssi, via, slot)


def _rows(fleet: FleetState) -> Iterator[Row]:
    """The newest row of everybody; ours is the one that we gave to our radio at the last round end."""
    yield from fleet.rows()
    if fleet.sent is not None:
        yield own_row(fleet.robot, fleet.sent, fleet.clock.round, fleet.clock.ended_ns)


def _is_late(fleet: FleetState, stamp_ns: int, row: Row) -> bool:
    """Whether the row is not of this round."""
    if fleet.clock.common:
        return row.round < fleet.clock.round
    return stamp_ns - row.stamp_ns > LATE_ROUNDS * fleet.timing.round_ns


def live_claims(fleet: FleetState) -> NDArray[np.bool_]:
    """(M,) True where somebody alive claims the newest generation, ourselves included."""
    claimed = np.zeros(len(fleet.tasks.generations), np.bool_)
    claims = [row.claim for row in fleet.rows()]
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
        row_via=snapshot.via,
        row_available=problem.available.astype(np.uint8),
        row_busy=problem.busy.astype(np.uint8),
        row_slot=snapshot.slot,
        costs=problem.costs_q.reshape(-1),
        generations=fleet.tasks.generations,
        task_states=task_states(fleet),
        logits=decision.logits,
        action=action,
        reason=reason,
    )
