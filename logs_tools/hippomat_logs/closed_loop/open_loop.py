"""What another allocator would have requested in the rounds of a recorded run, everything else as it was.

The recorded events go through the core once more, as at level L2; wherever its allocator is asked, the other
one answers the same problem, and is not heeded. So a difference says what would have begun differently, not
what would have come of it: that takes a closed loop.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.allocation.port import Allocator, Decision, Problem
from hippomat_core.errors import HippomatError
from hippomat_core.step import initial_state, step
from hippomat_logs.closed_loop.choice import Choice
from hippomat_logs.definitions import Task, cost_s
from hippomat_logs.each_file import WORTH_A_PROCESS_BYTES, each_item
from hippomat_logs.manifest import recorded_threads
from hippomat_logs.reader import Run, open_again
from hippomat_logs.schema import EVENTS


@dataclass(frozen=True, slots=True)
class Wish:
    """What was requested in one round: the task, and its travel cost [s]."""

    task: Task
    cost_s: float


@dataclass(frozen=True, slots=True)
class Asked:
    """One round in which a robot's allocator was asked."""

    round: int
    recorded: Wish | None
    other: Wish | None


@dataclass(slots=True)
class RobotAnswers:
    """All of one robot's, and why they end early, if they do."""

    robot: int
    asked: list[Asked] = field(default_factory=list)
    note: str = ""


@dataclass(frozen=True, slots=True)
class Side:
    """One allocator over all rounds and robots of a fleet."""

    requests: int
    cost_s: float  # mean of those requested; nan where there are none
    conflicts: int  # requests for a task that another robot requested in the same round, beyond the first


@dataclass(frozen=True, slots=True)
class OpenLoop:
    """The two allocators on the same problems."""

    rounds: int  # robots times rounds in which an allocator was asked
    differ: int  # where the two do not request the same
    recorded: Side
    other: Side
    notes: tuple[str, ...]


class Watched:
    """The recorded allocator, which decides, and another that is asked beside it."""

    def __init__(self, own: Allocator, other: Allocator) -> None:
        self._own, self._other = own, other
        self.problem: Problem | None = None  # of the last round in which it was asked
        self.answers = (0, 0)  # actions, own and other

    @property
    def name(self) -> str:
        return self._own.name

    def allocate(self, problem: Problem) -> Decision:
        decision = self._own.allocate(problem)
        self.problem, self.answers = problem, (decision.action, self._other.allocate(problem).action)
        return decision

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        return self._own.actions(problem)


def open_loop(runs: Sequence[Run], choice: Choice) -> OpenLoop:
    """All robots' rounds; a process for each log."""
    size = WORTH_A_PROCESS_BYTES if len(runs) > 1 else 0
    os.environ.update(
        recorded_threads(runs[0].manifest)
    )  # of the processes: sums depend on it in the last bit
    places = [(run.paths, run.inside) for run in runs]
    answers = list(each_item(places, partial(_answers, choice), "open loop", size))
    asked = [one for robot in answers for one in robot.asked]
    return OpenLoop(
        len(asked),
        sum(_task(one.recorded) != _task(one.other) for one in asked),
        _side([(one.round, one.recorded) for one in asked]),
        _side([(one.round, one.other) for one in asked]),
        tuple(f"robot {robot.robot}: {robot.note}" for robot in answers if robot.note),
    )


def _answers(choice: Choice, place: tuple[tuple[Path, ...], str]) -> RobotAnswers:
    return robot_answers(open_again(*place), choice)


def robot_answers(run: Run, choice: Choice) -> RobotAnswers:
    """Both allocators in every round of one log in which the recorded one was asked."""
    config = run.config
    state = initial_state(config, run.policy or None)
    watched = Watched(state.fleet.allocator, choice.made(config))
    state = replace(state, fleet=replace(state.fleet, allocator=watched))
    found, again = RobotAnswers(run.robot), list[m.RoundDecided]()
    for record in run.records_in_order():
        message = record.message
        if type(message) in EVENTS:
            watched.problem = None
            try:
                state, effects = step(state, message)
            except HippomatError as error:
                found.note = f"cannot be decided again from record {record.number} on: {error}"
                break
            decided = [effect for effect in effects if isinstance(effect, m.RoundDecided)]
            again += decided
            if watched.problem is not None and decided and state.ground is not None:
                found.asked.append(_asked(watched, decided[-1], state.ground.c_max_s))
        elif isinstance(message, m.RoundDecided):
            same = again.pop(0) if again else None
            if same is None or (same.round, same.action) != (message.round, message.action):
                found.note = (
                    f"does not decide as recorded from record {record.number} on, and is left out from there "
                    "(hippomat-replay --levels L2 says why)"
                )
                found.asked = found.asked[:-1]
                break
    return found


def _asked(watched: Watched, decided: m.RoundDecided, c_max_s: float) -> Asked:
    problem = watched.problem
    assert problem is not None

    def wish(action: int) -> Wish | None:
        if action == 0:
            return None
        slot = action - 1
        code = int(problem.costs_q[problem.self_index, slot])
        return Wish((slot, int(decided.generations[slot])), cost_s(code, c_max_s))

    return Asked(decided.round, *(wish(action) for action in watched.answers))


def _task(wish: Wish | None) -> Task | None:
    return None if wish is None else wish.task


def _side(wishes: Sequence[tuple[int, Wish | None]]) -> Side:
    made = [(number, wish) for number, wish in wishes if wish is not None]
    counts = Counter((number, wish.task) for number, wish in made)
    cost_s = float(np.mean([wish.cost_s for _, wish in made])) if made else float("nan")
    return Side(len(made), cost_s, sum(count - 1 for count in counts.values()))
