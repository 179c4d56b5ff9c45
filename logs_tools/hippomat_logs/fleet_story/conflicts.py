"""Every conflict of a fleet: two claims of two robots on one task that were alive at once.

From the claims themselves, in rounds; what robots noticed of it (ConflictSeen) is compared, not believed.
A request is a claim that is not confirmed yet, so the kind says how far the two had come. Two that are
confirmed at once break what rule F promises (fleet/votes.py).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

from hippomat_core.fleet.claims import serves_alone
from hippomat_logs import definitions
from hippomat_logs.definitions import Task, cost_s
from hippomat_logs.fleet_story.causes import cause_of
from hippomat_logs.fleet_story.rerun import Rerun
from hippomat_logs.fleet_story.story import FleetStory, fleet_story
from hippomat_logs.fleet_story.values import Claim, Moment
from hippomat_logs.reader import Run

Pair: TypeAlias = tuple[Claim, Claim]  # in the order of (round of the request, robot)
DOUBLE_REQUEST = "double request"  # neither was confirmed when the second robot asked
DOUBLE_CLAIM = "double claim"  # one was confirmed already
DOUBLY_CONFIRMED = "both confirmed"  # at one instant: the promise is broken
KINDS = (DOUBLE_REQUEST, DOUBLE_CLAIM, DOUBLY_CONFIRMED)


@dataclass(frozen=True, slots=True)
class GivenUp:
    """A claim that its robot let go for another robot's: how long it was held and what was driven for it."""

    robot: int
    requested: int  # round
    held_s: float
    driven_m: float


@dataclass(frozen=True, slots=True)
class Conflict:
    """robots, requested, costs_s: of the earlier request first, the smaller id in the same round."""

    slot: int
    generation: int
    kind: str
    robots: tuple[int, int]
    requested: tuple[int, int]  # rounds
    codes: tuple[int, int]  # frozen costs
    costs_s: tuple[float, float]  # nan where c_max is unknown
    begun: Moment  # the second request, on its robot's log time
    cause: str
    evidence: tuple[str, ...]
    guesses: tuple[tuple[int, str], ...]  # (robot, cause) as the robots themselves recorded it
    kept_by: int | None  # None: neither, or both claims are alive where the logs end
    ending: str
    rounds: int  # that both lived
    given_up: tuple[GivenUp, ...]  # what it cost

    @property
    def task(self) -> Task:
        return self.slot, self.generation

    @property
    def misjudged(self) -> bool:
        """A robot recorded another cause."""
        return any(cause != self.cause for _, cause in self.guesses)


@dataclass(frozen=True, slots=True)
class OneSided:
    """A conflict that a robot noticed with one whose log is missing."""

    slot: int
    generation: int
    robot: int
    other: int
    at: Moment
    kept: bool
    guess: str


def conflicts_of(runs: Sequence[Run]) -> list[Conflict]:
    """All conflicts in the logs of one fleet run, in the order of their rounds."""
    return conflicts_in(fleet_story(runs))


def conflicts_in(story: FleetStory) -> list[Conflict]:
    rerun, found = Rerun(story), []
    pairs = pairs_alive_at_once(story.claims)
    for earlier, later in [*pairs, *_seen_by_robots_alone(story, pairs)]:
        found.append(_conflict(story, rerun, earlier, later))
    return sorted(found, key=lambda one: (max(one.requested), one.task, one.robots))


def pairs_alive_at_once(claims: Iterable[Claim]) -> list[Pair]:
    """Claims of different robots on one task that share a round end, in the order of their requests."""
    by_task: dict[Task, list[Claim]] = {}
    for claim in claims:
        by_task.setdefault(claim.task, []).append(claim)
    pairs = []
    for several in by_task.values():
        several.sort(key=_order)
        for earlier, later in combinations(several, 2):
            if earlier.robot != later.robot and earlier.alive_in(later.requested.round):
                pairs.append((earlier, later))
    return pairs


def _seen_by_robots_alone(story: FleetStory, known: Sequence[Pair]) -> list[Pair]:
    """Conflicts that a robot noticed, where one of the two counted rounds alone and so counted others."""
    told = {(id(earlier), id(later)) for earlier, later in known}
    found = []
    for story_of in story.robots.values():
        for at, seen in story_of.conflicts:
            task = seen.slot, seen.generation
            mine = _last_before(story_of.claims, task, at)
            others = story.robots.get(seen.other)
            theirs = None if others is None else _nearest(others.claims, task, at)
            if mine is None or theirs is None or (_is_common(mine) and _is_common(theirs)):
                continue
            earlier, later = sorted((mine, theirs), key=_order)
            if (id(earlier), id(later)) not in told:
                told.add((id(earlier), id(later)))
                found.append((earlier, later))
    return found


def _order(claim: Claim) -> tuple[int, int]:
    return claim.requested.round, claim.robot


def _is_common(claim: Claim) -> bool:
    return claim.decision is not None and claim.decision.common


def _last_before(claims: Iterable[Claim], task: Task, at: Moment) -> Claim | None:
    on_task = [claim for claim in claims if claim.task == task and claim.requested.record < at.record]
    return on_task[-1] if on_task else None


def _nearest(claims: Iterable[Claim], task: Task, at: Moment) -> Claim | None:
    on_task = [claim for claim in claims if claim.task == task]
    return min(on_task, key=lambda claim: abs(claim.requested.round - at.round), default=None)


def one_sided(story: FleetStory) -> list[OneSided]:
    """Conflicts with robots whose log is missing, as far as the others noticed them."""
    return [
        OneSided(seen.slot, seen.generation, told.robot, seen.other, at, seen.kept, seen.cause)
        for told in story.robots.values()
        for at, seen in told.conflicts
        if seen.other not in story.robots
    ]


def conflict_free_rate(claims: Iterable[Claim]) -> float:
    """CF1 of the paper, of these claims."""
    return definitions.conflict_free_rate((claim.robot, claim.task) for claim in claims)


def price(conflicts: Iterable[Conflict]) -> tuple[float, float]:
    """Seconds held and metres driven for claims that were given up, each once, however many opposed it."""
    claims = {claim for one in conflicts for claim in one.given_up}
    return sum(claim.held_s for claim in claims), sum(claim.driven_m for claim in claims)


def promise_holds(story: FleetStory) -> bool:
    """Whether this fleet was promised that no task has two confirmed holders (partition `serve` is not)."""
    return not any(serves_alone(story.config(robot).fleet.partition, story.size) for robot in story.robots)


def _conflict(story: FleetStory, rerun: Rerun, earlier: Claim, later: Claim) -> Conflict:
    cause = cause_of(story, rerun, earlier, later)
    kept_by, ending = _ending(earlier, later)
    losers = [claim for claim in (earlier, later) if claim.robot != kept_by and claim.ended is not None]
    return Conflict(
        slot=earlier.task[0],
        generation=earlier.task[1],
        kind=_kind(earlier, later),
        robots=(earlier.robot, later.robot),
        requested=(earlier.requested.round, later.requested.round),
        codes=(earlier.code, later.code),
        costs_s=(cost_s(earlier.code, story.c_max_s), cost_s(later.code, story.c_max_s)),
        begun=later.requested,
        cause=cause.name,
        evidence=cause.evidence,
        guesses=tuple(_guesses(story, earlier, later)),
        kept_by=kept_by,
        ending=ending,
        rounds=_rounds_together(story, earlier, later),
        given_up=tuple(_given_up(claim) for claim in losers),
    )


def _kind(earlier: Claim, later: Claim) -> str:
    if _both_confirmed(earlier, later):
        return DOUBLY_CONFIRMED
    return DOUBLE_CLAIM if earlier.confirmed_in(later.requested.round) else DOUBLE_REQUEST


def _both_confirmed(one: Claim, two: Claim) -> bool:
    """At the end of one round. Half-open spans, so a claim that took over from another does not count."""
    endless = 1 << 62
    for begun, end in one.confirmed_rounds():
        for other_begun, other_end in two.confirmed_rounds():
            if max(begun, other_begun) < min(end or endless, other_end or endless):
                return True
    return False


def _ending(earlier: Claim, later: Claim) -> tuple[int | None, str]:
    """Who kept the task, and how the other's claim ended."""
    over = sorted(
        (claim for claim in (earlier, later) if claim.ended is not None),
        key=lambda claim: claim.ended.round if claim.ended else 0,
    )
    if not over:
        return None, "both claims are alive where the logs end"
    first = over[0]
    assert first.ended is not None
    text = f"robot {first.robot} {first.end} it in round {first.ended.round} ({first.why})"
    if len(over) == 2 and over[1].ended is not None and over[1].ended.round == first.ended.round:
        second = over[1]
        text = f"{text}, robot {second.robot} {second.end} it in the same round ({second.why})"
        kept = [claim.robot for claim in over if claim.end == "completed"]
        return (kept[0] if len(kept) == 1 else None), text
    other = later if first is earlier else earlier
    return (first.robot if first.end == "completed" else other.robot), text


def _rounds_together(story: FleetStory, earlier: Claim, later: Claim) -> int:
    ends = [
        claim.ended.round if claim.ended is not None else story.robots[claim.robot].rounds[1] + 1
        for claim in (earlier, later)
    ]
    return max(1, min(ends) - later.requested.round)


def _given_up(claim: Claim) -> GivenUp:
    assert claim.ended is not None
    held_s = (claim.ended.log_time_ns - claim.requested.log_time_ns) / 1e9
    return GivenUp(claim.robot, claim.requested.round, held_s, claim.driven_m)


def _guesses(story: FleetStory, earlier: Claim, later: Claim) -> Iterable[tuple[int, str]]:
    """What the two recorded of each other while the claims lived, and right after."""
    for mine, theirs in ((earlier, later), (later, earlier)):
        for at, seen in story.robots[mine.robot].conflicts:
            begun = mine.requested.round <= at.round
            lived = mine.ended is None or at.round <= mine.ended.round
            if (seen.slot, seen.generation) == mine.task and seen.other == theirs.robot and begun and lived:
                yield mine.robot, seen.cause
                break
