"""The baseline that ignores costs: robot i always takes slot i. No conflicts when N <= M, at random cost.

A policy judged by its conflicts alone may have learned just this: compare with it, and permute the slots.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.port import NO_LOGITS, Decision, Problem


class FixedSlot:
    """Slot i mod M; where that one is not eligible, the next after it that is, cyclically."""

    name = "fixed_slot"

    def allocate(self, problem: Problem) -> Decision:
        return Decision(int(self.actions(problem)[problem.self_index]), NO_LOGITS)

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        robots, tasks = problem.costs_q.shape
        slots = (np.arange(robots)[:, None] + np.arange(tasks)[None, :]) % tasks
        eligible = np.take_along_axis(problem.eligible, slots, axis=1)
        first = np.take_along_axis(slots, eligible.argmax(axis=1)[:, None], axis=1)[:, 0]
        return np.where(eligible.any(axis=1), first + 1, 0)
