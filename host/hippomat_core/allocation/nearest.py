"""The baseline without neighbours: a robot asks for its own cheapest task, whoever else wants it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.port import NO_LOGITS, Decision, Problem
from hippomat_core.wire.frames import UNREACHABLE


class Nearest:
    """Reads one row of the snapshot. Of tasks that cost the same the smallest slot."""

    name = "nearest"

    def allocate(self, problem: Problem) -> Decision:
        return Decision(int(self.actions(problem)[problem.self_index]), NO_LOGITS)

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        eligible = problem.eligible
        cheapest = np.where(eligible, problem.costs_q, UNREACHABLE).argmin(axis=1)
        return np.where(eligible.any(axis=1), cheapest + 1, 0)
