"""Fleets on small drawn maps for the motion tests, and planners that wish for anything."""

from __future__ import annotations

import numpy as np

from hippomat_core.motion.graph import MotionGraph, motion_graph, moves_to
from hippomat_core.motion.planners import make_planner
from hippomat_core.motion.scene import Plan, Scene
from hippomat_sim.bench.motion_checker import Move, Verdict, judge
from hippomat_sim.bench.motion_fleet import MotionFleet


class Wanderer:
    """A planner for which every robot wants to be in a random cell next to it, or to stay."""

    name = "wanderer"

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def plan(self, scene: Scene, before: Plan | None) -> Plan:  # noqa: ARG002 - the port's
        options = np.column_stack([scene.graph.neighbours[scene.node], scene.node])
        picked = options[np.arange(len(options)), self.rng.integers(options.shape[1], size=len(options))]
        target = np.where(picked >= 0, picked, scene.node)
        return Plan(scene.tick, target[:, None].astype(np.int32), scene.goal)


def drawn(text: str) -> np.ndarray:
    """(1, H, W) True where the drawing has no '#'; the first line is y = 0."""
    return np.array([[[c != "#" for c in row] for row in text.strip("\n").splitlines()]])


class Lab:
    """A fleet whose every move is remembered and judged."""

    def __init__(
        self,
        free: np.ndarray,
        starts: list[tuple[int, int]] | np.ndarray,
        planner="window",
        ticks: list[int] | None = None,
        loss: float = 0.0,
        seed: int = 0,
        diagonals: bool = False,
    ) -> None:
        self.free, self.diagonals, self.loss = free, diagonals, loss
        self.graph: MotionGraph = motion_graph(free, diagonals)
        if not isinstance(starts, np.ndarray):
            starts = np.array([self.graph.node(*cell) for cell in starts], np.int32)
        self.starts, self.air = starts, np.random.default_rng(seed)
        self.ticks = np.array(ticks or [1] * len(starts), np.int32)
        make = (lambda: make_planner(planner)) if isinstance(planner, str) else planner
        self.fleet = MotionFleet(self.graph, starts, self.ticks, make)
        self.moves: list[Move] = []

    def send(self, robot: int, cell: tuple[int, int] | int) -> None:
        node = cell if isinstance(cell, int) else self.graph.node(*cell)
        self.fleet.send_to(robot, node, moves_to(self.graph, node), self.fleet.tick)

    def step(self, rounds: int = 3) -> None:
        count, tick = len(self.ticks), self.fleet.tick
        tails = self.fleet.truth.nodes[:, 2].copy()
        lost = self.air.random((1 + rounds, count, count)) < self.loss
        for robot in np.flatnonzero(self.fleet.step(lost)).tolist():
            cells = [tuple(self.graph.cells[n].tolist()) for n in (tails[robot], self.node(robot))]
            self.moves.append(Move(robot, tick, tick + int(self.ticks[robot]), *cells))

    def node(self, robot: int) -> int:
        return int(self.fleet.truth.nodes[robot, 2])

    def at_goal(self) -> list[bool]:
        return [self.node(k) == int(goal) for k, goal in enumerate(self.fleet.wants.goal)]

    def run(self, ticks: int) -> bool:
        """Until all are at their goals; whether they are."""
        for _ in range(ticks):
            if all(self.at_goal()):
                return True
            self.step()
        return all(self.at_goal())

    def verdict(self) -> Verdict:
        starts = self.graph.cells[self.starts]
        ticks = self.ticks.tolist()
        return judge(self.free, starts, self.moves, ticks, self.fleet.tick, self.diagonals)
