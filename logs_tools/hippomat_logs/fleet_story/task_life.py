"""The life of one task over all robots' logs: who learnt of it, what it cost, who claimed it, how it ended.

Times are fleet time, counted in rounds: the same for all robots, and no clock is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hippomat_core.fleet.rows import HEARD_DIRECTLY
from hippomat_core.wire.frames import UNREACHABLE
from hippomat_logs.definitions import Task
from hippomat_logs.fleet_story.causes import missing_row
from hippomat_logs.fleet_story.conflicts import Conflict, conflicts_in
from hippomat_logs.fleet_story.decision_view import margin, runner_up
from hippomat_logs.fleet_story.rerun import BOUND, Rerun
from hippomat_logs.fleet_story.story import FleetStory
from hippomat_logs.fleet_story.values import Claim, Decision

MOST_ROUNDS = 8  # of costs shown


@dataclass(frozen=True, slots=True)
class Learnt:
    robot: int
    round: int
    cause: str  # start, claimed, completed, heard


@dataclass(frozen=True, slots=True)
class CostRow:
    """What the task cost each robot in one round, as it told the others; None: it had not priced it."""

    round: int
    codes: tuple[int | None, ...]


@dataclass(frozen=True, slots=True)
class RequestView:
    """One claim on the task. Rounds are fleet time; *_s are differences on the claimant's clock."""

    robot: int
    round: int
    code: int
    allocator: str
    logit: float | None
    margin: float | None
    runner_up: int | None  # slot; -1: no request
    inputs: str
    stale: tuple[str, ...]
    on_air: int | None  # round of the first STATE that carried the claim
    votes: tuple[tuple[int, int], ...]  # (robot, round) in which its endorsement was first heard
    confirmed: tuple[tuple[str, str, int], ...]  # confirmed / unconfirmed, why, round
    confirmed_after_s: float | None
    ended: int | None
    end: str
    why: str
    held_s: float | None
    driven_m: float
    planned_m: float | None
    replanned: tuple[tuple[str, int], ...]  # cause, how often
    guarded: int  # ticks
    recoveries: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TaskLife:
    """Everything that the logs say of one task."""

    slot: int
    generation: int
    place_m: tuple[float, float, float] | None
    learnt: tuple[Learnt, ...]
    costs: tuple[CostRow, ...]
    requests: tuple[RequestView, ...]
    bound: tuple[tuple[int, int, int], ...]  # (robot, first, last round): wanted it, but endorsed another
    conflicts: tuple[Conflict, ...]
    heard_of: tuple[tuple[int, str, int], ...]  # (robot without a log, what was heard of its claim, round)
    replaced: int | None  # round in which the slot's next generation was first known


def task_lives(story: FleetStory, tasks: Sequence[Task]) -> list[TaskLife]:
    """story: its decisions may hold more than requests; costs are known only in those."""
    conflicts = conflicts_in(story)
    return [_life(story, task, [one for one in conflicts if one.task == task]) for task in tasks]


def task_life(story: FleetStory, task: Task) -> TaskLife:
    """Of one task."""
    (life,) = task_lives(story, [task])
    return life


def _life(story: FleetStory, task: Task, conflicts: Sequence[Conflict]) -> TaskLife:
    turned = [
        (told.robot, at, turn)
        for told in story.robots.values()
        for at, turn in told.turned
        if (turn.slot, turn.generation) == task
    ]
    learnt: dict[int, Learnt] = {}
    for robot, at, turn in turned:
        number = at.round + (turn.cause == "heard")  # within the next round
        learnt.setdefault(robot, Learnt(robot, max(number, 0), turn.cause))
    place = turned[0][2] if turned else None
    claims = [claim for claim in story.claims if claim.task == task]
    next_known = [
        at.round
        for told in story.robots.values()
        for at, turn in told.turned
        if turn.slot == task[0] and turn.generation > task[1]
    ]
    return TaskLife(
        slot=task[0],
        generation=task[1],
        place_m=None if place is None else (place.x_cm / 100, place.y_cm / 100, place.z_cm / 100),
        learnt=tuple(sorted(learnt.values(), key=lambda one: (one.round, one.robot))),
        costs=tuple(_costs(story, task, [claim.requested.round for claim in claims])),
        requests=tuple(_request(story, claim) for claim in claims),
        bound=tuple(_bound(story, task)),
        conflicts=tuple(conflicts),
        heard_of=tuple(_heard_of(story, task)),
        replaced=min(next_known, default=None),
    )


def _heard_of(story: FleetStory, task: Task) -> list[tuple[int, str, int]]:
    """What those with a log heard of claims of those without: its first mention."""
    first: dict[tuple[int, str], int] = {}
    for told in story.robots.values():
        for at, seen in told.peers:
            if seen.robot not in story.robots and (seen.slot, seen.generation) == task:
                key = seen.robot, seen.what
                first[key] = min(first.get(key, at.round), at.round)
    return sorted(((robot, what, number) for (robot, what), number in first.items()), key=lambda one: one[2])


def _costs(story: FleetStory, task: Task, requested: list[int]) -> list[CostRow]:
    """In a few rounds from the first to the last in which it was open, those of requests among them."""
    slot, generation = task
    known: dict[int, dict[int, int]] = {}
    for told in story.robots.values():
        for number, seen in told.decisions.items():
            if int(seen.decided.generations[slot]) == generation:
                known.setdefault(number, {})[told.robot] = int(seen.costs[told.robot, slot])
    rounds = sorted(known)
    if not rounds:
        return []
    spread = np.linspace(0, len(rounds) - 1, min(MOST_ROUNDS, len(rounds))).round().astype(int)
    shown = {rounds[k] for k in spread.tolist()} | {number for number in requested if number in known}
    return [
        CostRow(number, tuple(_priced(known[number].get(robot)) for robot in range(story.size)))
        for number in sorted(shown)
    ]


def _priced(code: int | None) -> int | None:
    return None if code == UNREACHABLE else code


def _request(story: FleetStory, claim: Claim) -> RequestView:
    seen, begun_ns = claim.decision, claim.requested.log_time_ns
    confirmed = [at for what, _, at in claim.changes if what == "confirmed"]
    replanned: dict[str, int] = {}
    for _, _, cause in claim.paths[1:]:
        replanned[cause] = replanned.get(cause, 0) + 1
    logits = np.zeros(0) if seen is None else np.asarray(seen.decided.logits)
    second = None if seen is None else runner_up(seen)
    return RequestView(
        robot=claim.robot,
        round=claim.requested.round,
        code=claim.code,
        allocator="" if seen is None else seen.decided.allocator,
        logit=float(logits[claim.task[0] + 1]) if len(logits) else None,
        margin=None if seen is None else margin(seen),
        runner_up=None if second is None else second - 1,
        inputs="" if seen is None else inputs_text(seen),
        stale=() if seen is None else tuple(stale_rows(story, seen)),
        on_air=None if claim.on_air is None else claim.on_air[0],
        votes=tuple((robot, at.round + 1) for robot, at in sorted(claim.votes.items())),
        confirmed=tuple((what, why, at.round) for what, why, at in claim.changes),
        confirmed_after_s=(confirmed[0].log_time_ns - begun_ns) / 1e9 if confirmed else None,
        ended=None if claim.ended is None else claim.ended.round,
        end=claim.end,
        why=claim.why,
        held_s=None if claim.ended is None else (claim.ended.log_time_ns - begun_ns) / 1e9,
        driven_m=claim.driven_m,
        planned_m=claim.paths[0][1] if claim.paths else None,
        replanned=tuple(sorted(replanned.items())),
        guarded=claim.guarded,
        recoveries=tuple(f"{step} ({cause}) in round {at.round}" for at, step, cause in claim.recoveries),
    )


def inputs_text(seen: Decision) -> str:
    """How the rows of a decision came, in one line."""
    others = np.arange(len(seen.row_round)) != seen.robot
    fresh = others & ~seen.late
    relayed = fresh & (np.asarray(seen.decided.row_via) != HEARD_DIRECTLY)
    stale, never = others & seen.late & (seen.row_round >= 0), others & (seen.row_round < 0)
    direct = int((fresh & ~relayed).sum())
    parts = [f"{direct} row{'' if direct == 1 else 's'} heard directly", f"{int(relayed.sum())} relayed"]
    parts += [f"{int(stale.sum())} stale"] if stale.any() else []
    parts += [f"{int(never.sum())} never heard"] if never.any() else []
    return ", ".join(parts)


def stale_rows(story: FleetStory, seen: Decision) -> list[str]:
    """What became of the rows that were not of this round."""
    return [
        missing_row(story, seen, robot)
        for robot in range(len(seen.row_round))
        if robot != seen.robot and seen.late[robot]
    ]


def _bound(story: FleetStory, task: Task) -> list[tuple[int, int, int]]:
    """Rounds in which a robot's allocator chose the task, and the robot's vote for another forbade it."""
    rerun, spans = Rerun(story), list[tuple[int, int, int]]()
    for told in story.robots.values():
        rounds = [
            number
            for number, seen in sorted(told.decisions.items())
            if seen.decided.reason == BOUND
            and int(seen.decided.generations[task[0]]) == task[1]
            and not rerun.refusal(seen)
            and rerun.action(seen, rerun.problem(seen)) == task[0] + 1
        ]
        if rounds:
            spans.append((told.robot, rounds[0], rounds[-1]))
    return spans
