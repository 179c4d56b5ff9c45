"""One decision taken apart: the rows it was made from, what became of each, and a better-informed choice.

Every row is compared with what its owner had on the air in that round, by the owner's own log. What no log
says is said to be unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.fleet.rows import HEARD_DIRECTLY, is_available
from hippomat_core.messages import NEVER_HEARD_MS
from hippomat_core.wire.frames import (
    CLAIMED,
    DONE,
    FLAG_LOCALIZED,
    FLAG_STOPPED,
    INACTIVE,
    NO_SLOT,
    UNREACHABLE,
    WAITING,
    StateFrame,
)
from hippomat_logs.definitions import Task, cost_s
from hippomat_logs.fleet_story.causes import missing_row
from hippomat_logs.fleet_story.rerun import Rerun, with_fresh_rows
from hippomat_logs.fleet_story.story import FleetStory
from hippomat_logs.fleet_story.values import Decision

BEST = 3  # tasks named per row
STATES = {INACTIVE: "inactive", WAITING: "waiting", CLAIMED: "claimed", DONE: "done"}


@dataclass(frozen=True, slots=True)
class RowView:
    """One row of the snapshot. best: (slot, cost code) of the cheapest tasks that wait."""

    robot: int
    came: str  # own, direct, by robot K, its own relay, never
    round: int  # in which its owner sent it; -1: unknown
    stale: bool
    age_ms: int
    rssi_dbm: int | None
    sequence: int | None
    state: str  # free, claims 3@7, not free
    best: tuple[tuple[int, int], ...]
    fate: str  # of the owner's frame of this round, where the row is stale
    differs: tuple[str, ...]  # from what its owner had on the air in this round
    compared: bool  # the owner's frame is known


@dataclass(frozen=True, slots=True)
class Choice:
    """One thing that the allocator could choose; slot None: no request."""

    slot: int | None
    generation: int
    state: str
    code: int
    cost_s: float
    logit: float | None


@dataclass(frozen=True, slots=True)
class DecisionView:
    """The whole decision. fresh: the request with the owners' true rows of the round; None: none."""

    robot: int
    round: int
    record: int
    time_s: float  # since the robot's log begins
    common: bool
    allocator: str
    request: Task | None
    reason: str
    rows: tuple[RowView, ...]
    choices: tuple[Choice, ...]  # the best first
    margin: float | None  # of the logit taken over the next best
    refusal: str  # why it cannot be decided again
    fresh: Task | None
    same: bool | None  # with fresh rows it acts the same; None: not known
    unknown: tuple[int, ...]  # robots whose true rows are not known
    newer: tuple[int, ...]  # slots of which others knew a newer generation


def decision_view(story: FleetStory, seen: Decision) -> DecisionView:
    """story: read with said_in covering the round of `seen`."""
    number, rerun = seen.at.round, Rerun(story)
    said = {k: told.said[number] for k, told in story.robots.items() if number in told.said}
    generations = newest_generations(story, seen)
    refusal = rerun.refusal(seen)
    fresh = same = None
    if not refusal:
        seed = story.config(seen.robot).fleet.seed
        taken = rerun.action(seen, rerun.problem(seen))
        action = rerun.action(seen, with_fresh_rows(seen, said, generations, seed))
        same, fresh = action == taken, _task(seen, action)
    ours = np.asarray(seen.decided.generations, np.int64)
    return DecisionView(
        robot=seen.robot,
        round=number,
        record=seen.at.record,
        time_s=(seen.at.log_time_ns - story.robots[seen.robot].begun_ns) / 1e9,
        common=seen.common,
        allocator=seen.decided.allocator,
        request=seen.requested,
        reason=seen.decided.reason,
        rows=tuple(_row(story, seen, robot, said.get(robot)) for robot in range(len(seen.row_round))),
        choices=tuple(_choices(story, seen)),
        margin=margin(seen),
        refusal=refusal,
        fresh=fresh,
        same=same,
        unknown=tuple(k for k in range(story.size) if k not in said and k != seen.robot),
        newer=tuple(np.flatnonzero(generations > ours).tolist()),
    )


def newest_generations(story: FleetStory, seen: Decision) -> NDArray[np.int64]:
    """(M,) that any robot with a log knew when the rows of this round were sent."""
    before = seen.at.round - 1
    return np.array(
        [
            max(told.generation_in(slot, before) for told in story.robots.values())
            for slot in range(story.slots)
        ],
        np.int64,
    )


def margin(seen: Decision) -> float | None:
    """Of the logit of what was done over the best of all others; None where there are no logits."""
    logits = np.asarray(seen.decided.logits, np.float64)
    if not len(logits):
        return None
    taken = seen.decided.action
    others = np.delete(logits, taken)
    rest = others[np.isfinite(others)]
    return float(logits[taken] - rest.max()) if len(rest) else None


def runner_up(seen: Decision) -> int | None:
    """The action with the next best logit: 0 no request, j slot j - 1."""
    logits = np.array(seen.decided.logits, np.float64)
    if not len(logits):
        return None
    logits[seen.decided.action] = -np.inf
    best = int(np.argmax(logits))
    return best if np.isfinite(logits[best]) else None


def _task(seen: Decision, action: int) -> Task | None:
    return (action - 1, int(seen.decided.generations[action - 1])) if action > 0 else None


def _row(story: FleetStory, seen: Decision, robot: int, said: StateFrame | None) -> RowView:
    decided, is_own = seen.decided, robot == seen.robot
    age_ms, number = int(decided.row_age_ms[robot]), int(seen.row_round[robot])
    never = not is_own and age_ms == NEVER_HEARD_MS and number < 0
    stale = not is_own and number < seen.at.round
    costs = np.where(seen.waiting, seen.costs[robot], UNREACHABLE)
    best = [int(slot) for slot in np.argsort(costs, kind="stable")[:BEST] if costs[slot] != UNREACHABLE]
    return RowView(
        robot=robot,
        came="own" if is_own else "never" if never else _way(int(decided.row_via[robot]), robot),
        round=number,
        stale=stale,
        age_ms=age_ms,
        rssi_dbm=None if is_own or never else int(decided.row_rssi_dbm[robot]),
        sequence=None if is_own or never else int(decided.row_sequence[robot]),
        state=_state(bool(seen.available[robot]), int(decided.row_slot[robot]), seen.row_claim[robot]),
        best=tuple((slot, int(costs[slot])) for slot in best),
        fate=missing_row(story, seen, robot) if stale else "",
        differs=() if said is None or is_own else tuple(_differences(story, seen, robot, said)),
        compared=said is not None,
    )


def _way(via: int, robot: int) -> str:
    if via == HEARD_DIRECTLY:
        return "direct"
    return "its own relay" if via == robot else f"by robot {via}"


def _state(available: bool, slot: int, claim: Task | None) -> str:
    if claim is not None:
        return f"claims {claim[0]}@{claim[1]}"
    if slot != NO_SLOT:
        return f"claims slot {slot}"
    return "free" if available else "not free"


def _differences(story: FleetStory, seen: Decision, robot: int, said: StateFrame) -> list[str]:
    """What the row held says otherwise than its owner did."""
    localized, stopped = bool(said.flags & FLAG_LOCALIZED), bool(said.flags & FLAG_STOPPED)
    claim = None if said.claim.slot == NO_SLOT else (said.claim.slot, said.claim.generation)
    available = is_available(said.status, localized, stopped, said.claim.slot)
    held = _state(bool(seen.available[robot]), int(seen.decided.row_slot[robot]), seen.row_claim[robot])
    true = _state(available, said.claim.slot, claim)
    texts = [] if held == true else [f"{true} (held: {held})"]
    costs, true_costs = seen.costs[robot], np.asarray(said.costs)
    changed = np.flatnonzero((costs != true_costs) & seen.settled)
    for slot in changed[:BEST].tolist():
        was, is_now = cost_text(story, int(costs[slot])), cost_text(story, int(true_costs[slot]))
        texts.append(f"slot {slot} {is_now} (held: {was})")
    if len(changed) > BEST:
        texts.append(f"and {len(changed) - BEST} more costs")
    return texts


def cost_text(story: FleetStory, code: int) -> str:
    """Seconds; the bare code where c_max is unknown."""
    if code == UNREACHABLE:
        return "unreachable"
    seconds = cost_s(code, story.c_max_s)
    return f"code {code}" if np.isnan(seconds) else f"{seconds:.1f} s"


def _choices(story: FleetStory, seen: Decision) -> list[Choice]:
    """By logit where there are logits, else by cost; tasks that were not open come last."""
    decided, robot = seen.decided, seen.robot
    logits = np.asarray(decided.logits, np.float64)
    made = []
    if len(logits):
        made.append(Choice(None, 0, "", UNREACHABLE, float("nan"), _finite(logits[0])))
    for slot in range(len(decided.generations)):
        code = int(seen.costs[robot, slot])
        state = STATES.get(int(decided.task_states[slot]), "?")
        if state == "waiting" and not seen.settled[slot]:
            state = "new"
        logit = _finite(logits[slot + 1]) if len(logits) else None
        made.append(
            Choice(slot, int(decided.generations[slot]), state, code, cost_s(code, story.c_max_s), logit)
        )
    return sorted(made, key=_rank)


def _rank(choice: Choice) -> tuple[bool, float, int]:
    closed = choice.slot is not None and (choice.state != "waiting" or choice.code == UNREACHABLE)
    return closed, -choice.logit if choice.logit is not None else choice.code, choice.slot or 0


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
