"""Sequential greedy allocation: the cheapest free pair first. Knows costs, not maps.

The result is the stable matching of the snapshot: no robot and task would both rather have each other.
Ties go to the smaller robot id, then to the smaller slot, as with claims.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.port import NO_LOGITS, Decision, Problem


def assign_greedily(costs_q: NDArray[np.uint8], eligible: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Slot of every robot, -1 for none. costs_q: (N, M) codes  eligible: (N, M)  returns: (N,)."""
    assignment = np.full(costs_q.shape[0], -1, np.int64)
    rows, columns = np.nonzero(eligible)
    taken: set[int] = set()
    for index in np.lexsort((columns, rows, costs_q[rows, columns])):
        row, column = int(rows[index]), int(columns[index])
        if assignment[row] < 0 and column not in taken:
            assignment[row] = column
            taken.add(column)
    return assignment


class Greedy:
    """Every robot computes the stable matching on the common snapshot and takes its own part."""

    name = "greedy"

    def allocate(self, problem: Problem) -> Decision:
        return Decision(int(self.actions(problem)[problem.self_index]), NO_LOGITS)

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        return assign_greedily(problem.costs_q, problem.eligible) + 1
