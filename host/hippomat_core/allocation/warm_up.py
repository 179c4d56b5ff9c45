"""Decisions on made-up snapshots before the first round: what an allocator compiles is compiled, and weights
that no robot can decide with are refused.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.port import Allocator, Decision, Problem
from hippomat_core.errors import ConfigError
from hippomat_core.replaced import replace


def warm_up(allocator: Allocator, robots: int, tasks: int) -> None:
    """One robot's decision and everybody's, with all robots free and with every second one busy.

    Raises ConfigError where weights are finite, but logits that follow from them are not.
    """
    free = np.zeros(robots, np.bool_)
    with np.errstate(all="ignore"):  # what overflows is told once, by the error
        for at_work in (free, np.arange(robots) % 2 == 1):
            problem = _problem(at_work, tasks)
            decision = _checked(allocator, problem)
            allocator.actions(problem)
        if decision.logits.size:
            for robot in range(1, robots):  # each may have weights of its own
                _checked(allocator, replace(_problem(free, tasks), self_index=robot))


def _checked(allocator: Allocator, problem: Problem) -> Decision:
    decision = allocator.allocate(problem)
    wrong = np.flatnonzero(~np.isfinite(decision.logits))
    if len(wrong):
        raise ConfigError(
            f"{allocator.name!r} cannot decide with these weights: on a made-up snapshot the logit of "
            f"action {wrong[0]} is {decision.logits[wrong[0]]}; train or export it again"
        )
    return decision


def _problem(at_work: NDArray[np.bool_], tasks: int) -> Problem:
    robots = len(at_work)
    codes = np.arange(robots * tasks) * 37 % 255
    return Problem(
        costs_q=codes.reshape(robots, tasks).astype(np.uint8),
        available=~at_work,
        busy=at_work,
        waiting=np.ones(tasks, np.bool_),
        present=np.ones(robots, np.bool_),
        assigned=at_work,
        ages_rounds=np.ones(robots, np.float32),
        self_index=0,
        round=1,
        seed=1,
    )
