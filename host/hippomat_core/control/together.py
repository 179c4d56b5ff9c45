"""Drive only where the whole fleet agreed: the planner's next moves, committed one at a time, each in turn.

Every robot plans for all of them on the lattice from what they broadcast (where each has committed itself to
go, and its destination), takes its own next move of that plan, and commits it if that is safe whatever the
others have not told yet. The commitment is the path that it drives and the intent that it broadcasts; it is
made longer at its end, or dropped behind the robot, and no two ever come within keep_out of each other:

- Robots decide in turn, in odd rounds: of those that are near each other, the one whose id comes next,
  counted from (r // 2) mod N. A decision is in the STATE that is sent two rounds on, so that whoever decides
  next can have heard it. Robots too far apart to meet, whatever both of them commit, need no turns.
- A peer that was not heard since it can have had a turn may have committed all that a STATE can tell of, in
  any direction: that counts as taken (the rule of motion/commitment.py, in metres and without times).
- No times are promised: what a robot has committed stays taken until it is heard to have left. Late robots
  delay others and endanger nobody.

Decides paths, never velocities; the reservation of discs around the peers and the guard stay in force.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

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
from hippomat_core.replaced import replace
from hippomat_core.wire.frames import MAX_INTENT_STEPS

NEWS_S = 1.0  # at most until a decision of a robot that is still far is heard
CLAIM_ROUNDS = 1 << 16  # a claim's round is told in 16 bits
FORGET_S = 10.0  # a peer silent for so long stands where it was last heard to go, or is far away


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """What deciding together needs besides the View."""

    lattice: Lattice
    round: int  # the last that ended
    claim_round: int  # of our claim: whoever has had its own longest goes first
    may_start: bool  # motion/commitment.py: all that we hear have heard us, or we are alone

    def turn(self, robot: int, near: Iterable[int], size: int) -> bool:
        """Whether this robot decides now, among those near it, in a fleet of so many."""
        return self._turn_of(self.round, robot, near, size)

    def missed_turns(self, peer: int, robot: int, size: int, told: int) -> int:
        """How often a peer near us may have decided after round `told`, the last that its frame tells of."""
        rounds = range(max(told + 1, self.round - 4 * size), self.round)
        return sum(self._turn_of(number, peer, (robot,), size) for number in rounds)

    @staticmethod
    def _turn_of(number: int, robot: int, others: Iterable[int], size: int) -> bool:
        if number < 0 or number % 2 == 0:
            return False
        first = number // 2
        return all((robot - first) % size < (other - first) % size for other in others)


def choose_together(nav: Navigator, view: View, together: Together) -> tuple[Navigator, NewPath | None]:
    """Make the committed path longer where it is our turn and the way is free."""
    if not (nav.heard or together.may_start):
        return nav, None
    nav = replace(nav, heard=True)
    if not together.turn(view.config.robot.id, _near(view), view.config.fleet.size):
        return nav, None
    path = _committed(nav, view)
    longest = MAX_INTENT_STEPS + 2 - len(path)  # a STATE tells of all that is committed
    for leg in _legs(nav, view, together, path):
        fits = 2 <= len(leg) <= longest and not _turns_back(path, leg)
        if fits and _granted(view, together, leg):
            return _longer(nav, view, path, leg)
    return nav, None


def _longer(nav: Navigator, view: View, path: Path, leg: Path) -> tuple[Navigator, NewPath]:
    whole = np.concatenate([path, leg[1:]]).astype(np.int32)
    longer = replace(nav.without_path(), path=whole, cursor=0)
    return longer, NewPath(whole, path_length_m(whole, view.resolution_m), "new")


def _committed(nav: Navigator, view: View) -> Path:
    """The rest of the path, or the cell that we are in."""
    return np.array([view.cell], np.int32) if nav.path is None else nav.path[nav.cursor :]


def _turns_back(path: Path, leg: Path) -> bool:
    """Whether the leg comes back to where the path leads: the follower could not tell which way to go."""
    apart = np.abs(path[:-1, None] - leg[None, 2:]).max(axis=2)
    return bool((apart <= 1).any())


def _granted(view: View, together: Together, leg: Path) -> bool:
    """Whether the leg stays clear of all that any peer can have committed itself to."""
    points: Positions = view.costmap.centres(leg)
    start = (float(points[0, 0]), float(points[0, 1]))
    near = _near(view)
    reach_m = [_untold_m(peer, view, together) if peer.robot in near else 0.0 for peer in view.peers]
    taken = committed(view.peers, reach_m, view.costmap.grid, start, view.config)
    for_ever_s = np.full(len(points) - 1, np.inf)
    count, _ = free_stretch(taken, points[1:], for_ever_s, 0.0)
    return count == len(points) - 1


def _near(view: View) -> set[int]:
    """Peers that may come near what we commit: by where they were heard, and how far they can have driven."""
    speed_mps, motion = view.config.limits.speed_mps, view.motion
    far_m = 2.0 * (_longest_m(view) + speed_mps * NEWS_S) + keep_out_m(view.config)
    return {
        peer.robot
        for peer in view.peers
        if math.hypot(peer.x_m - motion.x_m, peer.y_m - motion.y_m)
        <= far_m + speed_mps * min(peer.age_s, FORGET_S)
    }


def _untold_m(peer: PeerMotion, view: View, together: Together) -> float:
    """By how much a peer's commitment may be longer than what was heard of it."""
    if peer.age_s > FORGET_S:
        return 0.0
    size, robot = view.config.fleet.size, view.config.robot.id
    missed = together.missed_turns(peer.robot, robot, size, peer.told_round)
    return _longest_m(view) if missed or not peer.promises else 0.0


def _longest_m(view: View) -> float:
    """A whole commitment, all of it diagonal."""
    return math.sqrt(2.0) * MAX_INTENT_STEPS * view.resolution_m


def _legs(nav: Navigator, view: View, together: Together, path: Path) -> Iterator[Path]:
    """From the end of what is committed, best first: to the destination, or to the next node of the plan."""
    lattice, costmap = together.lattice, view.costmap
    end = (int(path[-1, 0]), int(path[-1, 1]))
    goal = None if nav.destination is None or nav.arrived else nearest_free(costmap, *nav.destination)
    own = int(lattice.near[end[1], end[0]])
    wish, then = (own, own) if own == NOWHERE else _wish(view, together, end, goal)
    if goal is not None and int(lattice.near[goal[1], goal[0]]) in (own, wish, then, NOWHERE):
        leg = shortest_path(costmap, end, goal)
        if leg is not None and (own == wish or _is_leg(leg)):
            yield leg[: MAX_INTENT_STEPS + 1]
    if own == NOWHERE:
        return
    # From beside the nodes as far as one leg goes. Whoever wants nothing stands on a node, out of the way.
    beside = end != _cell(lattice, own)
    nodes = (then, wish, own) if beside and wish != own else (wish,) if wish != own else ()
    if beside and wish == own and nav.destination is None:
        nodes = (own,)
    for node in nodes:
        leg = shortest_path(costmap, end, _cell(lattice, node))
        if leg is not None and (not beside or _is_leg(leg)):
            yield leg


def _is_leg(path: Path) -> bool:
    return len(path) <= MAX_INTENT_STEPS + 1


def _cell(lattice: Lattice, node: int) -> tuple[int, int]:
    return int(lattice.centre[node, 0]), int(lattice.centre[node, 1])


def _wish(
    view: View, together: Together, end: tuple[int, int], goal: tuple[int, int] | None
) -> tuple[int, int]:
    """The nodes that the plan for all sends us to next and then; our own to stay."""
    lattice, costmap = together.lattice, view.costmap
    ends, goals, robots, claimed = [end], [goal], [view.config.robot.id], [together.claim_round]
    for peer in view.peers:
        ends.append((int(peer.intent[-1, 0]), int(peer.intent[-1, 1])))
        goals.append(None if peer.destination is None else nearest_free(costmap, *peer.destination))
        robots.append(peer.robot)
        claimed.append(peer.claim_round)
    known = [k for k, cell in enumerate(ends) if costmap.is_free(cell) and _node(lattice, cell) >= 0]
    known.sort(key=lambda k: robots[k])
    node = np.array([_node(lattice, ends[k]) for k in known], np.int32)
    goal_node = node.copy()
    for place, k in enumerate(known):
        cell = goals[k]
        if cell is not None and _node(lattice, cell) >= 0:
            goal_node[place] = _node(lattice, cell)
    graph = _without(lattice, _closed(view, together, [ends[k] for k in known], node, goal_node))
    line = np.array([(claimed[k] - together.round) % CLAIM_ROUNDS - CLAIM_ROUNDS for k in known], np.int64)
    plan = make_planner(view.config.planning.planner).plan(_scene(graph, node, goal_node, line), None)
    mine = plan.target[known.index(0)]
    return int(mine[0]), int(mine[min(1, len(mine) - 1)])


def _node(lattice: Lattice, cell: tuple[int, int]) -> int:
    return int(lattice.near[cell[1], cell[0]])


def _scene(
    graph: MotionGraph, node: NDArray[np.int32], goal: NDArray[np.int32], line: NDArray[np.int64]
) -> Scene:
    """Robots that are all where they have committed themselves to go. line: (N,) the smallest goes first."""
    count = len(node)
    fields = np.array([moves_to(graph, int(one)) for one in goal])
    reachable = fields[np.arange(count), node] < UNREACHED
    goal = np.where(reachable, goal, node).astype(np.int32)
    still, rows = np.zeros(count, np.int32), np.arange(count, dtype=np.int32)
    ticks = np.ones(count, np.int32)
    return Scene(0, graph, node, still, node.copy(), ticks, goal, rows, line, fields)


def _closed(
    view: View,
    together: Together,
    ends: list[tuple[int, int]],
    node: NDArray[np.int32],
    goal: NDArray[np.int32],
) -> NDArray[np.bool_]:
    """(K,) nodes that nobody can pass: too near to where a robot rests beside its node, or to an obstacle.

    Robots that want to get on will make room; theirs are left open.
    """
    lattice, resolution_m = together.lattice, view.resolution_m
    out_cells = keep_out_m(view.config) / resolution_m
    closed = np.zeros(len(lattice.centre), np.bool_)
    for (x, y), rests in zip(ends, (node == goal).tolist(), strict=True):
        if rests:
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
