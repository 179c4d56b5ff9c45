"""The newest that is known of each robot: the row heard from itself, or a newer one that another passed on.

A relayed row says whether its robot is free, what tasks cost it and what it claims; it has no pose, no votes
and no digest of the generations, so whoever needs those looks at the peer itself. Which of two is newer is
decided where they are heard.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hippomat_core.fleet.peers import Peer
from hippomat_core.fleet.votes import ClaimId, claim_of
from hippomat_core.messages import Effect, PeerClaimSeen
from hippomat_core.replaced import quickly_made
from hippomat_core.wire.frames import (
    FLAG_LOCALIZED,
    FLAG_STOPPED,
    IDLE,
    NO_SLOT,
    Header,
    RelayRow,
    StateFrame,
)

HEARD_DIRECTLY = 255  # Row.via


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class Relayed:
    """A row that another robot passed on, newer than the one its owner told us."""

    row: RelayRow
    round: int  # of fleet time, in which its owner sent it
    since_ns: int  # when that round began, by our clock: its age is never told too small
    read_ns: int
    rssi_dbm: int  # of the RELAY
    header: Header  # of the RELAY


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """What the fleet's state makes of one robot in a round."""

    robot: int
    claim: ClaimId | None  # while the robot lives and belongs to our fleet
    confirmed: bool  # the claim
    slot: int  # that the row claims, whatever became of its robot
    available: bool  # idle, without a claim, localized and not stopped
    busy: bool  # the same once its claim is done
    costs: NDArray[np.uint8]  # (M,)
    agrees: bool  # its fleet digest is ours
    round: int  # of fleet time, in which its owner sent it
    stamp_ns: int  # its age counts from here
    read_ns: int
    alive_ns: int  # newest sign of life of the robot
    generations_digest: int | None  # None: the row does not say
    via: int  # who passed it on; HEARD_DIRECTLY
    boot: int  # this and the two below: of the frame that brought it
    sequence: int
    rssi_dbm: int


@lru_cache(maxsize=1024)  # values, the same ones asked for ten times a round; hashed by identity
def newest_row(peer: Peer | None, relayed: Relayed | None) -> Row | None:
    """relayed: as FleetState keeps it, so newer than the peer's own row."""
    if relayed is not None:
        return _of_relayed(peer, relayed)
    return None if peer is None else _of_peer(peer)


@lru_cache(maxsize=64)
def newest_rows(peers: tuple[Peer | None, ...], relayed: tuple[Relayed | None, ...]) -> tuple[Row, ...]:
    """The rows of all robots of which anything is known, in id order."""
    rows = (newest_row(peer, passed_on) for peer, passed_on in zip(peers, relayed, strict=True))
    return tuple(row for row in rows if row is not None)


def own_row(robot: int, frame: StateFrame, number: int, stamp_ns: int) -> Row:
    """What we said of ourselves in round `number`, given to our radio at `stamp_ns`."""
    peer = Peer(robot, stamp_ns, stamp_ns, 0, 0, 0, frame, True, number)
    return _of_peer(peer)


def claim_news(before: Row | None, after: Row | None) -> list[Effect]:
    """What a newer row of a robot tells of its claim."""
    old = before.claim if before is not None else None
    new = after.claim if after is not None else None
    news: list[Effect] = []
    if old is not None and old != new:
        news.append(PeerClaimSeen(old.robot, old.slot, old.generation, "gone"))
    if new is not None and old != new:
        news.append(PeerClaimSeen(new.robot, new.slot, new.generation, "requested"))
    was_confirmed = before is not None and old == new and before.confirmed
    if new is not None and after is not None and after.confirmed and not was_confirmed:
        news.append(PeerClaimSeen(new.robot, new.slot, new.generation, "confirmed"))
    return news


def is_available(status: int, localized: bool, stopped: bool, slot: int) -> bool:
    """Whether a row's robot can be given a task."""
    return localized and not stopped and status == IDLE and slot == NO_SLOT


def is_busy(localized: bool, stopped: bool, slot: int) -> bool:
    """Whether a row's robot holds a claim that it can bring to an end."""
    return localized and not stopped and slot != NO_SLOT


def _of_peer(peer: Peer) -> Row:
    frame = peer.frame
    localized, stopped = bool(frame.flags & FLAG_LOCALIZED), bool(frame.flags & FLAG_STOPPED)
    return Row(
        robot=peer.robot,
        claim=peer.claim,
        confirmed=frame.claim.confirmed,
        slot=frame.claim.slot,
        available=is_available(frame.status, localized, stopped, frame.claim.slot),
        busy=is_busy(localized, stopped, frame.claim.slot),
        costs=frame.costs,
        agrees=peer.agrees,
        round=peer.round,
        stamp_ns=peer.stamp_ns,
        read_ns=peer.stamp_ns,
        alive_ns=peer.alive_ns,
        generations_digest=frame.generations_digest,
        via=HEARD_DIRECTLY,
        boot=peer.boot,
        sequence=peer.sequence,
        rssi_dbm=peer.rssi_dbm,
    )


def _of_relayed(peer: Peer | None, relayed: Relayed) -> Row:
    row, header = relayed.row, relayed.header
    return Row(
        robot=row.robot,
        claim=claim_of(row.robot, row),
        confirmed=row.confirmed,
        slot=row.slot,
        available=is_available(row.status, row.localized, row.stopped, row.slot),
        busy=is_busy(row.localized, row.stopped, row.slot),
        costs=row.costs,
        agrees=True,
        round=relayed.round,
        stamp_ns=relayed.since_ns,
        read_ns=relayed.read_ns,
        alive_ns=relayed.since_ns if peer is None else max(relayed.since_ns, peer.alive_ns),
        generations_digest=None,
        via=header.sender,
        boot=header.boot,
        sequence=header.sequence,
        rssi_dbm=relayed.rssi_dbm,
    )
