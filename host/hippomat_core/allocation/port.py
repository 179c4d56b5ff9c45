"""The allocators' port: one problem in, one robot's action out. Knows quantised costs, not maps or claims.

Every allocator is a pure function of the problem: whoever holds the same snapshot computes the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.observation import observations
from hippomat_core.replaced import quickly_made, replace
from hippomat_core.wire.frames import UNREACHABLE


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """The common snapshot of a round, seen from robot `self_index`. N rows in id order, M task slots.

    A robot that was never heard has present = False and a row of unreachable costs. The row of a busy robot
    counts from the destination of its claim, the time until it is free included: when it could be at each
    task.
    """

    costs_q: NDArray[np.uint8]  # (N, M) quantised travel costs, 255 = unreachable
    available: NDArray[np.bool_]  # (N,) takes part: heard lately, holds no claim, can request
    busy: NDArray[np.bool_]  # (N,) holds a claim and can request once it is done
    waiting: NDArray[np.bool_]  # (M,) the newest generation of the slot has no live claim
    present: NDArray[np.bool_]  # (N,) a row is held
    assigned: NDArray[np.bool_]  # (N,) the row carries a claim
    ages_rounds: NDArray[np.float32]  # (N,) age of the row on our clock, in allocation rounds
    self_index: int
    round: int
    seed: int

    @property
    def eligible(self) -> NDArray[np.bool_]:
        """(N, M) bool: this robot may be given this task."""
        reachable = self.costs_q != UNREACHABLE
        eligible: NDArray[np.bool_] = reachable & self.available[:, None] & self.waiting[None, :]
        return eligible

    def observations(self) -> NDArray[np.float32]:
        """x_i of every row, (N, 1 + 2M) float32; rows that are not present are zero."""
        return observations(self.costs_q, self.assigned, self.waiting, self.present)


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """action: 0 = no request, j = task slot j - 1. logits: (M + 1,) or empty where there is no policy."""

    action: int
    logits: NDArray[np.float32]


NO_LOGITS: NDArray[np.float32] = np.zeros(0, np.float32)
NO_LOGITS.flags.writeable = False


class Allocator(Protocol):
    """Chooses the action of one robot from the common snapshot."""

    @property
    def name(self) -> str: ...

    def allocate(self, problem: Problem) -> Decision: ...

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        """(N,) what `allocate` says to each robot that holds this same snapshot."""
        ...


def actions_one_by_one(allocator: Allocator, problem: Problem) -> NDArray[np.int64]:
    """`Allocator.actions` of allocators whose robots each decide for themselves."""
    views = (replace(problem, self_index=robot) for robot in range(len(problem.available)))
    return np.array([allocator.allocate(view).action for view in views], np.int64)
