"""Which tasks there are, where episodes begin, and what every task costs every agent; compiled.

Costs reach agents as codes of the core's quantise only (WorldPool.code_of_ms). See env_arrays.py for the
arrays. numba's cache looks at this file alone: touch it after a change in random_stream.py.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.wire.frames import UNREACHABLE
from hippomat_sim.learn.env_arrays import ON_THE_WAY, Copies, Rules, Scratch, Seen
from hippomat_sim.learn.random_stream import draw_below, draw_unit
from hippomat_sim.learn.travel_times import UNREACHABLE_MS


@njit(cache=True, nogil=True)
def reset_copies(
    rules: Rules, copies: Copies, seen: Seen, scratch: Scratch, which: NDArray[np.int64]
) -> None:
    """Begins an episode in the copies of `which`: a world, different starts, different sites."""
    random, site, taken, left = copies.random, copies.site, copies.taken, copies.left
    place, vehicle, given, landed = copies.place, rules.vehicle, scratch.starts, rules.landed
    worlds, sites, airborne = rules.travel_ms.shape[0], taken.shape[1], rules.airborne_tasks
    for e in which:
        copies.world[e] = draw_below(random, e, worlds)
        taken[e, :] = False
        left[e, 0], left[e, 1] = landed, sites - landed
        for j in range(site.shape[1]):
            site[e, j] = _draw_site(random, taken, left, landed, airborne, e)
        _place_agents(random, place, vehicle, given, e)
        copies.steps[e] = 0
        copies.generation[e, :] += 1
        copies.handed_over[e, :, :] = False
        copies.busy_ms[e, :] = 0
        copies.destination[e, :] = -1
        copies.slot[e, :] = -1
        copies.new_row[e, :] = True
        seen.waiting[e, :] = True
        seen.available[e, :] = True
        seen.busy[e, :] = False
        seen.assigned[e, :] = False


@njit(nogil=True)
def _draw_site(
    random: NDArray[np.uint64],
    taken: NDArray[np.bool_],
    left: NDArray[np.int64],
    landed: int,
    airborne: float,
    e: int,
) -> int:
    """A site that no slot of copy e has; in the air by chance, or where the other kind has run out."""
    kind = 0
    if airborne > 0.0 and draw_unit(random, e) < airborne:
        kind = 1
    if left[e, kind] == 0:
        kind = 1 - kind
    first = landed if kind == 1 else 0
    count = taken.shape[1] - landed if kind == 1 else landed
    site = first + draw_below(random, e, count)
    while taken[e, site]:
        site = first + draw_below(random, e, count)
    taken[e, site] = True
    left[e, kind] -= 1
    return site


@njit(nogil=True)
def _place_agents(
    random: NDArray[np.uint64],
    place: NDArray[np.int64],
    vehicle: NDArray[np.int64],
    given: NDArray[np.bool_],
    e: int,
) -> None:
    """Different starts of each class."""
    for i in range(len(vehicle)):
        start = draw_below(random, e, given.shape[1])
        while given[vehicle[i], start]:
            start = draw_below(random, e, given.shape[1])
        given[vehicle[i], start] = True
        place[e, i] = start
    for i in range(len(vehicle)):
        given[vehicle[i], place[e, i]] = False


@njit(nogil=True)
def put_task(rules: Rules, copies: Copies, seen: Seen, e: int, j: int) -> None:
    """A new task in slot j, at a site that no slot has; the old one's site is free from then on."""
    landed, old = rules.landed, copies.site[e, j]
    copies.site[e, j] = _draw_site(copies.random, copies.taken, copies.left, landed, rules.airborne_tasks, e)
    copies.taken[e, old] = False
    copies.left[e, 1 if old >= landed else 0] += 1
    copies.generation[e, j] += 1
    copies.new_slot[e, j] = True
    seen.waiting[e, j] = True
    if rules.handover:
        copies.handed_over[e, :, j] = False


@njit(cache=True, nogil=True)
def observe(rules: Rules, copies: Copies, seen: Seen, scratch: Scratch, which: NDArray[np.int64]) -> None:
    """Renews the codes of rows and slots that are not as they were: when each agent could be at each task.

    In the copies of `which`.
    """
    costs_q, place, busy_ms, sites = seen.costs_q, copies.place, copies.busy_ms, scratch.sites
    new_row, new_slot, handed_over = copies.new_row, copies.new_slot, copies.handed_over
    table, own_row_ms, world, vehicle = rules.travel_ms, copies.own_row_ms, copies.world, rules.vehicle
    code_of_ms, handover, slots = rules.code_of_ms, rules.handover, scratch.slots
    codes = rules.codes
    agents, tasks = costs_q.shape[1:]
    for e in which:
        renewed = 0
        for j in range(tasks):
            sites[j] = copies.site[e, j]
            if new_slot[e, j]:
                slots[renewed] = j
                renewed += 1
                new_slot[e, j] = False
        for i in range(agents):
            row_ms = table[world[e], vehicle[i], max(place[e, i], 0)]
            if place[e, i] == ON_THE_WAY:
                row_ms = own_row_ms[e, i]
            if not new_row[e, i]:
                for k in range(renewed):
                    costs_q[e, i, slots[k]] = _code(row_ms, busy_ms[e, i], sites[slots[k]], code_of_ms)
            elif busy_ms[e, i] == 0 and place[e, i] != ON_THE_WAY:
                _look_up(codes[world[e], vehicle[i], place[e, i]], sites, costs_q[e, i])
            else:
                _price(row_ms, busy_ms[e, i], sites, code_of_ms, costs_q[e, i])
            new_row[e, i] = False
            for j in range(tasks if handover else 0):
                if handed_over[e, i, j]:
                    costs_q[e, i, j] = UNREACHABLE


@njit(nogil=True)
def _look_up(row_codes: NDArray[np.uint8], sites: NDArray[np.uint16], costs_q: NDArray[np.uint8]) -> None:
    """The row of who is idle at a place. Unsigned indices: numba looks at the sign of every other one."""
    for j in range(np.uint64(len(sites))):
        costs_q[j] = row_codes[sites[j]]


@njit(nogil=True, inline="always")
def _code(
    row_ms: NDArray[np.uint16], later_ms: int, site: np.uint16, code_of_ms: NDArray[np.uint8]
) -> np.uint8:
    trip_ms = np.uint32(row_ms[site])
    then_ms = min(trip_ms + np.uint32(later_ms), np.uint32(UNREACHABLE_MS - 1))
    code: np.uint8 = code_of_ms[trip_ms if trip_ms == np.uint32(UNREACHABLE_MS) else then_ms]
    return code


@njit(nogil=True)
def _price(
    row_ms: NDArray[np.uint16],
    later_ms: int,
    sites: NDArray[np.uint16],
    code_of_ms: NDArray[np.uint8],
    costs_q: NDArray[np.uint8],
) -> None:
    """The row of who is `later_ms` from there."""
    for j in range(np.uint64(len(sites))):
        costs_q[j] = _code(row_ms, later_ms, sites[j], code_of_ms)
