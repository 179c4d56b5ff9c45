"""The assignment of least total cost when busy robots take part: a robot may wait, so that a task goes to one
that is busy now and there sooner. Knows costs, not maps.

Every row is a robot: an available one with its travel costs, a busy one with the time until it could be at
each task. Each is given a task or waits. What waiting costs is on the scale of the snapshot itself:
WAIT_FACTOR times the mean, over the open tasks, of the soonest that anybody could be there. For an available
robot it is never less than its own cheapest task: it stays only where that one is promised to another robot.
Who is busy requests nothing; when nobody is, this is the Hungarian algorithm.

In the paper's continuous mode a wait comes to 5 s with 10 agents. Factors from 1 to 3 save time there from 10
agents on, 2 saves most from 20 on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.hungarian import (
    FORBIDDEN,
    TIE_BITS,
    UNIT,
    assign,
    least_total,
    units,
    weights_of,
)
from hippomat_core.allocation.port import NO_LOGITS, Decision, Problem
from hippomat_core.wire.frames import UNREACHABLE

WAIT_FACTOR = 2
# At equal totals an available robot requests. Tie weights with this added are still < 1 unit for 64 rows.
_LATER = 2**TIE_BITS


def wait_units(costs_q: NDArray[np.uint8], possible: NDArray[np.bool_]) -> int:
    """What waiting costs, in units of c_max / 254^2: WAIT_FACTOR times the mean least cost of the tasks.

    costs_q: (N, M)  possible: (N, M), the pairs that count  returns: 0 where there are none.
    """
    soonest = units(np.where(possible, costs_q, UNREACHABLE).min(axis=0, initial=UNREACHABLE))
    soonest = soonest[possible.any(axis=0)]
    return WAIT_FACTOR * int(soonest.sum()) // max(soonest.size, 1)


def assign_ahead(
    costs_q: NDArray[np.uint8], eligible: NDArray[np.bool_], promisable: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Slot of every robot, -1 for none; a busy robot's slot is what it is expected to take once it is free.

    costs_q: (N, M) codes  eligible: (N, M) pairs of available robots  promisable: (N, M) pairs of busy ones
    """
    if not promisable.any():
        return assign(costs_q, eligible)
    robots, tasks = costs_q.shape
    possible = eligible | promisable
    own_least = units(np.where(eligible, costs_q, UNREACHABLE).min(axis=1))
    wait = np.maximum(np.where(eligible.any(axis=1), own_least, 0), wait_units(costs_q, possible))
    weights = np.full((robots, tasks + robots), FORBIDDEN, np.int64)
    weights[:, :tasks] = weights_of(costs_q, possible) + promisable * _LATER
    weights[:, tasks:] = wait[:, None] * UNIT + _LATER
    found = least_total(weights)
    return np.where(found < tasks, found, -1)


class LookAhead:
    """Every robot solves the whole problem, busy robots included, on the common snapshot."""

    name = "look_ahead"

    def allocate(self, problem: Problem) -> Decision:
        return Decision(int(self.actions(problem)[problem.self_index]), NO_LOGITS)

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        slots = assign_ahead(problem.costs_q, problem.eligible, promisable(problem))
        return np.where(problem.available, slots + 1, 0)


def promisable(problem: Problem) -> NDArray[np.bool_]:
    """(N, M) bool: a busy robot could take this task once it is free."""
    open_: NDArray[np.bool_] = (problem.costs_q != UNREACHABLE) & problem.waiting[None, :]
    return open_ & (problem.busy & ~problem.available)[:, None]
