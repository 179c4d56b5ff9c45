"""The random baseline: request any task that waits and can be reached. A pure hash, no generator."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.port import NO_LOGITS, Decision, Problem, actions_one_by_one
from hippomat_core.allocation.pure_hash import hash_below


class RandomRequest:
    """Action from the hash of (seed, round, id): the same again on replay, different for every robot."""

    name = "random"

    def allocate(self, problem: Problem) -> Decision:
        choices = np.flatnonzero(problem.eligible[problem.self_index])
        if choices.size == 0:
            return Decision(0, NO_LOGITS)
        pick = hash_below(choices.size, problem.seed, problem.round, problem.self_index)
        return Decision(int(choices[pick]) + 1, NO_LOGITS)

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        return actions_one_by_one(self, problem)
