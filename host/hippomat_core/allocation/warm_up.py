"""Decisions on made-up snapshots, so that what an allocator compiles is compiled before the first round."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.port import Allocator, Problem


def warm_up(allocator: Allocator, robots: int, tasks: int) -> None:
    """One robot's decision and everybody's, with all robots free and with every second one busy."""
    for at_work in (np.zeros(robots, np.bool_), np.arange(robots) % 2 == 1):
        problem = _problem(at_work, tasks)
        allocator.allocate(problem)
        allocator.actions(problem)


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
