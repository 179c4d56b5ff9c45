"""Rule F, the voter's part: whose claim on a task this robot endorses, and when it may endorse another.

Decides on claims that were heard; knows no costs of its own, no allocator and no path. Times are the
robot's own.

**Claims are confirmed by a majority of votes with a lease.** A claimant counts its own vote and those
heard within T_lease (3 rounds); more than half of the roster confirms. Each robot votes for one claim per
(slot, generation) at a time, the first heard, within a round the smallest (cost, id), and quotes it in
every STATE by the claim's tag.

*Why two claims on one task are never confirmed at one instant T.* Two majorities of one roster share a
voter v. Both counts hold a vote that v handed to its radio after T - T_lease - delay, so v changed its mind
within that time (the delay is in timing.py: a STATE waits for its slot, and hosts are held up). It may do so
only

- when the owner's own newer row lacks the claim: then the owner no longer counted it at T. Another robot's
  word for it is not enough: a relayed row does not say which generations its owner knew (see below);
- after T_dead without any row that carries the claim: v then leaves the task fallow for T_lease + delay,
  after which its last vote counts nowhere (without the fallow time it would still count at an owner that
  lives, but that v cannot hear: the link between two radios may work in one direction only);
- after a reboot: v is then silent for T_dead, which is longer than T_lease + delay.

*Why tags.* A vote that only named the claimant would count for its next claim as well. A STATE has 2 bits
for it, so a claimant reuses a tag only T_dead + T_lease + delay after the claim that had it ended. By then
every voter has stopped quoting the old claim: T_dead is counted per claim, from the last row that carried
that very claim (relayed ones included), never from the last sign of life of its owner. A relayed row counts
from the begin of the round in which its owner sent it, so never later than the owner's own frame would. The
last row with the claim left the owner's host before the claim ended and is read within the delay; the last
vote for it is handed over within T_dead of that, and read within the delay again. As the delay is not longer
than T_lease, that is before the new claim begins, and votes read before their claim began do not count. A
voter that was held up, and so may be reading old rows, quotes nothing for a round.

*Claims heard through others only.* Such a claim earns a vote like any other: whoever passes it on, the voter
has one vote per task, and it is bound by it until T_dead after the last row that carries the claim. The votes
in a row are not passed on, so that a claimant counts only voters that it hears itself.

*Why a completed task is not endorsed again.* A robot that completes a task turns the slot to its next
generation, and nobody votes for a generation older than the newest known. But a row says only by its
digest which generations its sender knows, and the TASKS frame may be lost: a row without the claim, from a
robot whose digest differs, may mean "completed". Such a vote becomes DOUBTFUL: no longer quoted, and no
other vote on that task until the digests agree, at most for T_dead.

*Claims in service* (turnover on_claim). The slot turns when the claim is confirmed, while the claim is
still on its way. Votes for it stay. If its owner is unheard for T_dead they become DORMANT, and the
owner's row revives them, but never a vote for another claim: the voter remembers that it voted for no
other on that task since.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hippomat_core.fleet.timing import Timing
from hippomat_core.replaced import quickly_made, replace
from hippomat_core.wire.frames import NO_SLOT, AirClaim, RelayRow

# phases of a vote
GIVEN = "given"  # quoted in our STATE
FALLOW = "fallow"  # released unheard; no other vote on the task until `until_ns`
DOUBTFUL = "doubtful"  # the owner let go, perhaps because it completed the task
DORMANT = "dormant"  # bars nothing; the same claim may revive it
_BARRING = (GIVEN, FALLOW, DOUBTFUL)

FORGET_NS = 600 * 10**9  # a dormant vote is dropped after this
UNKNOWN_ROUND = -1  # of a claim that was only passed on: RELAY does not carry it


@quickly_made
@dataclass(frozen=True, slots=True)
class ClaimId:
    """What a robot froze when it claimed; names the claim among all that are alive.

    Its tag alone tells a robot's claims apart while a vote for an earlier one may still count, so that claims
    are equal without their round.
    """

    robot: int
    slot: int
    generation: int
    tag: int
    cost: int
    round: int = field(compare=False)  # UNKNOWN_ROUND, or 0 .. 65535

    @property
    def key(self) -> tuple[int, int]:
        """The smaller one wins."""
        return self.cost, self.robot

    @property
    def task(self) -> tuple[int, int]:
        return self.slot, self.generation


def claim_of(robot: int, claim: AirClaim | RelayRow) -> ClaimId | None:
    """The claim in a robot's row, if it carries one."""
    if claim.slot == NO_SLOT:
        return None
    number = claim.round if isinstance(claim, AirClaim) else UNKNOWN_ROUND
    return ClaimId(robot, claim.slot, claim.generation, claim.tag, claim.cost, number)


@dataclass(frozen=True, slots=True)
class Vote:
    """This robot's word on one task, (slot, generation)."""

    claim: ClaimId
    phase: str
    seen_ns: int  # when a row that carries the claim was last heard, or relayed, less its age
    until_ns: int = 0  # FALLOW, DOUBTFUL: the end


Votes = tuple[Vote, ...]  # at most one per task
Fresh = Iterable[tuple[ClaimId, int]]  # claims and when rows that carry them were heard, less their age


def after_row(
    votes: Votes,
    robot: int,
    claim: ClaimId | None,
    digests_agree: bool,
    newest: NDArray[np.uint16],
    stamp_ns: int,
    timing: Timing,
) -> Votes:
    """Votes after a newer row of `robot`. newest: (M,) generations known here."""
    kept = []
    for vote in votes:
        if vote.claim.robot != robot:
            kept.append(vote)
        elif claim is not None and _is_same(vote, claim):
            doubtful = vote.phase == DOUBTFUL
            kept.append(
                replace(vote, claim=claim)
                if doubtful
                else replace(vote, claim=claim, phase=GIVEN, seen_ns=stamp_ns)
            )
        elif vote.claim.generation >= newest[vote.claim.slot] and not digests_agree:
            until_ns = vote.until_ns if vote.phase == DOUBTFUL else stamp_ns + timing.dead_ns
            kept.append(replace(vote, phase=DOUBTFUL, until_ns=until_ns))
    return tuple(kept)


def _is_same(vote: Vote, claim: ClaimId) -> bool:
    """Whether the owner's row carries the claim voted for.

    A vote that outlived its owner's silence is revived only where the round is the same too, as far as it is
    known: by then the tag may name a later claim.
    """
    numbers = {vote.claim.round, claim.round} - {UNKNOWN_ROUND}
    return vote.claim == claim and (vote.phase != DORMANT or len(numbers) == 1)


def after_relay(votes: Votes, row: RelayRow, seen_ns: int) -> Votes:
    """Votes after a third robot passed on a row; seen_ns: now less the row's age. Releases nothing."""
    quoted = claim_of(row.robot, row)
    return tuple(
        replace(vote, seen_ns=seen_ns)
        if vote.phase == GIVEN and vote.seen_ns < seen_ns and vote.claim == quoted
        else vote
        for vote in votes
    )


def aged(votes: Votes, newest: NDArray[np.uint16], keeps_old: bool, stamp_ns: int, timing: Timing) -> Votes:
    """Votes at the end of a round. keeps_old: claims stay in service on older generations (on_claim)."""
    kept = []
    for vote in votes:
        old = vote.claim.generation < newest[vote.claim.slot]
        if old and (not keeps_old or vote.phase == DOUBTFUL):
            continue
        if vote.phase == GIVEN and stamp_ns - vote.seen_ns > timing.dead_ns:
            vote = replace(vote, phase=FALLOW, until_ns=stamp_ns + timing.fallow_ns)
        if vote.phase == FALLOW and (old or stamp_ns >= vote.until_ns):
            vote = replace(vote, phase=DORMANT)
        if vote.phase == DOUBTFUL and stamp_ns >= vote.until_ns:
            continue
        if vote.phase == DORMANT and stamp_ns - vote.seen_ns > FORGET_NS:
            continue
        kept.append(vote)
    return tuple(kept)


def cast(votes: Votes, fresh: Fresh, newest: NDArray[np.uint16], own: ClaimId | None) -> Votes:
    """Votes with new ones for claims heard in this round, smallest key first; never where we vote already."""
    barred = {vote.claim.task for vote in votes if vote.phase in _BARRING}
    if own is not None:
        barred.add(own.task)
    for claim, seen_ns in sorted(fresh, key=lambda heard: heard[0].key):
        if claim.task in barred or claim.generation != newest[claim.slot]:
            continue
        barred.add(claim.task)
        votes = tuple(vote for vote in votes if vote.claim.task != claim.task)
        votes = (*votes, Vote(claim, GIVEN, seen_ns))
    return votes


def bars(votes: Votes, task: tuple[int, int]) -> bool:
    """True where we may not claim ourselves: a vote for another still binds us."""
    return any(vote.claim.task == task and vote.phase in _BARRING for vote in votes)


def without(votes: Votes, task: tuple[int, int]) -> Votes:
    """Without the memory of a task: we claim it ourselves."""
    return tuple(vote for vote in votes if vote.claim.task != task)


def quoted_tags(votes: Votes, own: ClaimId | None, robots: int) -> NDArray[np.uint8]:
    """(N,) tags for STATE: of every robot's claim that we endorse, our own included; 0 = none."""
    tags = np.zeros(robots, np.uint8)
    for vote in votes:
        if vote.phase == GIVEN:
            tags[vote.claim.robot] = vote.claim.tag
    if own is not None:
        tags[own.robot] = own.tag
    tags.flags.writeable = False
    return tags
