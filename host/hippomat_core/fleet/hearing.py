"""What a frame from the air changes in the fleet's state.

Decides what is believed of it: rows of robots that share our fleet digest, and orders of an operator. Sends
nothing; time is the stamp of the event.
"""

from __future__ import annotations

from typing import TypeVar

from hippomat_core.fleet import votes as rule_f
from hippomat_core.fleet.peers import Peer, is_newer, placed_now
from hippomat_core.fleet.rows import Relayed, Row, claim_news, newest_row
from hippomat_core.fleet.state import FleetState, Heard, awake
from hippomat_core.fleet.tasks import turned_effects
from hippomat_core.messages import ERROR, WARNING, AlarmCleared, AlarmRaised, Effect
from hippomat_core.replaced import replace
from hippomat_core.wire.frames import (
    NO_SLOT,
    OPERATOR,
    WAITING,
    AirClaim,
    Header,
    RelayFrame,
    RelayRow,
    StateFrame,
    TasksFrame,
    TaskSlot,
)

T = TypeVar("T")


def heard_state(fleet: FleetState, stamp_ns: int, header: Header, frame: StateFrame, rssi_dbm: int) -> Heard:
    """A STATE arrived."""
    fleet = awake(fleet, stamp_ns)
    sender = header.sender
    if sender == fleet.robot:
        return _duplicate_id(fleet)
    if sender >= len(fleet.peers):
        return _alarm_once(
            fleet,
            f"unknown_robot:{sender}",
            f"robot {sender} is on the air but the roster has ids 0..{len(fleet.peers) - 1}: "
            "raise [fleet] size on every robot, or give it another id or fleet",
        )
    known = fleet.peers[sender]
    if not is_newer(header, known, stamp_ns, fleet.timing.dead_ns):
        if known is not None and header.boot != known.boot:
            return _alarm_once(
                fleet,
                f"peer_duplicate:{sender}",
                f"two radios send as robot {sender} (boots {known.boot} and {header.boot}): "
                "give every robot its own id",
            )
        return fleet, []
    agrees = frame.fleet_digest == fleet.digest and _fits(fleet, frame)
    number = header.fleet_time_us // fleet.timing.round_us
    peer = Peer(
        sender,
        stamp_ns,
        stamp_ns,
        header.boot,
        header.sequence,
        rssi_dbm,
        frame,
        agrees,
        number,
        placed=placed_now(known, stamp_ns, frame, number),
    )
    before = fleet.row(sender)
    fleet, effects = _digest_alarm(fleet, peer)
    effects += claim_news(before, newest_row(peer, None))
    peers = _put(fleet.peers, sender, peer)
    relayed = _put(fleet.relayed, sender, None)  # what was passed on before is older
    if not agrees:
        return replace(fleet, peers=peers, relayed=relayed), effects
    fleet, learnt = _learnt_from_claim(fleet, frame.claim, stamp_ns)
    tasks = fleet.tasks
    digests_agree = frame.generations_digest == tasks.digest
    votes = rule_f.after_row(
        fleet.votes, sender, peer.claim, digests_agree, tasks.generations, stamp_ns, fleet.timing
    )
    return replace(fleet, peers=peers, relayed=relayed, votes=votes), effects + learnt


def heard_tasks(fleet: FleetState, stamp_ns: int, header: Header, frame: TasksFrame) -> Heard:
    """A TASKS frame arrived; taken from robots of our fleet, and orders from an operator."""
    fleet = awake(fleet, stamp_ns)
    peer = fleet.peers[header.sender] if header.sender < len(fleet.peers) else None
    ordered = header.sender == OPERATOR and not fleet.tasks.continuous
    if fleet.digest is None or not (ordered or (peer is not None and peer.agrees)):
        return fleet, []
    tasks = fleet.tasks.merged(frame, fleet.sites, stamp_ns)
    return replace(fleet, tasks=tasks), list(turned_effects(fleet.tasks, tasks, "heard"))


def heard_relay(fleet: FleetState, stamp_ns: int, header: Header, frame: RelayFrame, rssi_dbm: int) -> Heard:
    """A RELAY arrived: rows of third robots, taken from robots of our fleet.

    They are signs of life of those robots and of the claims we vote for, and count as rows where they are
    newer than what is held. They release no vote, and give none: they carry none.
    """
    fleet = awake(fleet, stamp_ns)
    relay = fleet.peers[header.sender] if header.sender < len(fleet.peers) else None
    if relay is None or not relay.agrees or frame.n != len(fleet.peers):
        return fleet, []
    effects: list[Effect] = []
    for row in frame.rows:
        if row.robot != fleet.robot and len(row.costs) == len(fleet.tasks.generations):
            fleet, more = _heard_row(fleet, _relayed(fleet, stamp_ns, header, row, rssi_dbm))
            effects += more
    return fleet, effects


def _relayed(fleet: FleetState, stamp_ns: int, header: Header, row: RelayRow, rssi_dbm: int) -> Relayed:
    round_us = fleet.timing.round_us
    number = header.fleet_time_us // round_us - row.age
    since_ns = stamp_ns - 1000 * (header.fleet_time_us - number * round_us)
    return Relayed(row, number, since_ns, stamp_ns, rssi_dbm, header)


def _heard_row(fleet: FleetState, relayed: Relayed) -> Heard:
    robot, since_ns = relayed.row.robot, relayed.since_ns
    known, before = fleet.peers[robot], fleet.row(robot)
    if known is not None and known.live and since_ns > known.alive_ns:
        fleet = replace(fleet, peers=_put(fleet.peers, robot, replace(known, alive_ns=since_ns)))
    fleet = replace(fleet, votes=rule_f.after_relay(fleet.votes, relayed.row, since_ns))
    if before is not None and not _is_newer_row(fleet, relayed, before):
        return fleet, []
    fleet = replace(fleet, relayed=_put(fleet.relayed, robot, relayed))
    effects = claim_news(before, fleet.row(robot))
    fleet, learnt = _learnt_from_claim(fleet, relayed.row, relayed.read_ns)
    return fleet, effects + learnt


def _is_newer_row(fleet: FleetState, relayed: Relayed, held: Row) -> bool:
    """By the rounds they were sent in; by our clock where fleet time began anew in between."""
    return relayed.round > held.round or relayed.since_ns > held.read_ns + fleet.timing.hold_ns


def _learnt_from_claim(fleet: FleetState, claim: AirClaim | RelayRow, stamp_ns: int) -> Heard:
    """A claim proves its generation, whoever passed it on: no need to wait for TASKS."""
    if claim.slot == NO_SLOT or claim.generation <= fleet.tasks.generations[claim.slot]:
        return fleet, []
    task = TaskSlot(claim.slot, claim.generation, WAITING, claim.x_cm, claim.y_cm, claim.z_cm)
    tasks = fleet.tasks.advanced(task, fleet.sites, stamp_ns)
    return replace(fleet, tasks=tasks), list(turned_effects(fleet.tasks, tasks, "heard"))


def _fits(fleet: FleetState, frame: StateFrame) -> bool:
    slots = len(fleet.tasks.generations)
    claimed = frame.claim.slot
    return (
        len(frame.costs) == slots
        and len(frame.task_states) == slots
        and len(frame.endorsed) == len(fleet.peers)
        and (claimed == NO_SLOT or claimed < slots)
    )


def _digest_alarm(fleet: FleetState, peer: Peer) -> Heard:
    if fleet.digest is None or peer.agrees == (peer.robot not in fleet.mismatched):
        return fleet, []
    if peer.agrees:
        rest = fleet.mismatched - {peer.robot}
        cleared: list[Effect] = [] if rest else [AlarmCleared("peer_digest")]
        return replace(fleet, mismatched=rest), cleared
    text = (
        f"robot {peer.robot} has fleet digest {peer.frame.fleet_digest:08x}, robot {fleet.robot} has "
        f"{fleet.digest:08x}: not allocated with each other until map, [fleet], the policy's weights, "
        "radius_m, speed_mps and inflation_radius are the same"
    )
    alarm = AlarmRaised(WARNING, "peer_digest", text)
    return replace(fleet, mismatched=fleet.mismatched | {peer.robot}), [alarm]


def _duplicate_id(fleet: FleetState) -> Heard:
    if fleet.passive:
        return fleet, []
    text = (
        f"another radio sends as robot {fleet.robot}: this robot takes no part until it is restarted; "
        "give every robot its own id"
    )
    return replace(fleet, passive="duplicate id"), [AlarmRaised(ERROR, "duplicate_id", text)]


def _alarm_once(fleet: FleetState, key: str, text: str) -> Heard:
    if key in fleet.alarmed:
        return fleet, []
    alarm = AlarmRaised(WARNING, key.partition(":")[0], text)
    return replace(fleet, alarmed=fleet.alarmed | {key}), [alarm]


def _put(places: tuple[T, ...], robot: int, value: T) -> tuple[T, ...]:
    return (*places[:robot], value, *places[robot + 1 :])
