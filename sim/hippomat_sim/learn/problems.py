"""Many allocation problems of one shape side by side: what environments give and networks take.

The same arrays as the core's Problem, with one more axis in front. Knows no world and no network.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hippomat_core.allocation.port import Problem


@dataclass(frozen=True, slots=True, eq=False)
class ProblemBatch:
    """B snapshots of N agents and M task slots. See Problem for what each array means."""

    costs_q: NDArray[np.uint8]  # (B, N, M)
    available: NDArray[np.bool_]  # (B, N)
    busy: NDArray[np.bool_]  # (B, N)
    waiting: NDArray[np.bool_]  # (B, M)
    present: NDArray[np.bool_]  # (B, N)
    assigned: NDArray[np.bool_]  # (B, N)
    ages_rounds: NDArray[np.float32]  # (B, N)

    def __len__(self) -> int:
        return len(self.costs_q)

    def problem(self, index: int, self_index: int = 0, round_number: int = 0, seed: int = 0) -> Problem:
        """One of them as the robots' allocators take it."""
        arrays = {field.name: getattr(self, field.name)[index] for field in fields(self)}
        return Problem(**arrays, self_index=self_index, round=round_number, seed=seed)

    def take(self, indices: ArrayLike) -> ProblemBatch:
        """The chosen ones, copied."""
        chosen = np.asarray(indices)
        return ProblemBatch(*(getattr(self, field.name)[chosen] for field in fields(self)))
