"""One run of `hippomat-bench motion`: lifelong tasks on a map, and what came of it.

A robot gets a new goal, drawn evenly from the cells that nobody stands in or goes to, in the tick in which it
arrives. The bound is what a robot would do with nobody else around: drive without a pause. Seeded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import ConfigError
from hippomat_core.motion.graph import MotionGraph, motion_graph, moves_to
from hippomat_core.motion.parking import parking_goals, parking_spots
from hippomat_core.motion.planners import make_planner
from hippomat_core.motion.scene import ticks_of
from hippomat_sim.bench.motion_checker import Move, Verdict, judge
from hippomat_sim.bench.motion_fleet import MotionFleet
from hippomat_sim.bench.motion_maps import make_map
from hippomat_sim.bench.motion_settings import NAMES, MotionSettings

STUCK_TICKS = 200  # without a new goal and without having come nearer to the old one than ever before


@dataclass(frozen=True, slots=True, eq=False)
class MotionFigures:
    """Of one run. Ticks are those of the fastest common clock, see scene.ticks_of."""

    seed: int
    verdict: Verdict
    tasks: int
    stuck: int  # robots that were ever stuck
    of_bound: float  # ticks that all the driven ways take alone, over the robots' ticks
    plan_us: float  # per robot and tick
    trace: NDArray[np.int32]  # (T + 1, N) node where each robot's commitment ends
    goals: NDArray[np.int32]  # (N,) at the end
    free: NDArray[np.bool_]


class MotionRun:
    """Set up by the constructor, done by execute()."""

    def __init__(self, settings: MotionSettings, seed: int, told: Callable[[int], None]) -> None:
        self.settings, self.seed, self.told = settings, seed, told
        self.free = make_map(settings.map, seed, settings.uav)
        self.graph: MotionGraph = motion_graph(self.free, settings.diagonals)
        count = settings.agents
        if 3 * count > len(self.graph.cells):
            raise ConfigError(
                f"--agents {count}: the map has {len(self.graph.cells)} free cells, too few for so many"
            )
        self.rng = np.random.default_rng([seed, 0])
        self.air = np.random.default_rng([seed, 3])
        self.starts = self.rng.permutation(len(self.graph.cells))[:count].astype(np.int32)
        speeds = ticks_of(settings.speeds_mps)
        self.ticks = np.array([speeds[k % len(speeds)] for k in range(count)], np.int32)
        self.fleet = MotionFleet(
            self.graph, self.starts, self.ticks, lambda: make_planner(NAMES[settings.planner])
        )
        self.busy = np.arange(count) < count - settings.idle
        self.spots = parking_spots(self.graph)
        self.from_start = np.zeros(count, np.int64)  # moves from where it got its goal
        self.nearest = np.zeros(count, np.int64)  # moves to its goal, the fewest ever
        self.nearest_tick = np.zeros(count, np.int64)
        self.ever_stuck = np.zeros(count, np.bool_)
        self.moves: list[Move] = []
        self.tasks = 0
        self.driven = 0.0  # ticks that the completed ways take alone

    def execute(self) -> MotionFigures:
        """The figures of the run."""
        settings, fleet = self.settings, self.fleet
        for robot in np.flatnonzero(self.busy).tolist():
            self._new_goal(robot)
        count, trace = settings.agents, [self.starts.copy()]
        for tick in range(settings.steps):
            self._goals(tick)
            shape = (1 + settings.rounds, count, count)
            lost = self.air.random(shape) < settings.loss if settings.loss else np.zeros(shape, np.bool_)
            before = fleet.truth.nodes[:, 2].copy()
            begins = fleet.step(lost)
            for robot in np.flatnonzero(begins).tolist():
                tail, head = (self._cell(nodes[robot]) for nodes in (before, fleet.truth.nodes[:, 2]))
                self.moves.append(Move(robot, tick, tick + int(self.ticks[robot]), tail, head))
            trace.append(fleet.truth.nodes[:, 2].copy())
            if tick % 50 == 0:
                self.told(tick)
        verdict = judge(
            self.free,
            self.graph.cells[self.starts],
            self.moves,
            self.ticks.tolist(),
            settings.steps,
            settings.diagonals,
        )
        return MotionFigures(
            seed=self.seed,
            verdict=verdict,
            tasks=self.tasks,
            stuck=int(self.ever_stuck.sum()),
            of_bound=self._of_bound(),
            plan_us=1e6 * fleet.planning_s / (settings.steps * count),
            trace=np.array(trace),
            goals=fleet.wants.goal.copy(),
            free=self.free,
        )

    def _cell(self, node: int) -> tuple[int, int, int]:
        ix, iy, iz = self.graph.cells[node].tolist()
        return ix, iy, iz

    def _goals(self, tick: int) -> None:
        """Whoever has arrived gets a new goal; whoever idles, one where it is in nobody's way."""
        fleet, there = self.fleet, self.fleet.there
        node = fleet.truth.nodes[:, 2]
        arrived = there & self.busy & (node == fleet.wants.goal)
        for robot in np.flatnonzero(arrived).tolist():
            self.tasks += 1
            self.driven += float(self.from_start[robot] * self.ticks[robot])
            self._new_goal(robot)
        self._park()
        left = fleet.fields[fleet.wants.goal_field, node].astype(np.int64)
        nearer = arrived | (left < self.nearest)
        self.nearest[nearer] = left[nearer]
        self.nearest_tick[nearer] = tick
        self.ever_stuck |= self.busy & (tick - self.nearest_tick > STUCK_TICKS * self.ticks.max())

    def _new_goal(self, robot: int) -> None:
        fleet, node = self.fleet, self.fleet.truth.nodes[:, 2]
        taken = {*fleet.wants.goal.tolist(), *node.tolist()}
        goal = int(self.rng.integers(len(self.graph.cells)))
        while goal in taken:
            goal = int(self.rng.integers(len(self.graph.cells)))
        field = moves_to(self.graph, goal)
        fleet.send_to(robot, goal, field, fleet.tick)
        self.from_start[robot] = field[node[robot]]
        self.nearest[robot], self.nearest_tick[robot] = self.from_start[robot], fleet.tick

    def _park(self) -> None:
        fleet = self.fleet
        idle = np.flatnonzero(~self.busy)
        if not len(idle):
            return
        wanted = fleet.wants.goal[self.busy]
        node = fleet.truth.nodes[:, 2]
        spots = parking_goals(self.graph, self.spots, node[idle], fleet.wants.goal[idle], wanted)
        for robot, spot in zip(idle.tolist(), spots.tolist(), strict=True):
            if spot != fleet.wants.goal[robot]:
                fleet.send_to(robot, spot, moves_to(self.graph, spot), 1 << 30)

    def _of_bound(self) -> float:
        """Ways that were driven in part count by how much nearer the robot has come."""
        fleet = self.fleet
        left = fleet.fields[fleet.wants.goal_field, fleet.truth.nodes[:, 2]]
        part = ((self.from_start - left) * self.ticks)[self.busy].sum()
        return (self.driven + float(part)) / (int(self.busy.sum()) * self.settings.steps)
