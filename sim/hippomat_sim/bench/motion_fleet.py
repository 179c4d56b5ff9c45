"""Robots that each plan from what they heard and commit what is safe: one tick of all of them.

The air is given: which of the frames are lost. Robots send in the order of their ids, several rounds a tick,
and decide just before they send. Counts nothing and judges nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.motion.commitment import Commitments, extend, may_extend, standing
from hippomat_core.motion.graph import MotionGraph, Ways
from hippomat_core.motion.scene import MotionPlanner, Plan, Scene, ways_of

FORGET_TICKS = 60
FIELDS_KEPT = 4  # of a robot's latest goals: a peer may not have heard of the newest


class Errands(NamedTuple):
    """What the robots want, as each knows it. Arrays (N,) of the truth or (N, N) [who knows, of whom]."""

    goal: NDArray[np.int32]
    goal_field: NDArray[np.int32]
    since: NDArray[np.int64]


class MotionFleet:
    """N robots on one graph."""

    def __init__(
        self,
        graph: MotionGraph,
        starts: NDArray[np.int32],
        ticks: NDArray[np.int32],
        make_planner: Callable[[], MotionPlanner],
    ):
        self.graph, self.ticks, self.tick = graph, ticks, 0
        count = len(starts)
        self.ways = ways_of(graph)
        self.truth = standing(starts, ticks)
        nodes, begins, _, heard, exact = (_for_each(part, count) for part in self.truth)
        self.known = Commitments(nodes, begins, ticks, heard, exact)
        self.fields = np.zeros((count * FIELDS_KEPT, len(graph.cells)), np.int32)
        fields = np.arange(count, dtype=np.int32) * FIELDS_KEPT
        self.wants = Errands(starts.copy(), fields, np.zeros(count, np.int64))
        goal, goal_field, since = (_for_each(part, count) for part in self.wants)
        self.heard_wants = Errands(goal, goal_field, since)
        self.planners: list[MotionPlanner] = [make_planner() for _ in range(count)]
        self.plans: list[Plan | None] = [None] * count
        self.planning_s = 0.0

    @property
    def there(self) -> NDArray[np.bool_]:
        """(N,) which robots stand where their commitment ends."""
        return self.truth.begins[:, 1] + self.ticks <= self.tick

    def send_to(self, robot: int, goal: int, field: NDArray[np.int32], since: int) -> None:
        """A new goal; the others hear of it with the robot's next frame that reaches them."""
        wants = self.wants
        turn = (int(wants.goal_field[robot]) + 1) % FIELDS_KEPT
        wants.goal[robot], wants.since[robot] = goal, since
        wants.goal_field[robot] = robot * FIELDS_KEPT + turn
        self.fields[wants.goal_field[robot]] = field

    def step(self, lost: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """One tick: a round of news, everyone plans, then rounds of deciding. (N,) whose move begins now.

        lost: (1 + R, N, N) [round, sender, receiver]
        """
        count = len(self.ticks)
        begins = np.zeros(count, np.bool_)
        stay = self.truth.nodes[:, 2].copy()
        self._rounds(stay, lost[:1], begins)
        wishes = self.truth.nodes[:, 2].copy()
        # With nothing lost all know the same, and equal scenes give equal plans: one stands for all.
        if lost.any():
            planning = np.flatnonzero(self.there)
        else:
            planning = np.arange(1)
        for robot in planning.tolist():
            scene = self._scene(robot)
            begun = time.thread_time()
            plan = self.planners[robot].plan(scene, self.plans[robot])
            self.planning_s += (time.thread_time() - begun) / len(planning)
            self.plans[robot] = plan
            if lost.any():
                wishes[robot] = plan.wish(robot, self.tick)
            else:
                wishes = plan.target[:, self.tick - plan.tick].copy()
        self._rounds(wishes, lost[1:], begins)
        self.tick += 1
        return begins

    def _rounds(self, wishes: NDArray[np.int32], lost: NDArray[np.bool_], begins: NDArray[np.bool_]) -> None:
        """In which robots decide, where they wish to be elsewhere, and send."""
        _exchange(
            self.ways,
            self.graph.cells,
            self.graph.diagonals,
            self.truth,
            self.known,
            self.wants,
            self.heard_wants,
            wishes,
            self.tick,
            FORGET_TICKS,
            lost,
            begins,
        )

    def _scene(self, robot: int) -> Scene:
        known, heard = self.known, self.heard_wants
        nodes, begins = known.nodes[robot], known.begins[robot]
        ready = np.maximum(begins[:, 1] + self.ticks - self.tick, 0).astype(np.int32)
        goal, row, since = (part[robot].copy() for part in (heard.goal, heard.goal_field, heard.since))
        goal[robot], row[robot], since[robot] = (
            self.wants.goal[robot],
            self.wants.goal_field[robot],
            self.wants.since[robot],
        )
        return Scene(
            tick=self.tick,
            graph=self.graph,
            node=nodes[:, 2].copy(),
            ready=ready,
            leaving=np.where(ready > 0, nodes[:, 1], nodes[:, 2]).astype(np.int32),
            ticks=self.ticks,
            goal=goal,
            goal_field=row,
            since=since,
            fields=self.fields,
        )


def _for_each(part: NDArray[Any], count: int) -> NDArray[Any]:
    """(count, N, ...): the same for everyone to begin with."""
    return np.repeat(part[None], count, axis=0)


@njit(cache=True, nogil=True)
def _exchange(
    ways: Ways,
    cells: NDArray[np.int32],
    diagonals: bool,
    truth: Commitments,
    known: Commitments,
    wants: Errands,
    heard_wants: Errands,
    wishes: NDArray[np.int32],
    now: int,
    forget: int,
    lost: NDArray[np.bool_],
    begins: NDArray[np.bool_],
) -> None:
    """Rounds of deciding and sending; fills begins (N,)."""
    for turn in range(lost.shape[0]):
        for robot in range(len(wishes)):
            view = Commitments(
                known.nodes[robot], known.begins[robot], known.ticks, known.heard[robot], known.exact[robot]
            )
            head = wishes[robot]
            moves = not begins[robot] and head != truth.nodes[robot, 2]
            if moves and may_extend(ways, cells, diagonals, view, robot, head, now, forget):
                extend(truth, robot, head, now)
                begins[robot] = True
            for peer in range(len(wishes)):
                if peer != robot and lost[turn, robot, peer]:
                    known.exact[peer, robot] = False
                    continue
                known.nodes[peer, robot] = truth.nodes[robot]
                known.begins[peer, robot] = truth.begins[robot]
                known.heard[peer, robot] = now
                known.exact[peer, robot] = True
                heard_wants.goal[peer, robot] = wants.goal[robot]
                heard_wants.goal_field[peer, robot] = wants.goal_field[robot]
                heard_wants.since[peer, robot] = wants.since[robot]
