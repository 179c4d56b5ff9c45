"""Priority inheritance with backtracking (Okumura et al. 2019), one move at a time, for comparison.

Without the swap technique of later versions: two robots that meet in a dead end may wait for ever. Robots
that are still on a move keep to it. Knows what the Scene tells.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.motion.graph import UNREACHED, Ways, halfway
from hippomat_core.motion.scene import Fleet, Plan, Scene, fleet_of, ways_of
from hippomat_core.motion.window_kernels import line_of


class PibtPlanner:
    """Plans anew in every tick."""

    name = "pibt"

    def plan(self, scene: Scene, before: Plan | None) -> Plan:
        """See scene.MotionPlanner; of the plan before nothing is used."""
        del before
        fleet, target = fleet_of(scene), scene.node.copy()
        order = line_of(fleet.node, fleet.goal, fleet.since)
        standing = np.full(len(scene.graph.cells), -1, np.int32)
        _next_nodes(ways_of(scene.graph), fleet, order, target, standing)
        return Plan(scene.tick, target[:, None], scene.goal.copy())


@njit(cache=True, nogil=True)
def _next_nodes(
    ways: Ways, fleet: Fleet, order: NDArray[np.int32], target: NDArray[np.int32], standing: NDArray[np.int32]
) -> None:
    """Fill target (N,). standing: (K,) working memory, -1 everywhere."""
    count = len(order)
    taken = np.full(len(standing), -1, np.int32)  # who goes there
    chosen = np.zeros(count, np.bool_)
    for robot in range(count):
        standing[fleet.node[robot]] = robot
        standing[fleet.leaving[robot]] = robot
        if fleet.ready[robot] > 0:
            chosen[robot] = True
            taken[fleet.node[robot]] = robot
            if fleet.ready[robot] > 1:
                taken[fleet.leaving[robot]] = robot
    directions = ways.neighbours.shape[1]
    options = np.empty((count, directions + 1), np.int32)  # of each robot on the stack, best first
    number = np.zeros(count, np.int32)
    tried = np.zeros(count, np.int32)
    stack = np.empty(count + 1, np.int32)
    for leader in order:
        if chosen[leader]:
            continue
        stack[0] = leader
        depth = 1
        chosen[leader] = True
        number[leader] = _options(ways, fleet, leader, standing, options[leader])
        tried[leader] = 0
        while depth > 0:
            robot = stack[depth - 1]
            if tried[robot] == number[robot]:  # nothing is left: stay, and let whoever asked try elsewhere
                target[robot] = fleet.node[robot]
                taken[fleet.node[robot]] = robot
                depth -= 1
                continue
            head = options[robot, tried[robot]]
            tried[robot] += 1
            if taken[head] >= 0 or _crosses(ways, fleet, robot, head, target, chosen):
                continue
            target[robot] = head
            taken[head] = robot
            other = standing[head]
            if other < 0 or other == robot or chosen[other]:
                break  # everyone on the stack has got what he chose
            chosen[other] = True
            number[other] = _options(ways, fleet, other, standing, options[other])
            tried[other] = 0
            stack[depth] = other
            depth += 1


@njit(cache=True, nogil=True)
def _options(
    ways: Ways, fleet: Fleet, robot: int, standing: NDArray[np.int32], options: NDArray[np.int32]
) -> int:
    """The robot's own cell and its neighbours, nearest to the goal first, free ones first among equals."""
    node, field = fleet.node[robot], fleet.fields[fleet.goal_field[robot]]
    aimless = field[node] >= UNREACHED
    costs = np.empty(len(options), np.int64)
    count = 0
    for direction in range(-1, ways.neighbours.shape[1]):
        head = node if direction < 0 else ways.neighbours[node, direction]
        if head < 0:
            continue
        busy = head != node and standing[head] >= 0
        cost = (1 if head != node else 0) if aimless else field[head]
        cost = 2 * cost + (1 if busy else 0)
        at = count
        while at > 0 and costs[at - 1] > cost:
            costs[at], options[at] = costs[at - 1], options[at - 1]
            at -= 1
        costs[at], options[at] = cost, head
        count += 1
    return count


@njit(cache=True, nogil=True)
def _crosses(
    ways: Ways,
    fleet: Fleet,
    robot: int,
    head: int,
    target: NDArray[np.int32],
    chosen: NDArray[np.bool_],
) -> bool:
    """Whether a move that another has chosen already meets ours halfway: a swap, or crossing diagonals."""
    tail = fleet.node[robot]
    if head == tail:
        return False
    middle = halfway(ways, tail, head)
    for other in range(len(target)):
        if other == robot or not chosen[other]:
            continue
        left, reached = fleet.node[other], target[other]
        if fleet.ready[other] > 0:
            left, reached = fleet.leaving[other], fleet.node[other]
        if left != reached and halfway(ways, left, reached) == middle:
            return True
    return False
