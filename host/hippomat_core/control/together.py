"""Drive only where the whole fleet agreed: the planner's next moves, committed one at a time, each in turn.

Every robot plans for all of them on the lattice from what they broadcast (where each has committed itself to
go, and its destination), takes its own next move of that plan, and commits it if that is safe whatever the
others have not told yet. The commitment is the path that it drives and the intent that it broadcasts; it is
made longer at its end, or dropped behind the robot, and no two ever come within keep_out of each other:

- Robots decide in turn: robot k in the rounds r with r mod 2N = 2k + 1. A decision is in the STATE that is
  sent two rounds on, so that whoever decides next can have heard it.
- A peer that was not heard since its last turn may have committed one more leg, of up to LEG_M: its whole
  surroundings count as taken (the rule of motion/commitment.py, in metres and without times).
- No times are promised: what a robot has committed stays taken until it is heard to have left. Late robots
  delay others and endanger nobody.

Decides paths, never velocities; the reservation of discs around the peers and the guard stay in force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hippomat_core.control.nav_state import Navigator, NewPath, View
from hippomat_core.motion.graph import UNREACHED, MotionGraph, moves_to
from hippomat_core.motion.lattice import NOWHERE, Lattice
from hippomat_core.motion.planners import make_planner
from hippomat_core.motion.scene import Scene
from hippomat_core.planning.astar import Path, path_length_m, shortest_path
from hippomat_core.planning.costmap import nearest_free
from hippomat_core.planning.reservations import PeerMotion, Positions, committed, free_stretch, keep_out_m
from hippomat_core.wire.frames import MAX_INTENT_STEPS

LEG_M = 0.55  # no commitment grows by more at once
FORGET_S = 10.0  # a peer silent for so long stands where it was last heard to go, or is far away


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """What deciding together needs besides the View."""

    lattice: Lattice
    round: int  # the last that ended
    may_start: bool  # motion/commitment.py: all that we hear have heard us, or we are alone

    def turn(self, robot: int, size: int) -> bool:
        """Whether this robot of so many decides now."""
        return self.round >= 0 and self.round % (2 * size) == 2 * robot + 1

    def missed_turns(self, robot: int, size: int, told: int) -> int:
        """How often a peer may have decided after round `told`, the last that its frame can tell of."""
        first, last = told + 1, self.round
        if first > last:
            return 0
        return (last - 2 * robot - 1) // (2 * size) - (first - 1 - 2 * robot - 1) // (2 * size)


def choose_together(nav: Navigator, view: View, together: Together) -> tuple[Navigator, NewPath | None]:
    """Make the committed path longer where it is our turn and the way is free."""
    if not (nav.heard or together.may_start):
        return nav, None
    nav = replace(nav, heard=True)
    if not together.turn(view.config.robot.id, view.config.fleet.size):
        return nav, None
    path = _committed(nav, view)
    leg = _next_leg(nav, view, together, path)
    if leg is None or len(leg) < 2 or len(path) + len(leg) - 2 > MAX_INTENT_STEPS:
        return nav, None
    if not _granted(view, together, leg):
        return nav, None
    whole = np.concatenate([path, leg[1:]]).astype(np.int32)
    longer = replace(nav.without_path(), path=whole, cursor=0)
    return longer, NewPath(whole, path_length_m(whole, view.resolution_m), "new")


def _committed(nav: Navigator, view: View) -> Path:
    """The rest of the path, or the cell that we are in."""
    return np.array([view.cell], np.int32) if nav.path is None else nav.path[nav.cursor :]


def _granted(view: View, together: Together, leg: Path) -> bool:
    """Whether the leg stays clear of all that any peer can have committed itself to."""
    size = view.config.fleet.size
    points: Positions = view.costmap.centres(leg)
    start = (float(points[0, 0]), float(points[0, 1]))
    reach_m = [LEG_M * _legs_untold(peer, together, size) for peer in view.peers]
    taken = committed(view.peers, reach_m, view.costmap.grid, start, view.config)
    count, _ = free_stretch(taken, points[1:], np.zeros(len(points) - 1), 0.0)
    return count == len(points) - 1


def _legs_untold(peer: PeerMotion, together: Together, size: int) -> int:
    """By how many legs a peer's commitment may be longer than what was heard of it."""
    if peer.age_s > FORGET_S:
        return 0
    missed = together.missed_turns(peer.robot, size, peer.told_round)
    return missed if peer.promises else max(missed, 1)


def _next_leg(nav: Navigator, view: View, together: Together, path: Path) -> Path | None:
    """From the end of the committed path to the next node of the plan, or to the destination itself."""
    lattice, costmap = together.lattice, view.costmap
    end = (int(path[-1, 0]), int(path[-1, 1]))
    goal = None if nav.destination is None or nav.arrived else nearest_free(costmap, *nav.destination)
    own = int(lattice.near[end[1], end[0]])
    if own == NOWHERE:
        return _cut(shortest_path(costmap, end, goal) if goal is not None else None, view)
    wish = _wish(view, together, end, goal)
    if wish != own:
        return shortest_path(costmap, end, _cell(lattice, wish))
    if goal is not None and lattice.near[goal[1], goal[0]] in (own, NOWHERE):
        return _cut(shortest_path(costmap, end, goal), view)
    if nav.destination is None:
        return shortest_path(costmap, end, _cell(lattice, own))  # out of the way of the nodes around
    return None


def _cell(lattice: Lattice, node: int) -> tuple[int, int]:
    return int(lattice.centre[node, 0]), int(lattice.centre[node, 1])


def _cut(path: Path | None, view: View) -> Path | None:
    """No longer than a leg may be."""
    if path is None:
        return None
    longest = int(LEG_M / (math.sqrt(2.0) * view.resolution_m))
    return path[: longest + 1]


def _wish(view: View, together: Together, end: tuple[int, int], goal: tuple[int, int] | None) -> int:
    """The node that the plan for all sends us to next; our own to stay."""
    lattice, costmap = together.lattice, view.costmap
    ends, goals, robots = [end], [goal], [view.config.robot.id]
    for peer in view.peers:
        ends.append((int(peer.intent[-1, 0]), int(peer.intent[-1, 1])))
        goals.append(None if peer.destination is None else nearest_free(costmap, *peer.destination))
        robots.append(peer.robot)
    known = [k for k, cell in enumerate(ends) if costmap.is_free(cell) and _node(lattice, cell) >= 0]
    known.sort(key=lambda k: robots[k])
    node = np.array([_node(lattice, ends[k]) for k in known], np.int32)
    goal_node = node.copy()
    for place, k in enumerate(known):
        cell = goals[k]
        if cell is not None and _node(lattice, cell) >= 0:
            goal_node[place] = _node(lattice, cell)
    graph = _without(lattice, _closed(view, together, [ends[k] for k in known], node, goal_node))
    plan = make_planner(view.config.planning.planner).plan(_scene(graph, node, goal_node), None)
    return plan.wish(known.index(0), 0)


def _node(lattice: Lattice, cell: tuple[int, int]) -> int:
    return int(lattice.near[cell[1], cell[0]])


def _scene(graph: MotionGraph, node: NDArray[np.int32], goal: NDArray[np.int32]) -> Scene:
    count = len(node)
    fields = np.array([moves_to(graph, int(one)) for one in goal])
    reachable = fields[np.arange(count), node] < UNREACHED
    goal = np.where(reachable, goal, node).astype(np.int32)
    still, rows = np.zeros(count, np.int32), np.arange(count, dtype=np.int32)
    ticks, since = np.ones(count, np.int32), np.zeros(count, np.int64)
    return Scene(0, graph, node, still, node.copy(), ticks, goal, rows, since, fields)


def _closed(
    view: View,
    together: Together,
    ends: list[tuple[int, int]],
    node: NDArray[np.int32],
    goal: NDArray[np.int32],
) -> NDArray[np.bool_]:
    """(K,) nodes that nobody can pass: too near to where a robot ends beside its node, or to an obstacle."""
    lattice, resolution_m = together.lattice, view.resolution_m
    out_cells = keep_out_m(view.config) / resolution_m
    closed = np.zeros(len(lattice.centre), np.bool_)
    for x, y in ends:
        closed |= np.hypot(lattice.centre[:, 0] - x, lattice.centre[:, 1] - y) < out_cells
    centres = view.costmap.centres(lattice.centre)
    closed[node] = closed[goal] = False
    for x_m, y_m in view.marks:
        closed |= np.hypot(centres[:, 0] - x_m, centres[:, 1] - y_m) < out_cells * resolution_m / 2
    closed[node] = False
    return closed


def _without(lattice: Lattice, closed: NDArray[np.bool_]) -> MotionGraph:
    graph = lattice.graph
    blocked = closed[graph.neighbours] | closed[:, None] | (graph.neighbours < 0)
    return replace(graph, neighbours=np.where(blocked, NOWHERE, graph.neighbours).astype(np.int32))
