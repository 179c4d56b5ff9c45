"""The common snapshot of a round: every robot's last row, and which robots and tasks take part.

Decides who is available and what waits; everyone who holds the same rows computes the same, whoever passed
them on. Our own row is what we broadcast, not what we know by now: others decide on it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.port import Decision, Problem
from hippomat_core.fleet.claims import Basis
from hippomat_core.fleet.rows import HEARD_DIRECTLY, Row, own_row
from hippomat_core.fleet.state import FleetState
from hippomat_core.fleet.tasks import Tasks
from hippomat_core.fleet.votes import ClaimId
from hippomat_core.messages import NEVER_HEARD_MS, RoundDecided
from hippomat_core.replaced import quickly_made
from hippomat_core.wire.frames import (
    CLAIMED,
    NO_SLOT,
    UNREACHABLE,
    WAITING,
)

LATE_ROUNDS = 1.5  # rounds by our own count: a row older than this was not refreshed in its round


@quickly_made
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
    # A few robots: lists are filled, and made arrays, in a fraction of the time that single elements take.
    available, busy, present, assigned, agree = ([False] * n for _ in range(5))
    late, ages = [True] * n, [math.inf] * n
    sequence, boot, rssi, slot, via = [0] * n, [0] * n, [0] * n, [NO_SLOT] * n, [HEARD_DIRECTLY] * n
    known, dead_ns = (None, fleet.tasks.digest), fleet.timing.dead_ns
    for row in _rows(fleet):
        k = row.robot
        ages[k] = stamp_ns - row.stamp_ns
        sequence[k], boot[k], rssi[k], via[k] = row.sequence, row.boot, row.rssi_dbm, row.via
        if not row.agrees:
            continue
        late[k] = _is_late(fleet, stamp_ns, row)
        slot[k] = row.slot
        costs[k] = row.costs
        present[k] = stamp_ns - row.alive_ns <= dead_ns
        assigned[k] = row.slot != NO_SLOT
        available[k] = present[k] and row.available
        busy[k] = present[k] and row.busy
        agree[k] = row.generations_digest in known
    if fleet.sent_generations is not None and fleet.robot >= 0:
        costs[fleet.robot, fleet.sent_generations != fleet.tasks.generations] = UNREACHABLE
    ages_ns = np.array(ages, np.float64)
    problem = Problem(
        costs_q=costs,
        available=np.array(available, np.bool_),
        busy=np.array(busy, np.bool_),
        waiting=waiting_tasks(fleet, stamp_ns),
        present=np.array(present, np.bool_),
        assigned=np.array(assigned, np.bool_),
        ages_rounds=(ages_ns / fleet.timing.round_ns).astype(np.float32),
        self_index=max(fleet.robot, 0),
        round=fleet.clock.round,
        seed=fleet.config.seed,
    )
    return Snapshot(
        problem=problem,
        late=np.array(late, np.bool_),
        digests_agree=np.array(agree, np.bool_),
        sequence=np.array(sequence, np.uint32),
        boot=np.array(boot, np.uint32),
        age_ms=np.minimum(ages_ns / 1e6, NEVER_HEARD_MS).astype(np.uint16),
        rssi_dbm=np.array(rssi, np.int8),
        via=np.array(via, np.uint8),
        slot=np.array(slot, np.uint8),
    )


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


def waiting_tasks(fleet: FleetState, stamp_ns: int) -> NDArray[np.bool_]:
    """(M,) True where a task is open, unclaimed and known for long enough that rows price it."""
    settled = stamp_ns - fleet.tasks.changed_ns >= fleet.timing.settle_ns
    waiting: NDArray[np.bool_] = (task_states(fleet) == WAITING) & settled
    return waiting


def task_states(fleet: FleetState) -> NDArray[np.uint8]:
    """(M,) for STATE: as in the table, CLAIMED where somebody alive claims the newest generation.

    Ourselves included. Not to be written to.
    """
    return _task_states(fleet.tasks, fleet.rows(), None if fleet.own_claim is None else fleet.own_claim.id)


@lru_cache(maxsize=64)  # asked for three times a round
def _task_states(tasks: Tasks, rows: tuple[Row, ...], own: ClaimId | None) -> NDArray[np.uint8]:
    states = tasks.states.copy()
    for claim in (own, *[row.claim for row in rows]):
        if claim is None or claim.generation != tasks.generations[claim.slot]:
            continue
        if states[claim.slot] == WAITING:
            states[claim.slot] = CLAIMED
    states.flags.writeable = False
    return states


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
