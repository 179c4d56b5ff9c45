"""What this robot last heard of each peer, with the delivery ledger. Concludes nothing about tasks.

Ages are on the receiver's monotonic clock. A row is replaced only by a newer one of the same sender.
"""

from __future__ import annotations

from dataclasses import dataclass

from hippomat_core.fleet.votes import ClaimId, claim_of
from hippomat_core.replaced import quickly_made
from hippomat_core.wire.frames import FLAG_LOCALIZED, Header, StateFrame

_SEQUENCES = 1 << 24


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """The last STATE of a robot that knew where it was."""

    stamp_ns: int  # when it was heard
    frame: StateFrame
    round: int


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class Peer:
    """The last STATE of one robot."""

    robot: int
    stamp_ns: int  # when it was heard
    alive_ns: int  # newest sign of life, relayed rows included
    boot: int
    sequence: int
    rssi_dbm: int
    frame: StateFrame
    agrees: bool  # its fleet digest is ours
    round: int  # of fleet time, in which it was sent
    live: bool = True  # False: unheard for T_dead, its claim has expired
    placed: Placed | None = None  # where it last knew that it is

    @property
    def claim(self) -> ClaimId | None:
        """Its claim, while it lives and belongs to our fleet."""
        return claim_of(self.robot, self.frame.claim) if self.live and self.agrees else None


def placed_now(known: Peer | None, stamp_ns: int, frame: StateFrame, number: int) -> Placed | None:
    """Where a robot last knew that it is, after a frame of round `number`. known: what was heard before."""
    if frame.flags & FLAG_LOCALIZED:
        return Placed(stamp_ns, frame, number)
    return None if known is None else known.placed


def is_newer(header: Header, known: Peer | None, stamp_ns: int, dead_ns: int) -> bool:
    """Whether a frame comes after the row we hold: a later boot, or a later sequence number of the same.

    An earlier boot counts only after T_dead of silence (a radio whose boot counter was erased).
    """
    if known is None or header.boot > known.boot:
        return True
    if header.boot < known.boot:
        return stamp_ns - known.stamp_ns > dead_ns
    return 0 < (header.sequence - known.sequence) % _SEQUENCES < _SEQUENCES // 2
