"""Whether the time until a claim is served comes down as it should: what a robot that is held up may promise.

Expects of a hold-up that it lasts as long again as it has lasted already. Knows seconds, not what is in the
way.
"""

from __future__ import annotations

from dataclasses import dataclass

from hippomat_core.fleet.claims import OwnClaim
from hippomat_core.fleet.votes import ClaimId

USUAL_S = 2.0  # without coming nearer: half a turn in place, a place in a queue


@dataclass(frozen=True, slots=True)
class Progress:
    """The least time until it is free that a robot has had with its claim, and when it came to that."""

    claim: ClaimId
    least_s: float  # inf: there was no way yet
    since_ns: int


def observed(last: Progress | None, claim: OwnClaim, free_s: float, stamp_ns: int) -> Progress:
    """After a round in which it takes `free_s` more until the claim is served."""
    if last is not None and last.claim == claim.id and free_s >= last.least_s:
        return last
    return Progress(claim.id, free_s, stamp_ns)


def held_up_s(progress: Progress | None, claim: OwnClaim, stamp_ns: int) -> float:
    """For how long the claim has come no nearer than ever before, but for USUAL_S; 0: it does come nearer."""
    if progress is None or progress.claim != claim.id:
        return 0.0
    return max((stamp_ns - progress.since_ns) / 1e9 - USUAL_S, 0.0)
