"""What this robot last heard of each peer, with the delivery ledger. Concludes nothing about tasks.

Ages are on the receiver's monotonic clock. A row is replaced only by a newer one of the same sender.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.fleet.votes import ClaimId, claim_of
from hippomat_core.wire.frames import Header, StateFrame

_SEQUENCES = 1 << 24


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
    live: bool = True  # False: unheard for T_dead, its claim has expired

    @property
    def claim(self) -> ClaimId | None:
        """Its claim, while it lives and belongs to our fleet."""
        return claim_of(self.robot, self.frame.claim) if self.live and self.agrees else None


def is_newer(header: Header, known: Peer | None, stamp_ns: int, dead_ns: int) -> bool:
    """Whether a frame comes after the row we hold: a later boot, or a later sequence number of the same.

    An earlier boot counts only after T_dead of silence (a radio whose boot counter was erased).
    """
    if known is None or header.boot > known.boot:
        return True
    if header.boot < known.boot:
        return stamp_ns - known.stamp_ns > dead_ns
    return 0 < (header.sequence - known.sequence) % _SEQUENCES < _SEQUENCES // 2


@dataclass(frozen=True, slots=True, eq=False)
class PeerBody:
    """A peer as an obstacle, from its last row (fleet frame). Robots do not vanish: judge by the age."""

    robot: int
    age_s: float
    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    speed_mps: float
    status: int
    intent: NDArray[np.int32]  # (K, 3) map cells ix, iy, iz: the first is where it is, then its next ones
    claim: ClaimId | None
    destination_m: tuple[float, float, float] | None
    eta_s: float


def body_of(peer: Peer, stamp_ns: int) -> PeerBody:
    frame, claim = peer.frame, peer.claim
    return PeerBody(
        robot=peer.robot,
        age_s=(stamp_ns - peer.stamp_ns) / 1e9,
        x_m=frame.x_cm / 100,
        y_m=frame.y_cm / 100,
        z_m=frame.z_cm / 100,
        yaw_rad=frame.yaw_256 * math.tau / 256,
        speed_mps=frame.speed_2cmps * 0.02,
        status=frame.status,
        intent=intent_cells(frame),
        claim=claim,
        destination_m=None
        if claim is None
        else (frame.claim.x_cm / 100, frame.claim.y_cm / 100, frame.claim.z_cm / 100),
        eta_s=frame.claim.eta_ds / 10,
    )


def intent_cells(frame: StateFrame) -> NDArray[np.int32]:
    """(1 + steps, 3) cells of a broadcast intent."""
    start = np.array([[frame.intent_ix, frame.intent_iy, frame.intent_iz]], np.int32)
    steps = frame.intent_steps.astype(np.int32)
    moves = np.stack([steps % 3 - 1, steps // 3 % 3 - 1, steps // 9 - 1], axis=1).reshape(-1, 3)
    return np.concatenate([start, start + np.cumsum(moves, axis=0, dtype=np.int32)])
