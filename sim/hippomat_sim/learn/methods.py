"""Every way to allocate that the tables compare, by name, behind one interface over many problems.

A method that needs weights which are not there raises NotTrained with the command that makes them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.auction import auction
from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.port import Allocator, Problem
from hippomat_core.errors import HippomatError
from hippomat_sim.learn.problems import ProblemBatch

Actions = NDArray[np.int64]


class NotTrained(HippomatError):
    """Weights that a method needs are missing; the message names the command that trains them."""


@dataclass(frozen=True, slots=True)
class Fleet:
    """What a method is asked to work for. turnover: as EnvSettings has it."""

    agents: int
    tasks: int
    turnover: str


@dataclass(frozen=True, slots=True)
class Sources:
    """Where weights come from. policy: ours instead of the packaged one. runs: directory of training runs."""

    runs: Path
    policy: Path | None = None


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


def _one_message(_problem: Problem) -> int:
    """The robot's row of costs."""
    return 1


def _bids(problem: Problem) -> int:
    """An auction's robots share bids instead of rows, once in every round of it."""
    return auction(problem.costs_q, problem.eligible).rounds


@dataclass(frozen=True, slots=True)
class MethodSpec:
    """How a method is called, built and measured."""

    label: str
    make: Callable[[Fleet, Sources], Method]
    share: float = 1.0  # of the usual number of instances: slow methods get fewer, the first ones
    any_size: bool = True  # works for fleets that it was not trained for
    one_shot: bool = True  # is measured in one-shot problems too
    paper: str = ""  # what the paper's tables call it
    messages: Callable[[Problem], int] = _one_message  # that each robot sends for one decision


def _core(name: str, alone: bool = False) -> Callable[[Fleet, Sources], Method]:
    def make(fleet: Fleet, _sources: Sources) -> Method:
        return AllocatorMethod(make_allocator(name, None, fleet.agents, fleet.tasks), alone=alone)

    return make


METHODS: dict[str, MethodSpec] = {
    "hungarian": MethodSpec("Hungarian", _core("hungarian"), paper="Hungarian"),
    "look_ahead": MethodSpec("look-ahead Hungarian", _core("look_ahead"), one_shot=False),
    "greedy": MethodSpec("sequential greedy", _core("greedy")),
    "auction": MethodSpec("auction", _core("auction"), messages=_bids),
    "ipso_g": MethodSpec("IPSO-G", _core("ipso_g", alone=True), share=0.1, paper="IPSO-G"),
    "nearest": MethodSpec("nearest", _core("nearest")),
    "random": MethodSpec("random", _core("random", alone=True), paper="Random"),
    "fixed_slot": MethodSpec("fixed slot", _core("fixed_slot")),
}


def make_method(name: str, fleet: Fleet, sources: Sources) -> Method:
    """The method called `name` for this fleet; NotTrained, or ConfigError for weights of another shape."""
    return METHODS[name].make(fleet, sources)
