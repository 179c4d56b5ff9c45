"""The recorded allocator, asked again: on what a robot held, and on what it could have held.

An answer counts only where the allocator gives back the recorded one on the recorded inputs; else this says
why it cannot be asked. Knows decisions and allocators, no logs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.factory import POLICIES, make_allocator
from hippomat_core.allocation.port import Allocator, Problem
from hippomat_core.fleet.rows import is_available, is_busy
from hippomat_core.wire.frames import (
    CLAIMED,
    FLAG_LOCALIZED,
    FLAG_STOPPED,
    NO_SLOT,
    WAITING,
    StateFrame,
)
from hippomat_logs.fleet_story.story import FleetStory
from hippomat_logs.fleet_story.values import Decision
from hippomat_logs.level2 import LOGITS_TOLERANCE

BOUND = "endorses another claim there"
_ASKED = ("requested", "no task for this robot", BOUND)


def problem_of(seen: Decision, seed: int) -> Problem:
    """What the allocator was given."""
    return Problem(
        costs_q=seen.costs,
        available=seen.available,
        busy=seen.busy,
        waiting=seen.waiting,
        present=seen.present,
        assigned=np.asarray(seen.decided.row_slot) != NO_SLOT,
        ages_rounds=seen.ages_rounds,
        self_index=seen.robot,
        round=seen.decided.round,
        seed=seed,
    )


class Rerun:
    """Allocators of a fleet's robots, made once."""

    def __init__(self, story: FleetStory) -> None:
        self._story = story
        self._allocators: dict[int, Allocator] = {}

    def problem(self, seen: Decision) -> Problem:
        return problem_of(seen, self._story.config(seen.robot).fleet.seed)

    def refusal(self, seen: Decision) -> str:
        """Why this decision cannot be made again; empty: it can, and was."""
        if seen.decided.reason not in _ASKED:
            return f"the allocator was not asked: {seen.decided.reason}"
        name = seen.decided.allocator
        if name in POLICIES and not self._story.policy(seen.robot):
            return f"the weights of {name} are not in robot {seen.robot}'s log"
        again = self._allocator(seen).allocate(self.problem(seen))
        if not _alike(again.logits, np.asarray(seen.decided.logits)):
            return "on the recorded rows this machine computes other logits: see hippomat-replay"
        taken = seen.decided.action
        if again.action != taken and (taken or seen.decided.reason != BOUND):
            return "on the recorded rows the allocator acts otherwise: see hippomat-replay"
        return ""

    def action(self, seen: Decision, problem: Problem) -> int:
        """What the robot of `seen` would have done on `problem`: 0 no request, j slot j - 1."""
        view = replace(problem, self_index=seen.robot)
        return self._allocator(seen).allocate(view).action

    def logits(self, seen: Decision, problem: Problem) -> NDArray[np.float32]:
        return self._allocator(seen).allocate(replace(problem, self_index=seen.robot)).logits

    def _allocator(self, seen: Decision) -> Allocator:
        if seen.robot not in self._allocators:
            fleet, policy = self._story.config(seen.robot).fleet, self._story.policy(seen.robot)
            made = make_allocator(seen.decided.allocator, policy or None, fleet.size, fleet.task_slots)
            self._allocators[seen.robot] = made
        return self._allocators[seen.robot]


def _alike(ours: NDArray[np.float32], recorded: NDArray[np.float32]) -> bool:
    """As level L2 has it for another machine."""
    return ours.shape == recorded.shape and bool(np.allclose(ours, recorded, rtol=0.0, atol=LOGITS_TOLERANCE))


def newest_of_both(first: Decision, second: Decision, seed: int) -> Problem:
    """The problem that both would have had, had each held the newest row that either of them held.

    Of one round. A robot's own row is its own view of it. A task waits where it waits for both.
    """
    mine, theirs = problem_of(first, seed), problem_of(second, seed)
    n = len(first.row_round)
    takes_second = second.row_round > first.row_round
    takes_second[second.robot], takes_second[first.robot] = True, False
    known = first.decided.generations == second.decided.generations

    def chosen(name: str) -> NDArray[np.generic]:
        ours, others = getattr(mine, name), getattr(theirs, name)
        which = takes_second.reshape((n,) + (1,) * (ours.ndim - 1))
        return np.where(which, others, ours)

    rows = {
        name: chosen(name) for name in ("costs_q", "available", "busy", "present", "assigned", "ages_rounds")
    }
    return replace(mine, waiting=mine.waiting & theirs.waiting & known, **rows)  # type: ignore[arg-type]


def with_fresh_rows(
    seen: Decision, rows: dict[int, StateFrame], generations: NDArray[np.int64], seed: int
) -> Problem:
    """The problem, had every one of `rows` arrived in this round: its owner's STATE on the air.

    generations: (M,) the newest that anybody knew when these were sent; slots that had turned are not open.
    """
    problem = problem_of(seen, seed)
    costs_q, available, busy = problem.costs_q.copy(), problem.available.copy(), problem.busy.copy()
    assigned, present, ages = problem.assigned.copy(), problem.present.copy(), problem.ages_rounds.copy()
    claims = list(seen.row_claim)
    for robot, frame in rows.items():
        if robot == seen.robot:
            continue
        localized, stopped = bool(frame.flags & FLAG_LOCALIZED), bool(frame.flags & FLAG_STOPPED)
        slot = frame.claim.slot
        costs_q[robot] = frame.costs
        available[robot] = is_available(frame.status, localized, stopped, slot)
        busy[robot] = is_busy(localized, stopped, slot)
        assigned[robot], present[robot] = slot != NO_SLOT, True
        ages[robot] = min(float(ages[robot]), 1.0)
        claims[robot] = None if slot == NO_SLOT else (slot, frame.claim.generation)
    ours = np.asarray(seen.decided.generations, np.int64)
    claimed = np.zeros(len(ours), np.bool_)
    for claim in claims:
        if claim is not None and claim[1] == ours[claim[0]]:
            claimed[claim[0]] = True
    states = np.asarray(seen.decided.task_states)
    open_here = ((states == WAITING) | (states == CLAIMED)) & seen.settled
    waiting = open_here & ~claimed & (generations <= ours)
    return replace(
        problem,
        costs_q=costs_q,
        available=available,
        busy=busy,
        assigned=assigned,
        present=present,
        ages_rounds=ages,
        waiting=waiting,
    )
