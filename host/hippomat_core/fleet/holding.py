"""Our claim through a round: does it stand, is it confirmed, does its slot turn, is the task served.

Rule F, the claimant's part, applied to the fleet's state (reasons in votes.py). Knows no path and no
motor: the caller says when the robot has arrived.
"""

from __future__ import annotations

from hippomat_core.fleet.claims import (
    OwnClaim,
    conflict_cause,
    count_votes,
    is_superior,
    quorum,
    serves_alone,
    tag_ended,
)
from hippomat_core.fleet.inputs import OwnInputs
from hippomat_core.fleet.state import FleetState
from hippomat_core.fleet.tasks import turned_effects
from hippomat_core.messages import ConflictSeen, Effect
from hippomat_core.replaced import replace

_STAGGER_ROUNDS = 8  # between robots that give up one contested task: long enough to confirm another

Step = tuple[FleetState, list[Effect]]


def judge(fleet: FleetState, stamp_ns: int, own: OwnInputs) -> Step:
    """Whether our claim stands, against the caller's reasons, newer generations and other claims."""
    claim = fleet.own_claim
    if claim is None:
        return fleet, []
    newest = int(fleet.tasks.generations[claim.id.slot])
    if own.drop_claim and own.shun_s:
        shunned = (*fleet.shunned, (*claim.id.task, stamp_ns + round(own.shun_s * 1e9)))
        fleet = replace(fleet, shunned=shunned)
    if own.drop_claim or fleet.barred:
        return ended(fleet, stamp_ns, "dropped", own.drop_claim or fleet.barred)
    if claim.id.generation < newest and not claim.turned:
        return ended(fleet, stamp_ns, "dropped", "superseded")
    effects: list[Effect] = []
    for row in fleet.rows():
        other = row.claim
        if other is None or other.task != claim.id.task:
            continue
        kept = is_superior(claim, other, row.confirmed)
        cause = conflict_cause(claim, other)
        if other not in claim.opposed:
            effects.append(ConflictSeen(*other.task, other.robot, kept, cause))
            others = (known for known in claim.opposed if known.robot != other.robot)
            claim = replace(claim, opposed=(*others, other))
        if not kept:
            fleet, more = ended(fleet, stamp_ns, "dropped", f"conflict: {cause}")
            return fleet, effects + more
    return _give_up_if_refused(replace(fleet, own_claim=claim), stamp_ns, effects)


def _give_up_if_refused(fleet: FleetState, stamp_ns: int, effects: list[Effect]) -> Step:
    """A majority is heard and yet does not vote for us: let the claim go, and leave the task to others."""
    claim, timing = fleet.own_claim, fleet.timing
    assert claim is not None
    if claim.confirmed or fleet.alive(stamp_ns) < len(fleet.peers) // 2 + 1:
        return replace(fleet, own_claim=replace(claim, refused_ns=None)), effects
    since_ns = stamp_ns if claim.refused_ns is None else claim.refused_ns
    patience_ns = timing.refused_ns + _STAGGER_ROUNDS * timing.round_ns * fleet.robot
    if stamp_ns - since_ns < patience_ns:
        return replace(fleet, own_claim=replace(claim, refused_ns=since_ns)), effects
    shunned = (*fleet.shunned, (*claim.id.task, stamp_ns + 2 * timing.refused_ns))
    fleet, more = ended(replace(fleet, shunned=shunned), stamp_ns, "dropped", "refused")
    return fleet, effects + more


def ended(fleet: FleetState, stamp_ns: int, what: str, cause: str) -> Step:
    """Our claim is over, and its tag rests."""
    claim = fleet.own_claim
    assert claim is not None
    tags = tag_ended(fleet.tag_free_ns, claim.id.tag, stamp_ns, fleet.timing)
    return replace(fleet, own_claim=None, tag_free_ns=tags), [claim.changed(what, cause)]


def is_confirmed_at(fleet: FleetState, stamp_ns: int) -> bool:
    """Whether our claim is confirmed at this very instant; between two round ends votes may run out."""
    claim = fleet.own_claim
    return claim is not None and _votes_at(fleet, claim, stamp_ns) >= _needed_at(fleet, stamp_ns)


def _votes_at(fleet: FleetState, claim: OwnClaim, stamp_ns: int) -> int:
    return count_votes(claim, fleet.peers, stamp_ns, fleet.trusted_from_ns, fleet.timing.lease_ns)


def _needed_at(fleet: FleetState, stamp_ns: int) -> int:
    roster = len(fleet.peers)
    return quorum(roster, fleet.alive(stamp_ns), serves_alone(fleet.config.partition, roster))


def confirm(fleet: FleetState, stamp_ns: int, _: OwnInputs) -> Step:
    claim = fleet.own_claim
    if claim is None:
        return fleet, []
    confirmed = is_confirmed_at(fleet, stamp_ns)
    if confirmed == claim.confirmed:
        return fleet, []
    cause = f"{_votes_at(fleet, claim, stamp_ns)} of {len(fleet.peers)} votes"
    claim = replace(claim, confirmed=confirmed, changed_ns=stamp_ns)
    changed = claim.changed("confirmed" if confirmed else "unconfirmed", cause)
    return replace(fleet, own_claim=claim), [changed]


def turn(fleet: FleetState, stamp_ns: int, _: OwnInputs) -> Step:
    """on_claim: an allocated task is replaced, after a moment for the votes that are still on their way.

    Whoever knows the newer generation votes for this claim no more, so late votes would be lost.
    """
    claim = fleet.own_claim
    if fleet.config.turnover != "on_claim" or claim is None or claim.turned or not claim.confirmed:
        return fleet, []
    alive = fleet.alive_peers(stamp_ns)
    everyone = all(int(peer.frame.endorsed[fleet.robot]) == claim.id.tag for peer in alive)
    if not everyone and stamp_ns - claim.changed_ns < fleet.timing.turn_ns:
        return fleet, []
    return _turned(replace(fleet, own_claim=replace(claim, turned=True)), stamp_ns, claim, "claimed")


def _turned(fleet: FleetState, stamp_ns: int, claim: OwnClaim, cause: str) -> Step:
    tasks = fleet.tasks.turned(claim.id.slot, fleet.sites, stamp_ns)
    turned = turned_effects(fleet.tasks, tasks, cause)
    return replace(fleet, tasks=tasks, self_turned_ns=stamp_ns), list(turned)


def serve(fleet: FleetState, stamp_ns: int, own: OwnInputs) -> Step:
    """At the goal and confirmed for dwell_s without interruption: completed, while it is confirmed."""
    claim = fleet.own_claim
    if claim is None:
        return fleet, []
    if not (claim.confirmed and own.arrived and own.may_serve):
        return replace(fleet, own_claim=replace(claim, serving_ns=None)), []
    since_ns = stamp_ns if claim.serving_ns is None else claim.serving_ns
    if stamp_ns - since_ns < round(fleet.config.dwell_s * 1e9):
        return replace(fleet, own_claim=replace(claim, serving_ns=since_ns)), []
    fleet, effects = ended(fleet, stamp_ns, "completed", "served")
    if claim.turned:
        return fleet, effects
    fleet, turned = _turned(fleet, stamp_ns, claim, "completed")
    return fleet, effects + turned
