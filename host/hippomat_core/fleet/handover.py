"""A claim handed over: a robot on its way leaves its task to an idle one that would be there much sooner.

Only where the task stays in its slot until it is served (not turnover on_claim). A handover is a claim
released and another made: rule F sees nothing else, so it can break nothing. The heir must have nothing else
to do in this round, and the allocator, run on the snapshot without our claim, must give it the task. We then
leave the task alone for a while, and hand it over once only, so that it cannot go to and fro. Knows no path:
the caller says how far away the task still is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.port import Problem
from hippomat_core.allocation.quantise import dequantise
from hippomat_core.fleet.claims import OwnClaim
from hippomat_core.fleet.holding import Step, ended
from hippomat_core.fleet.inputs import OwnInputs
from hippomat_core.fleet.rows import HEARD_DIRECTLY
from hippomat_core.fleet.snapshot import Snapshot, take_snapshot
from hippomat_core.fleet.state import FleetState
from hippomat_core.replaced import replace
from hippomat_core.wire.frames import UNREACHABLE


def hand_over(fleet: FleetState, stamp_ns: int, own: OwnInputs) -> Step:
    """Releases our claim where an heir would gain more than [fleet] handover_gain_s."""
    claim = fleet.own_claim
    if claim is None or not _may(fleet, claim, own):
        return fleet, []
    snapshot = take_snapshot(fleet, stamp_ns)
    nearer = _nearer(fleet, snapshot, claim, own)
    heir = _heir(fleet, snapshot.problem, nearer, claim, own) if nearer.any() else None
    if heir is None:
        return fleet, []
    newest = fleet.tasks.generations
    still_open = {(slot, generation) for slot, generation in fleet.handed_over if generation == newest[slot]}
    fleet = replace(
        fleet,
        shunned=(*fleet.shunned, (*claim.id.task, stamp_ns + fleet.timing.handover_ns)),
        handed_over=frozenset(still_open | {claim.id.task}),
    )
    return ended(fleet, stamp_ns, "released", f"handed over to robot {heir}")


def _may(fleet: FleetState, claim: OwnClaim, own: OwnInputs) -> bool:
    settings = fleet.config
    wanted = settings.handover_gain_s > 0.0 and settings.turnover != "on_claim"
    on_the_way = claim.confirmed and claim.serving_ns is None and not own.arrived
    return wanted and on_the_way and claim.id.task not in fleet.handed_over


def _nearer(fleet: FleetState, snapshot: Snapshot, claim: OwnClaim, own: OwnInputs) -> NDArray[np.bool_]:
    """(N,) available robots that would be at our task sooner by more than the gain.

    By a row of this round, heard from themselves: who hears us badly would not notice that the task is free.
    """
    there_s = dequantise(snapshot.problem.costs_q[:, claim.id.slot], own.c_max_s)
    fresh = ~snapshot.late & (snapshot.via == HEARD_DIRECTLY) & snapshot.digests_agree
    gains = there_s + fleet.config.handover_gain_s < own.outlook_of(claim).eta_s
    nearer: NDArray[np.bool_] = snapshot.problem.available & fresh & gains
    return nearer


def _heir(
    fleet: FleetState, problem: Problem, nearer: NDArray[np.bool_], claim: OwnClaim, own: OwnInputs
) -> int | None:
    """Who of them gets nothing now and our task without us; the smallest id if several ask for it."""
    gets_nothing = fleet.allocator.actions(problem) == 0
    if not (nearer & gets_nothing).any():
        return None
    without_us = fleet.allocator.actions(_released(fleet, problem, claim, own))
    heirs = np.flatnonzero(nearer & gets_nothing & (without_us == claim.id.slot + 1))
    return int(heirs[0]) if len(heirs) else None


def _released(fleet: FleetState, problem: Problem, claim: OwnClaim, own: OwnInputs) -> Problem:
    """The snapshot as it would be had we no claim, and no wish for its task."""
    robot = fleet.robot
    costs_q = problem.costs_q.copy()
    costs_q[robot] = own.costs_here()
    costs_q[robot, claim.id.slot] = UNREACHABLE
    us, task = np.arange(len(costs_q)) == robot, np.arange(costs_q.shape[1]) == claim.id.slot
    return replace(
        problem,
        costs_q=costs_q,
        available=problem.available | us,
        busy=problem.busy & ~us,
        assigned=problem.assigned & ~us,
        waiting=problem.waiting | task,
    )
