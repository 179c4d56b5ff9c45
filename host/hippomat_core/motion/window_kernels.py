"""Everyone's paths through the window: who is planned when, what is reserved. Compiled; see window.py."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.motion.graph import Ways, halfway
from hippomat_core.motion.reservations import NOBODY, hold, holder, release
from hippomat_core.motion.scene import Fleet
from hippomat_core.motion.search import NO_PATH, Search, Table, find_path, write_path


@njit(cache=True, nogil=True)
def line_of(node: NDArray[np.int32], goal: NDArray[np.int32], since: NDArray[np.int64]) -> NDArray[np.int32]:
    """(N,) robots, those first that have had their goal longest; those that want nothing last; then by id."""
    order = np.empty(len(node), np.int32)
    for robot in range(len(node)):
        at = robot
        while at > 0:
            before = order[at - 1]
            rests, rested = goal[robot] == node[robot], goal[before] == node[before]
            if rests > rested or (rests == rested and since[robot] >= since[before]):
                break
            order[at] = before
            at -= 1
        order[at] = robot
    return order


@njit(cache=True, nogil=True)
def renewed(
    target: NDArray[np.int32],
    passed: int,
    node: NDArray[np.int32],
    old: NDArray[np.int32],
    goal: NDArray[np.int32],
    kept: NDArray[np.bool_],
) -> int:
    """How many robots have another goal than the `old` one that a plan was made for; fills kept (N,).

    -1 where one of them is elsewhere than the plan, `passed` ticks old, sent it.
    """
    count = 0
    for robot in range(len(node)):
        if passed > 0 and target[robot, passed - 1] != node[robot]:
            return -1
        kept[robot] = old[robot] == goal[robot]
        count += not kept[robot]
    return count


@njit(cache=True, nogil=True)
def plan_fleet(
    ways: Ways,
    fleet: Fleet,
    begin: int,
    target: NDArray[np.int32],
    kept: NDArray[np.bool_],
    reserved: bool,
    table: Table,
    search: Search,
) -> int:
    """Fill target (N, W) for the robots that are not kept, from tick `begin` on; how many got no path.

    reserved: the table holds what is reserved for target as it is

    Who has had its goal longest chooses first. Whoever finds no path moves to the front, and all choose anew.
    One that rests where it stands and finds no path is in the way of somebody: it takes over what that one
    wants (priority inheritance), so that it moves on before it rather than wall it in.
    """
    order = line_of(fleet.node, fleet.goal, fleet.since)
    pursued = fleet.goal_field.copy()
    fleet = Fleet(
        fleet.node,
        fleet.ready,
        fleet.leaving,
        fleet.ticks,
        fleet.goal,
        pursued,
        fleet.since,
        fleet.fields,
    )
    count = len(order)
    planned = kept.copy()
    failed = restarts = place = 0
    if reserved:
        for robot in range(count):
            if not kept[robot]:
                _hold_path(ways, fleet, robot, begin, target, table, False)
    else:
        _reserve_commitments(ways, fleet, begin, target, kept, table)
    while place < count:
        robot = order[place]
        if kept[robot]:
            place += 1
            continue
        end = find_path(ways, fleet, robot, begin, planned, target, table, search)
        if end == NO_PATH and place > 0 and restarts < 2 * count and not kept.any():
            order[1 : place + 1] = order[:place].copy()
            order[0] = robot
            restarts += 1
            if fleet.goal[robot] == fleet.node[robot]:
                pursued[robot] = pursued[_pusher(ways, fleet, robot, begin, target.shape[1], table)]
            place = 0
            planned[:] = False
            _reserve_commitments(ways, fleet, begin, target, kept, table)
            continue
        target[robot, begin:] = fleet.node[robot]
        if end == NO_PATH:
            failed += 1
        else:
            planned[robot] = True
            write_path(search, end, target[robot])
        _hold_path(ways, fleet, robot, begin, target, table, True)
        place += 1
    return failed


@njit(cache=True, nogil=True)
def _pusher(ways: Ways, fleet: Fleet, robot: int, begin: int, window: int, table: Table) -> int:
    """Who wants to get past a robot that rests: through whoever it has pushed already; itself if nobody."""
    pushed = robot
    for _ in range(len(fleet.node)):
        by = NOBODY
        for tick in range(begin + fleet.ready[pushed] + 1, window):
            by = holder(table.keys, table.owners, ways.span, tick, ways.places[fleet.node[pushed]])
            if by >= 0 and by != pushed:
                break
        if by < 0 or by == pushed:
            return robot
        if fleet.goal[by] != fleet.node[by]:
            return by
        pushed = by
    return robot


@njit(cache=True, nogil=True)
def _reserve_commitments(
    ways: Ways, fleet: Fleet, begin: int, target: NDArray[np.int32], kept: NDArray[np.bool_], table: Table
) -> None:
    table.keys[:] = 0
    for robot in range(len(fleet.node)):
        node, left = fleet.node[robot], fleet.leaving[robot]
        # It still holds its cell while it leaves: whoever plans first must leave it that much time.
        for tick in range(begin, begin + fleet.ready[robot] + fleet.ticks[robot]):
            hold(table.keys, table.owners, ways.span, tick, ways.places[node], robot)
        if left != node:
            middle = halfway(ways, left, node)
            _hold_beside(ways, left, node, begin, begin + fleet.ready[robot], robot, table, True)
            for tick in range(begin, begin + fleet.ready[robot]):
                hold(table.keys, table.owners, ways.span, tick, ways.places[left], robot)
                hold(table.keys, table.owners, ways.span, tick, middle, robot)
        if kept[robot]:
            _hold_path(ways, fleet, robot, begin, target, table, True)


@njit(cache=True, nogil=True)
def _hold_path(
    ways: Ways, fleet: Fleet, robot: int, begin: int, target: NDArray[np.int32], table: Table, held: bool
) -> None:
    """Reserve target[robot]; or release it, but for where it is at its first tick.

    Entries that somebody else holds stay his: only a robot that found no path has such.
    """
    keys, owners = table
    places, span = ways.places, ways.span
    at, tick = fleet.node[robot], begin + fleet.ready[robot]
    ticks = fleet.ticks[robot]
    while tick < target.shape[1]:
        head = target[robot, tick]
        if head == at:
            tick += 1
            _hold(keys, owners, span, tick, places[at], robot, held)
            continue
        middle = halfway(ways, at, head)
        _hold(keys, owners, span, tick, middle, robot, held)
        _hold_beside(ways, at, head, tick, tick + ticks, robot, table, held)
        for later in range(tick + 1, tick + ticks):
            _hold(keys, owners, span, later, middle, robot, held)
            _hold(keys, owners, span, later, places[at], robot, held)
            _hold(keys, owners, span, later, places[head], robot, held)
        tick += ticks
        _hold(keys, owners, span, tick, places[head], robot, held)
        at = head


@njit(cache=True, nogil=True)
def _hold_beside(
    ways: Ways, tail: int, head: int, begin: int, end: int, robot: int, table: Table, held: bool
) -> None:
    """The cells that a diagonal move passes, from its first tick to its last."""
    for direction in range(ways.neighbours.shape[1]):
        if ways.neighbours[tail, direction] == head:
            for side in range(2):
                passed = ways.beside[tail, direction, side]
                if passed >= 0:
                    for tick in range(begin, end + 1):
                        _hold(table.keys, table.owners, ways.span, tick, ways.places[passed], robot, held)


@njit(cache=True, nogil=True, inline="always")
def _hold(
    keys: NDArray[np.int64],
    owners: NDArray[np.int32],
    span: int,
    tick: int,
    place: int,
    robot: int,
    held: bool,
) -> None:
    if held:
        hold(keys, owners, span, tick, place, robot)
    else:
        release(keys, owners, span, tick, place, robot)
