"""Space-time search for one robot at a time, in a window, around everything that is reserved already.

The compiled part of window.py (Silver 2005, windowed hierarchical cooperative A*), with its own rule against
rings: a robot may follow into a cell that is left in the same tick, but robots never all wait for each other
to leave, so that a plan can always be committed robot by robot (commitment.py).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.motion.graph import UNREACHED
from hippomat_core.motion.reservations import NOBODY, hold, holder

MAX_STATES = 8192  # of one search; a robot that needs more stands
_SEEN = 4 * MAX_STATES  # a power of two
NO_PATH = -1


class Ways(NamedTuple):
    """A MotionGraph's arrays, see there."""

    neighbours: NDArray[np.int32]
    middles: NDArray[np.int64]
    places: NDArray[np.int64]
    span: int


class Fleet(NamedTuple):
    """A Scene's arrays, see there."""

    node: NDArray[np.int32]
    ready: NDArray[np.int32]
    leaving: NDArray[np.int32]
    ticks: NDArray[np.int32]
    goal_field: NDArray[np.int32]
    fields: NDArray[np.int32]


class Table(NamedTuple):
    """See reservations.py."""

    keys: NDArray[np.int64]
    owners: NDArray[np.int32]


class Search(NamedTuple):
    """Working memory of one search after another: states, lists of them by cost, and which were seen."""

    node: NDArray[np.int32]
    tick: NDArray[np.int32]
    parent: NDArray[np.int32]
    link: NDArray[np.int32]  # the next state of equal cost
    heads: NDArray[np.int32]  # (costs,) newest state of each cost above the least possible
    seen: NDArray[np.int64]
    stamp: NDArray[np.int32]  # of the search that wrote `seen` here


def search_memory(window: int, slowest: int) -> Search:
    """For windows of so many ticks and moves of up to `slowest` ticks."""
    states = [np.zeros(MAX_STATES, np.int32) for _ in range(4)]
    heads = np.zeros(2 * (window + 2 * slowest) + 4, np.int32)
    return Search(*states, heads, np.zeros(_SEEN, np.int64), np.zeros(_SEEN, np.int32))


@njit(cache=True, nogil=True)
def plan_fleet(
    ways: Ways,
    fleet: Fleet,
    order: NDArray[np.int32],
    begin: int,
    target: NDArray[np.int32],
    kept: NDArray[np.bool_],
    table: Table,
    search: Search,
) -> int:
    """Fill target (N, W) for the robots that are not kept, from tick `begin` on; how many got no path.

    order: (N,) who chooses first. Whoever finds no path moves to the front, and all choose anew.
    """
    count = len(order)
    planned = kept.copy()
    failed = restarts = place = 0
    search.stamp[:] = 0
    _reserve_commitments(ways, fleet, begin, target, kept, table)
    searches = 0
    while place < count:
        robot = order[place]
        if kept[robot]:
            place += 1
            continue
        searches += 1
        end = _find(ways, fleet, robot, begin, planned, target, table, search, searches)
        if end == NO_PATH and place > 0 and restarts < 2 * count and not kept.any():
            order[1 : place + 1] = order[:place].copy()
            order[0] = robot
            restarts += 1
            place = 0
            planned[:] = False
            _reserve_commitments(ways, fleet, begin, target, kept, table)
            continue
        target[robot, begin:] = fleet.node[robot]
        if end == NO_PATH:
            failed += 1
        else:
            planned[robot] = True
            _write(search, end, target[robot])
        _hold_path(ways, fleet, robot, begin, target, table)
        place += 1
    return failed


@njit(cache=True, nogil=True)
def _reserve_commitments(
    ways: Ways, fleet: Fleet, begin: int, target: NDArray[np.int32], kept: NDArray[np.bool_], table: Table
) -> None:
    table.keys[:] = 0
    for robot in range(len(fleet.node)):
        node, left = fleet.node[robot], fleet.leaving[robot]
        for tick in range(begin, begin + fleet.ready[robot] + 1):
            hold(table.keys, table.owners, ways.span, tick, ways.places[node], robot)
        if left != node:
            middle = _middle(ways, left, node)
            for tick in range(begin, begin + fleet.ready[robot]):
                hold(table.keys, table.owners, ways.span, tick, ways.places[left], robot)
                hold(table.keys, table.owners, ways.span, tick, middle, robot)
        if kept[robot]:
            _hold_path(ways, fleet, robot, begin, target, table)


@njit(cache=True, nogil=True)
def _middle(ways: Ways, tail: int, head: int) -> int:
    for direction in range(ways.neighbours.shape[1]):
        if ways.neighbours[tail, direction] == head:
            return ways.middles[tail, direction]
    return ways.places[head]


@njit(cache=True, nogil=True)
def _hold_path(
    ways: Ways, fleet: Fleet, robot: int, begin: int, target: NDArray[np.int32], table: Table
) -> None:
    """Reserve target[robot]. Entries that somebody else holds stay his: only a robot without a path has such."""
    keys, owners = table
    at, tick = fleet.node[robot], begin + fleet.ready[robot]
    ticks = fleet.ticks[robot]
    while tick < target.shape[1]:
        head = target[robot, tick]
        if head == at:
            tick += 1
            hold(keys, owners, ways.span, tick, ways.places[at], robot)
            continue
        middle = _middle(ways, at, head)
        hold(keys, owners, ways.span, tick, middle, robot)
        for later in range(tick + 1, tick + ticks):
            hold(keys, owners, ways.span, later, middle, robot)
            hold(keys, owners, ways.span, later, ways.places[at], robot)
            hold(keys, owners, ways.span, later, ways.places[head], robot)
        tick += ticks
        hold(keys, owners, ways.span, tick, ways.places[head], robot)
        at = head


@njit(cache=True, nogil=True)
def _find(
    ways: Ways,
    fleet: Fleet,
    robot: int,
    begin: int,
    planned: NDArray[np.bool_],
    target: NDArray[np.int32],
    table: Table,
    search: Search,
    stamp: int,
) -> int:
    """The last state of a cheapest path through the window, or NO_PATH (A*).

    Cost: ticks that the robot is under way or waits elsewhere than at its goal, and from the end of the
    window on as long as its way would take alone. Of equally cheap paths, later states first.
    """
    keys, owners = table
    field = fleet.fields[fleet.goal_field[robot]]
    start, window, ticks = fleet.node[robot], target.shape[1], fleet.ticks[robot]
    aimless = field[start] >= UNREACHED
    first = begin + fleet.ready[robot]
    search.heads[:] = -1
    count = _push(search, 0, start, first, -1, 0, stamp, len(field))
    least = 0 if aimless else ticks * field[start]
    cost = 0
    while cost < len(search.heads):
        state = search.heads[cost]
        if state < 0:
            cost += 1
            continue
        search.heads[cost] = search.link[state]
        node, tick = search.node[state], search.tick[state]
        if tick >= window:
            return state
        to_go = 0 if aimless else ticks * field[node]
        spent = cost + least - to_go
        entering = holder(keys, owners, ways.span, tick + 1, ways.places[node])
        if entering == NOBODY or entering == robot:
            waiting = 0 if to_go == 0 else 1
            count = _push(search, count, node, tick + 1, state, cost + waiting, stamp, len(field))
        for direction in range(ways.neighbours.shape[1] - 1, -1, -1):
            head = ways.neighbours[node, direction]
            if head < 0 or not _may_move(ways, robot, node, head, direction, tick, ticks, table):
                continue
            if entering >= 0 and entering != robot:
                if ticks > 1 or _closes_ring(ways, fleet, robot, node, head, tick, planned, target, table):
                    continue
            there = spent + ticks - least + (0 if aimless else ticks * field[head])
            if there < len(search.heads):
                count = _push(search, count, head, tick + ticks, state, there, stamp, len(field))
        if count > MAX_STATES - 32:
            return NO_PATH
    return NO_PATH


@njit(cache=True, nogil=True, inline="always")
def _push(
    search: Search, count: int, node: int, tick: int, parent: int, cost: int, stamp: int, nodes: int
) -> int:
    """Add a state that was not seen in this search; the new number of states."""
    key = np.int64(tick) * nodes + node
    at = (key * np.int64(0x1E3779B97F4A7C15) >> np.int64(29)) & (_SEEN - 1)
    while search.stamp[at] == stamp:
        if search.seen[at] == key:
            return count
        at = (at + 1) & (_SEEN - 1)
    search.stamp[at] = stamp
    search.seen[at] = key
    search.node[count] = node
    search.tick[count] = tick
    search.parent[count] = parent
    search.link[count] = search.heads[cost]
    search.heads[cost] = count
    return count + 1


@njit(cache=True, nogil=True)
def _may_move(
    ways: Ways, robot: int, tail: int, head: int, direction: int, tick: int, ticks: int, table: Table
) -> bool:
    keys, owners = table
    middle = ways.middles[tail, direction]
    for step in range(ticks):
        by = holder(keys, owners, ways.span, tick + step + 1, ways.places[head])
        if by != NOBODY and by != robot:
            return False
        by = holder(keys, owners, ways.span, tick + step, middle)
        if by != NOBODY and by != robot:
            return False
        if step > 0:
            by = holder(keys, owners, ways.span, tick + step, ways.places[tail])
            if by != NOBODY and by != robot:
                return False
    return True


@njit(cache=True, nogil=True)
def _closes_ring(
    ways: Ways,
    fleet: Fleet,
    robot: int,
    node: int,
    head: int,
    tick: int,
    planned: NDArray[np.bool_],
    target: NDArray[np.int32],
    table: Table,
) -> bool:
    """Whether the robots that leave their cells in this tick, one for the next, would come back to ours."""
    into = head
    for _ in range(len(fleet.node)):
        by = holder(table.keys, table.owners, ways.span, tick, ways.places[into])
        if by == NOBODY or by == robot or not planned[by] or fleet.ticks[by] > 1:
            return False
        into = target[by, tick]
        if into == node:
            return True
    return True


@njit(cache=True, nogil=True)
def _write(search: Search, end: int, target: NDArray[np.int32]) -> None:
    state = end
    while search.parent[state] >= 0:
        before = search.parent[state]
        for tick in range(search.tick[before], min(search.tick[state], len(target))):
            target[tick] = search.node[state]
        state = before
