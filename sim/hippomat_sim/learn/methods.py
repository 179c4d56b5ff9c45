"""One interface over many problems for every way to allocate: allocators of the core, networks in torch.

Knows no method by name; method_registry.py does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.port import Allocator
from hippomat_sim.learn.problems import ProblemBatch

Actions = NDArray[np.int64]


class Method(Protocol):
    """seeds: (B,) of the problems' hashes; round_number counts the allocation rounds."""

    @property
    def fingerprint(self) -> str:
        """Hash of its weights; empty where there are none."""
        ...

    def actions(self, problems: ProblemBatch, seeds: Actions, round_number: int) -> Actions:
        """(B, N) 0 = no request, j = slot j - 1: every robot of a fleet that shares one snapshot."""
        ...

    def own_actions(self, views: ProblemBatch, selves: Actions, seeds: Actions, round_number: int) -> Actions:
        """(B,) what robot selves[b] does on its own view b."""
        ...


@dataclass(frozen=True, slots=True)
class AllocatorMethod:
    """A method that is an allocator of the core. alone: each robot has draws of its own."""

    allocator: Allocator
    fingerprint: str = ""
    alone: bool = False

    def actions(self, problems: ProblemBatch, seeds: Actions, round_number: int) -> Actions:
        decided = np.zeros(problems.available.shape, np.int64)
        for index in np.flatnonzero(problems.available.any(axis=1)):  # the others cannot ask
            decided[index] = self.allocator.actions(
                problems.problem(index, 0, round_number, int(seeds[index]))
            )
        return decided

    def own_actions(self, views: ProblemBatch, selves: Actions, seeds: Actions, round_number: int) -> Actions:
        if not self.alone and len(views) > 1:
            return _once_per_view(self, views, selves, seeds, round_number)
        decided = [
            self.allocator.allocate(
                views.problem(index, int(selves[index]), round_number, int(seeds[index]))
            ).action
            for index in range(len(views))
        ]
        return np.array(decided, np.int64)


@dataclass(frozen=True, slots=True)
class BatchMethod:
    """A method that decides on whole batches, such as a network in torch. decide: problems -> (B, N)."""

    decide: Callable[[ProblemBatch], Actions]
    fingerprint: str

    def actions(self, problems: ProblemBatch, seeds: Actions, round_number: int) -> Actions:  # noqa: ARG002
        return self.decide(problems)

    def own_actions(self, views: ProblemBatch, selves: Actions, seeds: Actions, round_number: int) -> Actions:
        return _once_per_view(self, views, selves, seeds, round_number)


def _once_per_view(
    method: Method, views: ProblemBatch, selves: Actions, seeds: Actions, round_number: int
) -> Actions:
    """Robots that hold the same view share the computation; with relays nearly all of a fleet do."""
    first, which = distinct(views)
    return method.actions(views.take(first), seeds[first], round_number)[which, selves]


def distinct(views: ProblemBatch) -> tuple[Actions, Actions]:
    """Indices of the distinct views (U,), and for every view which of those it is (B,)."""
    seen: dict[bytes, int] = {}
    first: list[int] = []
    which = np.empty(len(views), np.int64)
    arrays = [getattr(views, field.name) for field in fields(views)]
    for index in range(len(views)):
        key = b"".join(array[index].tobytes() for array in arrays)
        number = seen.setdefault(key, len(first))
        if number == len(first):
            first.append(index)
        which[index] = number
    return np.array(first, np.int64), which
