"""Allocation by improved particle swarm optimisation with greedy decoding, IPSO-G (Kong et al. 2019,
"Multi-robot task allocation strategy based on particle swarm optimization and greedy algorithm").

A particle has one key in [0, 1] per robot; in the order of the keys each robot takes the cheapest task that
is left. Improved: the inertia falls from .9 to .5, and a share of the keys is drawn anew in every iteration.
Every robot runs a swarm of its own, seeded by (seed, round, id), and takes its part of the best it has found:
robots that found different assignments may ask for the same task. Knows costs, not maps.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.allocation.hungarian import units
from hippomat_core.allocation.port import NO_LOGITS, Decision, Problem, actions_one_by_one
from hippomat_core.allocation.pure_hash import pure_hash

_STREAM = 0x1950  # keeps these draws apart from what else is drawn from (seed, round, id)
_MISSING = 2**22  # a robot without a task costs more than all that have one: 64 x 254^2 < 2^22
_NOT_ELIGIBLE = np.iinfo(np.int64).max


@dataclass(frozen=True, slots=True)
class SwarmSettings:
    """The prototype's values, with which IPSO-G resembles the paper's."""

    particles: int = 10
    iterations: int = 10
    first_inertia: float = 0.9
    last_inertia: float = 0.5
    own_pull: float = 1.5  # c1, towards the best that the particle has seen
    swarm_pull: float = 1.5  # c2, towards the best that any particle has seen
    mutation: float = 0.05  # share of keys drawn anew per iteration


@njit(cache=True)
def _uniform(state: NDArray[np.uint64]) -> float:
    """The next number in [0, 1) of splitmix64 (Steele 2014). state: (1,), moved on."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    value = state[0]
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return float((value ^ (value >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53


@njit(cache=True)
def _decode(keys: NDArray[np.float64], costs: NDArray[np.int64], slots: NDArray[np.int64]) -> int:
    """The particle's total cost; slots (R,) is filled with column or -1. costs: (R, M)."""
    taken = np.zeros(costs.shape[1], np.bool_)
    total = 0
    for row in np.argsort(keys, kind="mergesort"):
        cheapest, slots[row] = _NOT_ELIGIBLE, -1
        for column in range(costs.shape[1]):
            if not taken[column] and costs[row, column] < cheapest:
                cheapest, slots[row] = costs[row, column], column
        if slots[row] >= 0:
            taken[slots[row]] = True
            total += cheapest
        else:
            total += _MISSING
    return total


@njit(cache=True)
def _move(
    keys: NDArray[np.float64],
    speeds: NDArray[np.float64],
    targets: tuple[NDArray[np.float64], NDArray[np.float64]],
    shares: NDArray[np.float64],
    state: NDArray[np.uint64],
) -> None:
    """One particle flies on, in place. Its arrays are (R,); targets: its own best keys and the swarm's best.

    shares: (4,) inertia, the two pulls, mutation.
    """
    for row in range(len(keys)):
        to_own = shares[1] * _uniform(state) * (targets[0][row] - keys[row])
        to_best = shares[2] * _uniform(state) * (targets[1][row] - keys[row])
        speeds[row] = shares[0] * speeds[row] + to_own + to_best
        keys[row] = min(max(keys[row] + speeds[row], 0.0), 1.0)
        if _uniform(state) < shares[3]:
            keys[row] = _uniform(state)


@njit(cache=True)
def _swarm(
    costs: NDArray[np.int64], state: NDArray[np.uint64], particles: int, schedule: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Slots (R,) of the best particle. costs: (R, M)  schedule: (iterations, 4), the shares of _move."""
    rows = costs.shape[0]
    slots, best_slots = np.empty(rows, np.int64), np.full(rows, -1, np.int64)
    keys, speeds = np.empty((particles, rows)), np.zeros((particles, rows))
    own_keys, own_totals = np.empty((particles, rows)), np.full(particles, _NOT_ELIGIBLE)
    best_keys, best_total = np.empty(rows), _NOT_ELIGIBLE
    for key in range(keys.size):
        keys.flat[key] = _uniform(state)
    for iteration in range(len(schedule) + 1):
        for particle in range(particles):
            total = _decode(keys[particle], costs, slots)
            if total < own_totals[particle]:
                own_totals[particle], own_keys[particle] = total, keys[particle]
            if total < best_total:
                best_total, best_keys[:], best_slots[:] = total, keys[particle], slots
        if iteration < len(schedule):
            for particle in range(particles):
                targets = (own_keys[particle], best_keys)
                _move(keys[particle], speeds[particle], targets, schedule[iteration], state)
    return best_slots


def swarm_assignment(
    costs_q: NDArray[np.uint8], eligible: NDArray[np.bool_], draw: int, settings: SwarmSettings
) -> NDArray[np.int64]:
    """Slot of every robot, -1 for none, by the swarm that the 64 bits of `draw` start. Both arrays (N, M)."""
    slots = np.full(len(costs_q), -1, np.int64)
    rows = np.flatnonzero(eligible.any(axis=1))
    if rows.size == 0:
        return slots
    costs = np.where(eligible[rows], units(costs_q[rows]), _NOT_ELIGIBLE)
    schedule = np.empty((settings.iterations, 4))
    schedule[:, 0] = np.linspace(settings.first_inertia, settings.last_inertia, settings.iterations)
    schedule[:, 1:] = settings.own_pull, settings.swarm_pull, settings.mutation
    slots[rows] = _swarm(costs, np.array([draw], np.uint64), settings.particles, schedule)
    return slots


@dataclass(frozen=True, slots=True)
class IpsoG:
    """Allocator `ipso_g`: the same answer on replay, another swarm for every robot."""

    settings: SwarmSettings = field(default_factory=SwarmSettings)

    @property
    def name(self) -> str:
        return "ipso_g"

    def allocate(self, problem: Problem) -> Decision:
        draw = pure_hash(_STREAM, problem.seed, problem.round, problem.self_index)
        slots = swarm_assignment(problem.costs_q, problem.eligible, draw, self.settings)
        return Decision(int(slots[problem.self_index]) + 1, NO_LOGITS)

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        return actions_one_by_one(self, problem)
