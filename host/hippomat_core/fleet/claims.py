"""Our own claim: made, opposed, confirmed, dropped, served. Rule F, the claimant's part (see votes.py).

Decides whose claim is superior and why two robots wanted one task. Knows no clock, no path and no
allocator.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.fleet.peers import Peer
from hippomat_core.fleet.timing import Timing
from hippomat_core.fleet.votes import ClaimId
from hippomat_core.messages import ClaimChanged
from hippomat_core.wire.frames import AirClaim

TAGS = 3
COORDINATED = (
    "hungarian",
    "look_ahead",
    "greedy",
    "auction",
    "fixed_slot",
)  # never choose one task twice on one snapshot


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """What a request was decided on; kept to tell why another robot wanted the same task."""

    late: NDArray[np.bool_]  # (N,) no row of this round was held, heard directly or passed on
    available: NDArray[np.bool_]  # (N,)
    digests_agree: NDArray[np.bool_]  # (N,) the row's generations were ours, as far as it says
    allocator: str


@dataclass(frozen=True, slots=True, eq=False)
class OwnClaim:
    """A claim of this robot. Destination in the fleet frame, centimetres; frozen with the key."""

    id: ClaimId
    since_ns: int
    x_cm: int
    y_cm: int
    z_cm: int
    basis: Basis
    confirmed: bool = False
    changed_ns: int = 0  # when `confirmed` last changed
    turned: bool = False  # on_claim: we turned the slot for this claim
    serving_ns: int | None = None  # at the goal and confirmed without interruption since
    refused_ns: int | None = None  # unconfirmed since, although a majority of the roster was heard
    opposed: tuple[ClaimId, ...] = ()  # conflicts reported already, the last of each robot

    @property
    def destination_m(self) -> tuple[float, float, float]:
        return self.x_cm / 100, self.y_cm / 100, self.z_cm / 100

    def dwell_left_s(self, stamp_ns: int, dwell_s: float) -> float:
        """Of the service: the whole of dwell_s until it begins."""
        served_ns = 0 if self.serving_ns is None else stamp_ns - self.serving_ns
        return max(dwell_s - served_ns / 1e9, 0.0)

    def on_air(self, eta_s: float) -> AirClaim:
        claim, eta_ds = self.id, round(min(max(eta_s, 0.0), 6553.5) * 10)
        return AirClaim(
            claim.slot,
            claim.generation,
            claim.cost,
            claim.round,
            self.confirmed,
            claim.tag,
            self.x_cm,
            self.y_cm,
            self.z_cm,
            eta_ds,
        )

    def changed(self, what: str, cause: str) -> ClaimChanged:
        claim, (x_m, y_m, z_m) = self.id, self.destination_m
        return ClaimChanged(
            what, cause, claim.slot, claim.generation, claim.tag, claim.cost, claim.round, x_m, y_m, z_m
        )


def count_votes(
    claim: OwnClaim, peers: Iterable[Peer | None], stamp_ns: int, trusted_ns: int, lease_ns: int
) -> int:
    """Votes for our claim at this instant, our own included.

    A vote counts while its row is no older than the lease. Rows from before the claim quote an earlier one.
    """
    votes = 1
    for peer in peers:
        if peer is None or not peer.agrees or stamp_ns - peer.stamp_ns > lease_ns:
            continue
        after = peer.stamp_ns > claim.since_ns and peer.stamp_ns >= trusted_ns
        votes += after and int(peer.frame.endorsed[claim.id.robot]) == claim.id.tag
    return votes


def quorum(roster: int, alive: int, serve: bool) -> int:
    """Votes that confirm. alive: robots heard within T_dead, ourselves included.

    serve: where no majority of the roster can be heard, a majority of those that can (uniqueness is then only
    promised within each part of the fleet).
    """
    majority = roster // 2 + 1
    return alive // 2 + 1 if serve and alive < majority else majority


def serves_alone(partition: str, roster: int) -> bool:
    """The partition policy in use; auto: serve for rosters under 3, where a majority means everyone."""
    return partition == "serve" or (partition == "auto" and roster < 3)


def is_superior(own: OwnClaim, other: ClaimId, other_confirmed: bool) -> bool:
    """Whether ours stands: a confirmed claim over one that is not, then the smaller (cost, id)."""
    return (not own.confirmed, *own.id.key) < (not other_confirmed, *other.key)


def conflict_cause(own: OwnClaim, other: ClaimId) -> str:
    """Why both wanted the task: loss, staleness, tie or policy (the first that applies).

    loss: the other's row of that round had not arrived, nor been passed on. staleness: another row had not,
    or generations or instants of decision differed. tie: equal costs. policy: the allocator chose so on equal
    rows.
    """
    basis = own.basis
    if basis.late[other.robot]:
        return "loss"
    if (basis.available & basis.late).any() or not basis.digests_agree[other.robot]:
        return "staleness"
    if own.id.cost == other.cost:
        return "tie"
    return "staleness" if basis.allocator in COORDINATED else "policy"


def free_tag(tag_free_ns: tuple[int, ...], stamp_ns: int) -> int | None:
    """The tag unused for longest, if any may be used now; tags are 1..3."""
    free_ns, index = min((free_ns, index) for index, free_ns in enumerate(tag_free_ns))
    return index + 1 if free_ns <= stamp_ns else None


def tag_ended(tag_free_ns: tuple[int, ...], tag: int, stamp_ns: int, timing: Timing) -> tuple[int, ...]:
    """After the claim with that tag ended."""
    return tuple(
        stamp_ns + timing.tag_reuse_ns if index == tag - 1 else free_ns
        for index, free_ns in enumerate(tag_free_ns)
    )
