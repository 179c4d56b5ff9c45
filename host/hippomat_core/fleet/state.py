"""The fleet as one robot knows it: peers, task slots, votes, its own claim. A value; hearing makes a new one.

Decides what a heard frame changes. Sends nothing (rounds.py does) and knows no clock, map or motor: time
is the stamp of the event, task sites and the fleet digest are given once the map is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.port import Allocator
from hippomat_core.config import Config, FleetConfig
from hippomat_core.fleet import votes as rule_f
from hippomat_core.fleet.claims import TAGS, OwnClaim
from hippomat_core.fleet.peers import Peer, is_newer
from hippomat_core.fleet.tasks import Tasks, turned_effects
from hippomat_core.fleet.timing import Timing
from hippomat_core.fleet.votes import ClaimId, Votes, claim_of
from hippomat_core.messages import (
    ERROR,
    WARNING,
    AlarmCleared,
    AlarmRaised,
    Effect,
    PeerClaimSeen,
)
from hippomat_core.wire.frames import (
    WAITING,
    Header,
    RelayFrame,
    StateFrame,
    TasksFrame,
    TaskSlot,
)

OPERATOR = 255  # sender of orders
_NEVER = -(10**18)


@dataclass(frozen=True, slots=True, eq=False)
class FleetState:
    """Everything rule F and the allocation round remember. Start with `initial`, then `with_map`."""

    config: FleetConfig
    robot: int  # -1: observes only
    allocator: Allocator
    timing: Timing
    tasks: Tasks
    peers: tuple[Peer | None, ...]  # (N,) by id; our own place stays empty
    sites: NDArray[np.int16]  # (S, 3)
    digest: int | None = None  # fleet digest; None until the map is known
    started_ns: int | None = None
    silent_from_ns: int | None = None  # the silence after a boot counts from here
    in_step: bool = False  # the silence is over
    last_stamp_ns: int = _NEVER
    trusted_from_ns: int = _NEVER  # after a hold-up, rows heard before this may be old
    last_round_ns: int = _NEVER
    round: int = -1  # of the last round end
    votes: Votes = ()
    own_claim: OwnClaim | None = None
    tag_free_ns: tuple[int, ...] = (_NEVER,) * TAGS
    shunned: tuple[tuple[int, int, int], ...] = ()  # (slot, generation, until_ns): refused lately
    sent: StateFrame | None = None  # our last STATE: the row that others decide on
    sent_generations: NDArray[np.uint16] | None = None  # (M,) that its costs were for
    self_turned_ns: int = _NEVER
    tasks_cursor: int = 0
    passive: str = ""  # why we take no part for the rest of the run
    mismatched: frozenset[int] = frozenset()
    alarmed: frozenset[str] = frozenset()

    def round_due(self, stamp_ns: int) -> bool:
        """True when a new allocation round has begun since the last round end."""
        return self.round_number(stamp_ns) > self.round

    def round_number(self, stamp_ns: int) -> int:
        start_ns = stamp_ns if self.started_ns is None else self.started_ns
        return (stamp_ns - start_ns) // self.timing.round_ns

    def alive_peers(self, stamp_ns: int) -> list[Peer]:
        """Peers of our fleet heard of within T_dead."""
        dead_ns = self.timing.dead_ns
        return [p for p in self.peers if p is not None and p.agrees and stamp_ns - p.alive_ns <= dead_ns]


Heard = tuple[FleetState, list[Effect]]


def initial(config: Config, allocator: Allocator | None = None) -> FleetState:
    """Before anything was heard. allocator: needed where it has weights, else made by its name."""
    fleet = config.fleet
    return FleetState(
        config=fleet,
        robot=config.robot.id,
        allocator=allocator or make_allocator(fleet.allocator, None, fleet.size, fleet.task_slots),
        timing=Timing.of(fleet),
        tasks=Tasks.empty(fleet),
        peers=(None,) * fleet.size,
        sites=np.zeros((0, 3), np.int16),
    )


def started(fleet: FleetState, stamp_ns: int) -> FleetState:
    """Rounds count from here."""
    return replace(fleet, started_ns=stamp_ns, last_stamp_ns=stamp_ns)


def with_map(fleet: FleetState, stamp_ns: int, sites: NDArray[np.int16], digest: int) -> Heard:
    """The map is known: open the task slots and begin to listen. A new map drops claim, votes and tasks.

    Rows heard before count for nothing until their senders say the same digest.
    sites: (S, 3) from task_sites.  digest: from fleet_digest.  Raises ConfigError if sites are too few.
    """
    tasks = Tasks.start(fleet.config, sites)
    effects: list[Effect] = list(turned_effects(Tasks.empty(fleet.config), tasks, "start"))
    tag_free_ns = fleet.tag_free_ns
    peers = tuple(None if peer is None else replace(peer, agrees=False) for peer in fleet.peers)
    for before, after in zip(fleet.peers, peers, strict=True):
        effects += [] if after is None else _claim_news(before, after)
    if fleet.own_claim is not None:
        effects.insert(0, fleet.own_claim.changed("dropped", "map changed"))
        tag_free_ns = (stamp_ns + fleet.timing.tag_reuse_ns,) * TAGS
    fleet = replace(
        fleet,
        tasks=tasks,
        peers=peers,
        sites=sites,
        digest=digest,
        silent_from_ns=stamp_ns,
        in_step=False,
        votes=(),
        own_claim=None,
        tag_free_ns=tag_free_ns,
        shunned=(),
        sent=None,
        sent_generations=None,
    )
    return fleet, effects


def awake(fleet: FleetState, stamp_ns: int) -> FleetState:
    """Notices a hold-up: what is read right after it may have waited in a buffer; trusts a round later."""
    if fleet.started_ns is None:
        fleet = started(fleet, stamp_ns)
    held_up = stamp_ns - fleet.last_stamp_ns > fleet.timing.delay_ns
    trusted_ns = stamp_ns + fleet.timing.round_ns if held_up else fleet.trusted_from_ns
    return replace(fleet, last_stamp_ns=stamp_ns, trusted_from_ns=trusted_ns)


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
    peer = Peer(sender, stamp_ns, stamp_ns, header.boot, header.sequence, rssi_dbm, frame, agrees)
    fleet, effects = _digest_alarm(fleet, peer)
    effects += _claim_news(known, peer)
    peers = _put(fleet.peers, sender, peer)
    if not agrees:
        return replace(fleet, peers=peers), effects
    tasks = _learnt_from_claim(fleet, peer, stamp_ns)
    if tasks is not fleet.tasks:
        effects += turned_effects(fleet.tasks, tasks, "heard")
    digests_agree = frame.generations_digest == tasks.digest
    votes = rule_f.after_row(
        fleet.votes, sender, peer.claim, digests_agree, tasks.generations, stamp_ns, fleet.timing
    )
    return replace(fleet, peers=peers, tasks=tasks, votes=votes), effects


def heard_tasks(fleet: FleetState, stamp_ns: int, header: Header, frame: TasksFrame) -> Heard:
    """A TASKS frame arrived; taken from robots of our fleet, and orders from an operator."""
    fleet = awake(fleet, stamp_ns)
    peer = fleet.peers[header.sender] if header.sender < len(fleet.peers) else None
    ordered = header.sender == OPERATOR and not fleet.tasks.continuous
    if fleet.digest is None or not (ordered or (peer is not None and peer.agrees)):
        return fleet, []
    tasks = fleet.tasks.merged(frame, fleet.sites, stamp_ns)
    return replace(fleet, tasks=tasks), list(turned_effects(fleet.tasks, tasks, "heard"))


def heard_relay(fleet: FleetState, stamp_ns: int, header: Header, frame: RelayFrame) -> Heard:
    """A RELAY arrived: third robots' rows count as signs of life, of robots and of claims we vote for."""
    fleet = awake(fleet, stamp_ns)
    relay = fleet.peers[header.sender] if header.sender < len(fleet.peers) else None
    if relay is None or not relay.agrees:
        return fleet, []
    peers, votes = fleet.peers, fleet.votes
    for row in frame.rows:
        known = peers[row.robot] if row.robot < len(peers) else None
        if known is None:
            continue
        seen_ns = stamp_ns - (row.age + 1) * fleet.timing.round_ns  # ages are rounded down
        if known.live and seen_ns > known.alive_ns:
            peers = _put(peers, row.robot, replace(known, alive_ns=seen_ns))
        votes = rule_f.after_relay(votes, row, seen_ns)
    return replace(fleet, peers=peers, votes=votes), []


def _learnt_from_claim(fleet: FleetState, peer: Peer, stamp_ns: int) -> Tasks:
    """A claim proves its generation: no need to wait for TASKS."""
    claim = peer.frame.claim
    if peer.claim is None or claim.generation <= fleet.tasks.generations[claim.slot]:
        return fleet.tasks
    task = TaskSlot(claim.slot, claim.generation, WAITING, claim.x_cm, claim.y_cm, claim.z_cm)
    return fleet.tasks.advanced(task, fleet.sites, stamp_ns)


def _fits(fleet: FleetState, frame: StateFrame) -> bool:
    slots = len(fleet.tasks.generations)
    claimed = frame.claim.slot
    return (
        len(frame.costs) == slots
        and len(frame.task_states) == slots
        and len(frame.endorsed) == len(fleet.peers)
        and (claim_of(0, frame.claim) is None or claimed < slots)
    )


def _claim_news(known: Peer | None, peer: Peer) -> list[Effect]:
    before: ClaimId | None = known.claim if known is not None else None
    after = peer.claim
    news: list[Effect] = []
    if before is not None and before != after:
        news.append(PeerClaimSeen(peer.robot, before.slot, before.generation, "gone"))
    if after is not None and before != after:
        news.append(PeerClaimSeen(peer.robot, after.slot, after.generation, "requested"))
    was_confirmed = known is not None and before == after and known.frame.claim.confirmed
    if after is not None and peer.frame.claim.confirmed and not was_confirmed:
        news.append(PeerClaimSeen(peer.robot, after.slot, after.generation, "confirmed"))
    return news


def _digest_alarm(fleet: FleetState, peer: Peer) -> Heard:
    if fleet.digest is None or peer.agrees == (peer.robot not in fleet.mismatched):
        return fleet, []
    if peer.agrees:
        rest = fleet.mismatched - {peer.robot}
        cleared: list[Effect] = [] if rest else [AlarmCleared("peer_digest")]
        return replace(fleet, mismatched=rest), cleared
    text = (
        f"robot {peer.robot} has fleet digest {peer.frame.fleet_digest:08x}, robot {fleet.robot} has "
        f"{fleet.digest:08x}: not allocated with each other until map, [fleet], radius_m, speed_mps and "
        "inflation_radius are the same"
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


def _put(peers: tuple[Peer | None, ...], robot: int, peer: Peer) -> tuple[Peer | None, ...]:
    return (*peers[:robot], peer, *peers[robot + 1 :])
