"""The paper's scheme, for comparison: drive the shortest way, wait where it is blocked, then go round.

After three blockages a robot plans again around the cells where the others stand, and goes on waiting where
no way is left. Nobody is ever asked to give way. Knows what the Scene tells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.motion.graph import UNREACHED
from hippomat_core.motion.scene import Plan, Scene

BLOCKAGES = 3  # the paper's threshold
_LONGEST = 512  # cells of a route; the rest of a longer one is planned when these are driven


@dataclass(frozen=True, slots=True, eq=False)
class RoutePlan(Plan):
    """A plan with everyone's route."""

    route: NDArray[np.int32]  # (N, L) nodes from where it was planned, -1 after the goal
    place: NDArray[np.int32]  # (N,) index of the robot's own node in its route
    blocked: NDArray[np.int32]  # (N,) ticks that its move was refused


class WaitAndReplanPlanner:
    """One move at a time along a route that is kept until it is driven, blocked or void."""

    name = "replan"

    def plan(self, scene: Scene, before: Plan | None) -> Plan:
        """See scene.MotionPlanner."""
        count, longest = len(scene.node), min(len(scene.graph.cells), _LONGEST)
        same = isinstance(before, RoutePlan) and len(before.goal) == count
        if same:
            assert isinstance(before, RoutePlan)
            route, place, blocked = before.route.copy(), before.place.copy(), before.blocked.copy()
            stale = before.goal != scene.goal
        else:
            route = np.full((count, longest), -1, np.int32)
            place, blocked = np.zeros(count, np.int32), np.zeros(count, np.int32)
            stale = np.ones(count, np.bool_)
        target = scene.node.copy()
        _advance(
            scene.graph.neighbours,
            scene.node,
            scene.leaving,
            scene.ready,
            scene.goal,
            scene.goal_field,
            scene.fields,
            stale,
            route,
            place,
            blocked,
            target,
        )
        return RoutePlan(scene.tick, target[:, None], scene.goal.copy(), route, place, blocked)


@njit(cache=True, nogil=True)
def _advance(
    neighbours: NDArray[np.int32],
    node: NDArray[np.int32],
    leaving: NDArray[np.int32],
    ready: NDArray[np.int32],
    goal: NDArray[np.int32],
    goal_field: NDArray[np.int32],
    fields: NDArray[np.int32],
    stale: NDArray[np.bool_],
    route: NDArray[np.int32],
    place: NDArray[np.int32],
    blocked: NDArray[np.int32],
    target: NDArray[np.int32],
) -> None:
    """Everyone's next node, with routes and counts brought up to date."""
    for robot in range(len(node)):
        if ready[robot] > 0:
            continue
        field = fields[goal_field[robot]]
        at = place[robot]
        if not stale[robot] and route[robot, at] != node[robot]:
            at += 1
            stale[robot] = at >= route.shape[1] - 1 or route[robot, at] != node[robot]
            place[robot] = at
            blocked[robot] = 0
        elif not stale[robot]:
            blocked[robot] += 1
        if stale[robot]:
            _down(neighbours, field, node[robot], route[robot])
            place[robot] = blocked[robot] = 0
        if goal[robot] == node[robot]:
            continue
        if blocked[robot] >= BLOCKAGES:
            blocked[robot] = 0
            if _around(neighbours, robot, node, leaving, goal[robot], route[robot]):
                place[robot] = 0
        at = place[robot]
        if at + 1 < route.shape[1] and route[robot, at + 1] >= 0:
            target[robot] = route[robot, at + 1]


@njit(cache=True, nogil=True)
def _down(
    neighbours: NDArray[np.int32], field: NDArray[np.int32], node: int, route: NDArray[np.int32]
) -> None:
    """Write a shortest way down the field."""
    route[:] = -1
    route[0] = node
    count = 1
    while 0 < field[node] < UNREACHED and count < len(route):
        for direction in range(neighbours.shape[1]):
            other = neighbours[node, direction]
            if other >= 0 and field[other] < field[node]:
                node = other
                break
        route[count] = node
        count += 1


@njit(cache=True, nogil=True)
def _around(
    neighbours: NDArray[np.int32],
    robot: int,
    node: NDArray[np.int32],
    leaving: NDArray[np.int32],
    goal: int,
    route: NDArray[np.int32],
) -> bool:
    """Write a shortest way around where the others are. False, and nothing changes, if there is none."""
    count = len(neighbours)
    away = np.full(count, -1, np.int32)
    for other in range(len(node)):
        if other != robot:
            away[node[other]] = away[leaving[other]] = UNREACHED
    if away[goal] == UNREACHED:
        return False
    queue = np.empty(count, np.int32)
    queue[0] = goal
    away[goal] = 0
    begin, end = 0, 1
    while begin < end and away[node[robot]] < 0:
        here = queue[begin]
        begin += 1
        for direction in range(neighbours.shape[1]):
            other = neighbours[here, direction]
            if other >= 0 and away[other] < 0:
                away[other] = away[here] + 1
                queue[end] = other
                end += 1
    if away[node[robot]] < 0:
        return False
    for other in range(count):
        if away[other] < 0:
            away[other] = UNREACHED
    _down(neighbours, away, node[robot], route)
    return True
