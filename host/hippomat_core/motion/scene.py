"""What one robot knows when it plans for the whole fleet, and what comes out. Decides nothing.

Time is counted in ticks: a move of robot i takes ticks[i] of them, so that fleets of mixed speeds are planned
as exactly as equal ones (ticks_of()). All arrays are over the N robots that are known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import ConfigError
from hippomat_core.motion.graph import MotionGraph, Ways

MAX_TICKS = 32  # a move; more and windows get too long to search


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Robots that have committed themselves up to `node`, which each reaches `ready` ticks after `tick`."""

    tick: int  # the earliest at which a move planned now can begin
    graph: MotionGraph
    node: NDArray[np.int32]  # (N,) where each robot's commitment ends
    ready: NDArray[np.int32]  # (N,) [ticks], 0: it stands there
    leaving: NDArray[np.int32]  # (N,) node that it leaves meanwhile; == node where it stands
    ticks: NDArray[np.int32]  # (N,) of one move
    goal: NDArray[np.int32]  # (N,) node; its own where it wants nothing
    goal_field: NDArray[np.int32]  # (N,) row of `fields`
    since: NDArray[np.int64]  # (N,) tick at which it got its goal: who has waited longest goes first
    fields: NDArray[np.int32]  # (F, K) moves to a goal


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Where every robot goes next: equal scenes give equal plans, on every robot."""

    tick: int
    target: NDArray[np.int32]  # (N, W) node that a robot is at, or moves to, in each tick from `tick`
    goal: NDArray[np.int32]  # (N,) that it was made for

    def wish(self, robot: int, tick: int) -> int:
        """The node that the robot should be at, or on the way to, in this tick."""
        return int(self.target[robot, tick - self.tick])


class MotionPlanner(Protocol):
    """Plans for all; the safe rule of commitment.py decides what a robot may really do of it."""

    name: str

    def plan(self, scene: Scene, before: Plan | None) -> Plan:
        """before: the same robots' plan of the tick before, None at first; kept where it still holds."""
        ...


class Fleet(NamedTuple):
    """A Scene's arrays for the compiled part."""

    node: NDArray[np.int32]
    ready: NDArray[np.int32]
    leaving: NDArray[np.int32]
    ticks: NDArray[np.int32]
    goal: NDArray[np.int32]
    goal_field: NDArray[np.int32]
    since: NDArray[np.int64]
    fields: NDArray[np.int32]


def ways_of(graph: MotionGraph) -> Ways:
    """For the compiled part."""
    return Ways(graph.neighbours, graph.middles, graph.beside, graph.places, graph.place_count)


def fleet_of(scene: Scene) -> Fleet:
    """For the compiled part."""
    return Fleet(
        scene.node,
        scene.ready,
        scene.leaving,
        scene.ticks,
        scene.goal,
        scene.goal_field,
        scene.since,
        scene.fields,
    )


def ticks_of(speeds_mps: Sequence[float]) -> tuple[int, ...]:
    """Ticks of a move at each speed, the smallest whole numbers in the right ratios: 5 and 3 for 3 and 5 m/s.

    ConfigError where one exceeds MAX_TICKS.
    """
    periods = [1 / Fraction(str(speed)) for speed in speeds_mps]
    scale = math.lcm(*(period.denominator for period in periods))
    ticks = [int(period * scale) for period in periods]
    divisor = math.gcd(*ticks)
    ticks = [tick // divisor for tick in ticks]
    if max(ticks) > MAX_TICKS:
        raise ConfigError(
            f"speeds {', '.join(f'{speed:g}' for speed in speeds_mps)} have no common tick of which a move "
            f"takes at most {MAX_TICKS}: round them (3,5 or 0.2,0.3)"
        )
    return tuple(ticks)
