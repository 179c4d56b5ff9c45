"""The end of an allocation round: what we learn, hold, decide and say. A value in; a value and a STATE out.

Order: expire the silent, judge our claim, vote, confirm, turn, serve, hand over, decide, speak. Our request
is decided on our row as broadcast a round ago; the STATE built here carries the request and the next row.
Knows no clock, motor or path: the caller says where the robot is and what each task costs.
"""

from __future__ import annotations

from dataclasses import dataclass

from hippomat_core.allocation.port import NO_LOGITS, Decision
from hippomat_core.fleet import votes as rule_f
from hippomat_core.fleet.broadcast import state_frame, tasks_frames
from hippomat_core.fleet.claims import OwnClaim, free_tag
from hippomat_core.fleet.handover import hand_over
from hippomat_core.fleet.holding import Step, confirm, judge, serve, turn
from hippomat_core.fleet.inputs import OwnInputs
from hippomat_core.fleet.snapshot import Snapshot, round_decided, take_snapshot
from hippomat_core.fleet.state import FleetState, awake
from hippomat_core.fleet.votes import ClaimId
from hippomat_core.messages import ClaimChanged, Effect, PeerClaimSeen, RoundEnded
from hippomat_core.replaced import quickly_made, replace
from hippomat_core.wire.frames import StateFrame, TasksFrame


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class RoundOutcome:
    """What the caller sends, records and drives to. Frames are not among the effects."""

    state_frame: StateFrame | None  # None: observing, no map yet, or passive
    tasks_frames: tuple[TasksFrame, ...]
    effects: tuple[Effect, ...]
    destination: tuple[float, float, float] | None  # of the claim, metres
    has_claim: bool
    confirmed: bool


def end_round(fleet: FleetState, stamp_ns: int, own: OwnInputs) -> tuple[FleetState, RoundOutcome]:
    """Ends round `fleet.clock.round` at `stamp_ns`, which radio_ended or ended_alone has begun to end."""
    fleet = awake(fleet, stamp_ns)
    generations = fleet.tasks.generations
    effects: list[Effect] = []
    for step in (_expire, judge, _vote, confirm, turn, serve, hand_over, _decide):
        fleet, more = step(fleet, stamp_ns, own)
        effects += more
    frame: StateFrame | None = None
    orders: tuple[TasksFrame, ...] = ()
    if fleet.digest is not None and fleet.robot >= 0 and not fleet.barred:
        frame = state_frame(fleet, stamp_ns, own, generations)
        orders = tasks_frames(fleet, stamp_ns)
    fleet = replace(
        fleet,
        clock=fleet.clock.ended(stamp_ns),
        sent=frame,
        sent_generations=fleet.tasks.generations if frame is not None else None,
        tasks_cursor=fleet.tasks_cursor + len(orders),
    )
    claim = fleet.own_claim
    destination = None if claim is None else claim.destination_m
    confirmed = claim is not None and claim.confirmed
    return fleet, RoundOutcome(frame, orders, tuple(effects), destination, claim is not None, confirmed)


def radio_ended(fleet: FleetState, event: RoundEnded) -> tuple[FleetState, bool]:
    """The radio observed a round. True: it ends for us too, so call end_round at once."""
    stepped = fleet.clock.steps
    clock, ends = fleet.clock.heard(event)
    if clock.steps != stepped:  # what was read since may be old: listen, as after a boot
        fleet = replace(fleet, silent_from_ns=event.stamp_ns, in_step=False)
    return awake(replace(fleet, clock=clock), event.stamp_ns, event.radio_time_us), ends


def ended_alone(fleet: FleetState, stamp_ns: int) -> FleetState:
    """A round ends by our own count: `fleet.clock.due(stamp_ns)`. Call end_round at once."""
    return replace(fleet, clock=fleet.clock.ends_alone(stamp_ns))


def _expire(fleet: FleetState, stamp_ns: int, _: OwnInputs) -> Step:
    """Peers unheard for T_dead: their claims expire. The silence after a boot ends."""
    effects: list[Effect] = []
    peers, relayed = list(fleet.peers), list(fleet.relayed)
    for row in fleet.rows():
        if stamp_ns - row.alive_ns <= fleet.timing.dead_ns:
            continue
        if row.claim is not None:
            effects.append(PeerClaimSeen(row.robot, *row.claim.task, "expired"))
        peer, relayed[row.robot] = peers[row.robot], None
        peers[row.robot] = None if peer is None else replace(peer, live=False)
    in_step = fleet.in_step or _comes_into_step(fleet, stamp_ns)
    return replace(fleet, peers=tuple(peers), relayed=tuple(relayed), in_step=in_step), effects


def _comes_into_step(fleet: FleetState, stamp_ns: int) -> bool:
    """After a boot: silent for T_dead, and then until half of the peers know the generations we know."""
    if fleet.silent_from_ns is None or fleet.robot < 0:
        return False
    listened_ns = stamp_ns - fleet.silent_from_ns
    if listened_ns < fleet.timing.dead_ns:
        return False
    alive = fleet.alive_peers(stamp_ns)
    same = sum(peer.frame.generations_digest == fleet.tasks.digest for peer in alive)
    return 2 * same >= len(alive) or listened_ns >= 2 * fleet.timing.dead_ns


def _vote(fleet: FleetState, stamp_ns: int, _: OwnInputs) -> Step:
    newest = fleet.tasks.generations
    keeps_old = fleet.config.turnover == "on_claim"
    votes = rule_f.aged(fleet.votes, newest, keeps_old, stamp_ns, fleet.timing)
    if fleet.in_step and not fleet.barred:
        after_ns = max(fleet.clock.ended_ns, fleet.trusted_from_ns - 1)
        fresh = [
            (row.claim, row.stamp_ns)
            for row in fleet.rows()
            if row.claim is not None and row.read_ns > after_ns
        ]
        own = fleet.own_claim.id if fleet.own_claim is not None else None
        votes = rule_f.cast(votes, fresh, newest, own)
    return replace(fleet, votes=votes), []


def _decide(fleet: FleetState, stamp_ns: int, own: OwnInputs) -> Step:
    """The allocation: our request is a claim not yet confirmed."""
    shunned = tuple(entry for entry in fleet.shunned if stamp_ns < entry[2])
    fleet = replace(fleet, shunned=shunned)
    snapshot = take_snapshot(fleet, stamp_ns)
    decision, reason = Decision(0, NO_LOGITS), _why_not(fleet, stamp_ns, own, snapshot)
    action, requested = 0, list[Effect]()
    if not reason:
        decision = fleet.allocator.allocate(snapshot.problem)
        action, reason = _checked(fleet, snapshot, decision.action)
    decided = round_decided(fleet, snapshot, decision, action, reason)
    if action > 0:
        fleet, changed = _requested(fleet, stamp_ns, snapshot, action - 1)
        requested.append(changed)
    return fleet, [decided, *requested]


def _why_not(fleet: FleetState, stamp_ns: int, own: OwnInputs, snapshot: Snapshot) -> str:
    """Why nothing may be requested in this round; empty if it may."""
    if fleet.robot < 0:
        return "observing"
    if fleet.digest is None:
        return "no map"
    if fleet.barred:
        return fleet.barred
    if fleet.own_claim is not None:
        return "holds a claim"
    if not own.can_request:
        return own.why_not or "the robot cannot"
    silence = fleet.silent_from_ns is None or stamp_ns - fleet.silent_from_ns < fleet.timing.tag_reuse_ns
    if silence or not fleet.in_step:
        return "listening after the start"
    if stamp_ns < fleet.trusted_from_ns:
        return "held up"
    if free_tag(fleet.tag_free_ns, stamp_ns) is None:
        return "no claim tag free"
    if not snapshot.problem.available[fleet.robot]:
        return "not idle in its last STATE"
    return ""


def _checked(fleet: FleetState, snapshot: Snapshot, action: int) -> tuple[int, str]:
    if action == 0:
        return 0, "no task for this robot"
    slot = action - 1
    if not snapshot.problem.eligible[fleet.robot, slot]:
        raise ValueError(f"{fleet.allocator.name} requested slot {slot}, which is not open to it")
    if rule_f.bars(fleet.votes, (slot, int(fleet.tasks.generations[slot]))):
        return 0, "endorses another claim there"
    return action, "requested"


def _requested(
    fleet: FleetState, stamp_ns: int, snapshot: Snapshot, slot: int
) -> tuple[FleetState, ClaimChanged]:
    """A new claim, its key frozen."""
    tag = free_tag(fleet.tag_free_ns, stamp_ns)
    assert tag is not None
    task = fleet.tasks.slot(slot)
    cost = int(snapshot.problem.costs_q[fleet.robot, slot])
    number = snapshot.problem.round & 0xFFFF
    claim_id = ClaimId(fleet.robot, slot, task.generation, tag, cost, number)
    basis = snapshot.basis(fleet.allocator.name)
    claim = OwnClaim(claim_id, stamp_ns, task.x_cm, task.y_cm, task.z_cm, basis, changed_ns=stamp_ns)
    votes = rule_f.without(fleet.votes, claim_id.task)
    return replace(fleet, own_claim=claim, votes=votes), claim.changed("requested", fleet.allocator.name)
