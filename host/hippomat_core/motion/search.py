"""Space-time search for one robot: a cheapest path through the window around everything reserved already.

A* over cells and ticks (Silver 2005), with a rule of its own against rings: a robot may follow into a cell
that is left in the same tick, but robots never all wait for each other to leave, so that a plan can always be
committed robot by robot (commitment.py).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.motion.graph import UNREACHED, Ways
from hippomat_core.motion.reservations import NOBODY, holder
from hippomat_core.motion.scene import Fleet

MAX_STATES = 8192  # of one search; a robot that needs more stands
_STATES_PER_TICK = 256  # small windows get by with less memory, which then stays in the cache
NO_PATH = -1


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
    seen: NDArray[np.int64]  # (2^k,) hash table of the states seen, with the number of the search
    number: NDArray[np.int64]  # (1,) of the last search: so that `seen` need not be cleared for each


def search_memory(window: int, slowest: int) -> Search:
    """For windows of so many ticks and moves of up to `slowest` ticks."""
    room = 1 << (min(_STATES_PER_TICK * window, MAX_STATES) - 1).bit_length()
    node, tick, parent, link = (np.zeros(room, np.int32) for _ in range(4))
    heads = np.zeros(2 * (window + 2 * slowest) + 4, np.int32)
    seen, number = np.zeros(2 * room, np.int64), np.zeros(1, np.int64)
    return Search(node, tick, parent, link, heads, seen, number)


@njit(cache=True, nogil=True)
def find_path(
    ways: Ways,
    fleet: Fleet,
    robot: int,
    begin: int,
    planned: NDArray[np.bool_],
    target: NDArray[np.int32],
    table: Table,
    search: Search,
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
    search.number[0] += 1
    stamp = search.number[0]
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
            return int(state)
        to_go = 0 if aimless else ticks * field[node]
        spent = cost + least - to_go
        entering = holder(keys, owners, ways.span, tick + 1, ways.places[node])
        blocked = entering >= 0 and entering != robot
        if not blocked:
            waiting = 0 if to_go == 0 else 1
            count = _push(search, count, node, tick + 1, state, cost + waiting, stamp, len(field))
        for direction in range(ways.neighbours.shape[1] - 1, -1, -1):
            head = ways.neighbours[node, direction]
            if head < 0 or not _may_move(ways, robot, node, head, direction, tick, ticks, table):
                continue
            if blocked and (
                ticks > 1 or _closes_ring(ways, fleet, robot, node, head, tick, planned, target, table)
            ):
                continue
            there = spent + ticks - least + (0 if aimless else ticks * field[head])
            if there < len(search.heads):
                count = _push(search, count, head, tick + ticks, state, there, stamp, len(field))
        if count > len(search.node) - 32:
            return NO_PATH
    return NO_PATH


@njit(cache=True, nogil=True, inline="always")
def _push(
    search: Search, count: int, node: int, tick: int, parent: int, cost: int, stamp: int, nodes: int
) -> int:
    """Add a state that was not seen in this search; the new number of states."""
    key = (np.int64(tick) * nodes + node) | np.int64(stamp) << np.int64(32)
    mask = len(search.seen) - 1
    at = (np.int64(tick) * 977 + node) & mask  # near cells, near entries
    while search.seen[at] >> np.int64(32) == stamp:
        if search.seen[at] == key:
            return count
        at = (at + 1) & mask
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
    for side in range(2):
        passed = ways.beside[tail, direction, side]
        if passed >= 0:
            for step in range(ticks + 1):
                by = holder(keys, owners, ways.span, tick + step, ways.places[passed])
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
        if by < 0 or by == robot or not planned[by] or fleet.ticks[by] > 1:
            return False
        into = target[by, tick]
        if into == node:
            return True
    return True


@njit(cache=True, nogil=True)
def write_path(search: Search, end: int, target: NDArray[np.int32]) -> None:
    state = end
    while search.parent[state] >= 0:
        before = search.parent[state]
        for tick in range(search.tick[before], min(search.tick[state], len(target))):
            target[tick] = search.node[state]
        state = before
