"""Why two robots wanted one task: loss, staleness, tie, policy or clock, with the evidence.

From both robots' logs; the core guesses the same from one side (fleet/claims.py, conflict_cause). The first
that applies:

clock      they did not decide at a common instant: one counted rounds alone, or its STATE left too late.
loss       the other's frame was on the air, and neither it nor a relay of it came here; with it, they would
           not both have wanted the task.
staleness  the same for rows of third robots, generations, or a claim that was held but had expired.
tie        on one and the same snapshot both want the task, at equal cost.
policy     on one and the same snapshot both want the task, at different costs.

"Would" is not guessed: the recorded allocator is asked again (rerun.py), where it can be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hippomat_core.messages import NEVER_HEARD_MS
from hippomat_logs.fleet_story.rerun import Rerun, newest_of_both
from hippomat_logs.fleet_story.story import FleetStory
from hippomat_logs.fleet_story.values import Claim, Decision

LOSS, STALENESS, TIE, POLICY, CLOCK, UNKNOWN = "loss", "staleness", "tie", "policy", "clock", "unknown"
CAUSES = (LOSS, STALENESS, TIE, POLICY, CLOCK, UNKNOWN)
_SHOWN = 4


@dataclass(frozen=True, slots=True)
class Cause:
    """evidence: sentences, the deciding one first."""

    name: str
    evidence: tuple[str, ...]


def cause_of(story: FleetStory, rerun: Rerun, earlier: Claim, later: Claim) -> Cause:
    """earlier, later: in the order of (round of the request, robot)."""
    one, two = earlier.decision, later.decision
    if one is None or two is None:
        return Cause(UNKNOWN, ("a decision that led to a request is not in its log",))
    alone = [seen for seen in (one, two) if not seen.common]
    if alone:
        return Cause(CLOCK, tuple(_counted_alone(seen) for seen in alone))
    if one.at.round < two.at.round:
        return _of_rounds_apart(story, earlier, two)
    return _of_one_round(story, rerun, one, two)


def _counted_alone(seen: Decision) -> str:
    return (
        f"robot {seen.robot} ended round {seen.at.round} by its own count: its radio was silent, or "
        "fleet time not agreed"
    )


# ---- the second request came when the first claim should have been known ----


def _of_rounds_apart(story: FleetStory, earlier: Claim, later: Decision) -> Cause:
    first, second = earlier.robot, later.robot
    begun, asked = earlier.requested.round, later.at.round
    told = story.robots[first]
    held = int(later.row_round[first])
    if earlier.on_air is None or earlier.on_air[0] > asked:
        when = "never" if earlier.on_air is None else f"only in round {earlier.on_air[0]}"
        text = f"robot {first} claimed in round {begun}, but its claim was on the air {when}: deadline missed"
        return Cause(CLOCK, (text,))
    carried = range(earlier.on_air[0], asked + 1)
    missed = [number for number in carried if told.sent.get(number, (0, False))[1] and number > held]
    if missed:
        frames = _frames([(number, told.sent[number][0]) for number in missed])
        text = (
            f"robot {first}'s claim of round {begun} was on the air in {frames}; of these robot {second} "
            f"heard none, directly or relayed, before it asked in round {asked}"
        )
        return Cause(LOSS, (text, _row_held(later, first)))
    if not later.present[first]:
        text = f"robot {second} had heard the claim, but had it expired: robot {first} was unheard for 3 s"
    else:
        text = f"robot {second} held robot {first}'s row of round {held}, and yet took the task for unclaimed"
    return Cause(STALENESS, (text, _row_held(later, first)))


def _frames(sent: list[tuple[int, int]]) -> str:
    """[(round, sequence)] in words."""
    named = ", ".join(f"{number} (sequence {sequence})" for number, sequence in sent[:_SHOWN])
    more = f" and {len(sent) - _SHOWN} more" if len(sent) > _SHOWN else ""
    return f"round{'s' if len(sent) > 1 else ''} {named}{more}"


def _row_held(seen: Decision, robot: int) -> str:
    number, age_ms = int(seen.row_round[robot]), int(seen.decided.row_age_ms[robot])
    if age_ms == NEVER_HEARD_MS and number < 0:
        return f"robot {seen.robot} had never heard robot {robot}"
    of = f"of round {number}, " if number >= 0 else ""
    return f"robot {seen.robot} held a row of robot {robot} {of}{age_ms} ms old"


# ---- both asked in one round ----


def _of_one_round(story: FleetStory, rerun: Rerun, one: Decision, two: Decision) -> Cause:
    differing = differing_rows(one, two)
    slots = differing_slots(one, two)
    if not differing and not slots:
        return _chosen_so(one, two, "both decided on equal rows")
    refusals = [text for text in (rerun.refusal(one), rerun.refusal(two)) if text]
    asked_again = ""
    if not refusals:
        fresh = newest_of_both(one, two, story.config(one.robot).fleet.seed)
        actions = rerun.action(one, fresh), rerun.action(two, fresh)
        if actions == (one.decided.action, two.decided.action):
            return _chosen_so(one, two, "their rows differed, but on the newest of them both ask again")
        acts = ", ".join(
            f"robot {seen.robot} {_asks(action)}" for seen, action in zip((one, two), actions, strict=True)
        )
        asked_again = f"asked again on the newest rows that either held: {acts}"
    return _of_inputs(story, one, two, differing, slots, asked_again or refusals[0])


def _asks(action: int) -> str:
    return f"asks for slot {action - 1}" if action else "asks for nothing"


def _chosen_so(one: Decision, two: Decision, why: str) -> Cause:
    task = one.requested
    assert task is not None
    codes = int(one.costs[one.robot, task[0]]), int(two.costs[two.robot, task[0]])
    name = TIE if codes[0] == codes[1] else POLICY
    costs = f"equal cost codes ({codes[0]})" if name == TIE else f"cost codes {codes[0]} and {codes[1]}"
    return Cause(name, (f"{why}; {one.decided.allocator} has both ask for the task, at {costs}",))


def _of_inputs(
    story: FleetStory, one: Decision, two: Decision, differing: list[int], slots: list[int], again: str
) -> Cause:
    lost: list[str] = []
    late: list[str] = []
    others: list[str] = []
    for seen, other in ((one, two), (two, one)):
        for robot in differing:
            if seen.late[robot] and seen.row_round[robot] < other.row_round[robot]:
                text = missing_row(story, seen, robot)
                is_loss = robot == other.robot and _was_sent(story, robot, seen.at.round)
                (lost if is_loss else others).append(text)
                if robot == other.robot and not is_loss:
                    late.append(text)
    if lost:
        return Cause(LOSS, (*lost, *[t for t in others if t not in lost], again))
    if late:
        return Cause(CLOCK, (*late, *[t for t in others if t not in late], again))
    if slots:
        named = ", ".join(map(str, slots))
        others.append(f"robots {one.robot} and {two.robot} knew different tasks in slot {named}")
    if not others:
        others.append(f"robots {one.robot} and {two.robot} held different rows of robot {_list(differing)}")
    return Cause(STALENESS, (*others, again))


def _list(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers))


def _was_sent(story: FleetStory, robot: int, number: int) -> bool:
    told = story.robots.get(robot)
    return told is not None and told.sent.get(number, (0, False))[1]


def missing_row(story: FleetStory, seen: Decision, robot: int) -> str:
    """What became of `robot`'s STATE of the round of `seen`, which lacks it; says where that is unknown."""
    number, told = seen.at.round, story.robots.get(robot)
    held = _row_held(seen, robot)
    if told is None:
        return f"{held}; robot {robot}'s log is missing: unknown whether it sent one in round {number}"
    if not told.covers(number):
        return f"{held}; robot {robot}'s log does not reach round {number}"
    if number not in told.sent:
        but = ", as far as its log goes, which lost records" if told.lost else ""
        return f"{held}; robot {robot} had no STATE on the air in round {number}{but}"
    sequence, on_air = told.sent[number]
    if not on_air:
        return f"{held}; robot {robot}'s radio gave up on its STATE of round {number} (sequence {sequence})"
    by_radio = ", though its radio did" if seen.held >> robot & 1 else ""
    return (
        f"{held}; robot {robot} sent its STATE of round {number} (sequence {sequence}), but robot "
        f"{seen.robot} heard neither it nor a relay of it{by_radio}"
    )


def differing_rows(one: Decision, two: Decision) -> list[int]:
    """Robots whose rows said something else to the two. Slots that had just turned do not count."""
    columns = one.settled & two.settled
    differs = (one.costs[:, columns] != two.costs[:, columns]).any(axis=1)
    differs |= (one.available != two.available) | (one.busy != two.busy)
    differs |= np.asarray(one.decided.row_slot) != np.asarray(two.decided.row_slot)
    return [int(robot) for robot in np.flatnonzero(differs)]


def differing_slots(one: Decision, two: Decision) -> list[int]:
    """Slots in which the two knew another generation, or of which one thought that they were taken."""
    differs = np.asarray(one.decided.generations) != np.asarray(two.decided.generations)
    differs |= one.waiting != two.waiting
    return [int(slot) for slot in np.flatnonzero(differs)]
