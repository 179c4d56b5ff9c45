"""The rules of a round, compiled: who gets a task, what it earns, who hands over, where everybody is then.

Copies never meet. Times are integer milliseconds. See env_arrays.py for the arrays. Inner loops hold arrays
in names of their own: a named tuple that is passed on costs a count of references for every array in it.

numba's cache looks at the file of what is called alone: after a change in rewards.py, random_stream.py or
env_tasks.py touch this file too.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.wire.frames import UNREACHABLE
from hippomat_sim.learn.env_arrays import (
    NEVER,
    ON_CLAIM,
    ON_COMPLETION,
    ON_THE_WAY,
    Copies,
    Outcome,
    Rules,
    Scratch,
    Seen,
)
from hippomat_sim.learn.env_tasks import put_task
from hippomat_sim.learn.rewards import BUSY, BUSY_ASKED, EXCUSED, IDLE, LOST, WON, reward

NOBODY = 1 << 40  # larger than any (code, id)


@njit(cache=True, nogil=True)
def advance(
    rules: Rules, copies: Copies, seen: Seen, out: Outcome, scratch: Scratch, actions: NDArray[np.int64]
) -> int:
    """One round of all copies; the observation is not renewed.

    Returns how many agents left their task to another one: what their rows are now is for the caller to say.
    """
    released = 0
    _judge(seen, out, scratch, actions)
    _pay(rules, out, scratch)
    _set_out(rules, copies, seen, out)
    if rules.handover:
        released = _hand_over(rules, copies, seen, out, scratch, actions)
    if rules.turnover != NEVER:
        _move(rules, copies, seen, out)
    _end(rules, copies, seen, out)
    return released


@njit(nogil=True)
def _judge(seen: Seen, out: Outcome, scratch: Scratch, actions: NDArray[np.int64]) -> None:
    """Who gets which task, and every agent's fate: the smallest (code, id) of a task's requests wins.

    A request for a task that another one holds loses to that one; a request for what is out of reach is none.
    """
    costs_q, available, waiting = seen.costs_q, seen.available, seen.waiting
    fates, codes, allocated = scratch.fates, scratch.codes, out.allocated
    asking, best = scratch.asking, scratch.best
    copies, agents, tasks = costs_q.shape
    for e in range(copies):
        asking[:] = 0
        best[:] = NOBODY
        for i in range(agents):
            allocated[e, i] = -1
            slot = actions[e, i] - 1
            if not available[e, i]:
                fates[e, i] = BUSY_ASKED if slot >= 0 else BUSY
            elif slot >= 0 and costs_q[e, i, slot] != UNREACHABLE:
                fates[e, i] = LOST
                asking[slot] += 1
                if waiting[e, slot]:
                    best[slot] = min(best[slot], np.int64(costs_q[e, i, slot]) * agents + i)
            else:
                fates[e, i] = EXCUSED
                for j in range(tasks):
                    if waiting[e, j] and costs_q[e, i, j] != UNREACHABLE:
                        fates[e, i] = IDLE
                        break
        requested, conflicted = 0, 0
        for j in range(tasks):
            if asking[j] > 0:
                requested += 1
                conflicted += asking[j] > 1 or not waiting[e, j]
            if best[j] != NOBODY:
                winner = best[j] % agents
                fates[e, winner] = WON
                codes[e, winner] = best[j] // agents
                allocated[e, winner] = j
        out.requested_tasks[e] = requested
        out.conflicted_tasks[e] = conflicted


@njit(nogil=True)
def _pay(rules: Rules, out: Outcome, scratch: Scratch) -> None:
    rewards, fates, codes, prices = out.rewards, scratch.fates, scratch.codes, rules.prices
    for e in range(rewards.shape[0]):
        total = np.float32(0.0)
        for i in range(rewards.shape[1]):
            rewards[e, i] = reward(prices, fates[e, i], codes[e, i])
            total += rewards[e, i]
        out.team_reward[e] = total


@njit(nogil=True)
def _set_out(rules: Rules, copies: Copies, seen: Seen, out: Outcome) -> None:
    """The winners have their tasks; where time goes on, they are busy until they have served them."""
    allocated, travel_ms, place, site = out.allocated, out.travel_ms, copies.place, copies.site
    table, own_row_ms, world, vehicle = rules.travel_ms, copies.own_row_ms, copies.world, rules.vehicle
    for e in range(allocated.shape[0]):
        for i in range(allocated.shape[1]):
            travel_ms[e, i] = 0
            slot = allocated[e, i]
            if slot < 0:
                continue
            goal = site[e, slot]
            trip_ms = _trip_ms(table, own_row_ms, world[e], vehicle[i], place[e, i], e, i, goal)
            travel_ms[e, i] = trip_ms
            seen.available[e, i] = False
            seen.assigned[e, i] = True
            if rules.turnover != NEVER:
                seen.busy[e, i] = True
                copies.trip_ms[e, i] = trip_ms
                copies.busy_ms[e, i] = trip_ms + rules.dwell_ms
                copies.origin[e, i] = place[e, i]
                copies.destination[e, i] = goal
                place[e, i] = rules.starts + goal
            if rules.turnover == ON_CLAIM:
                put_task(rules, copies, seen, e, slot)
            else:
                copies.slot[e, i] = slot
                seen.waiting[e, slot] = False


@njit(nogil=True, inline="always")
def _trip_ms(
    table: NDArray[np.uint16],
    own_row_ms: NDArray[np.uint16],
    world: int,
    vehicle: int,
    place: int,
    e: int,
    i: int,
    site: int,
) -> int:
    """Travel time of agent i of copy e from its place to a site."""
    if place == ON_THE_WAY:
        return int(own_row_ms[e, i, site])
    return int(table[world, vehicle, place, site])


@njit(nogil=True)
def _hand_over(
    rules: Rules, copies: Copies, seen: Seen, out: Outcome, scratch: Scratch, actions: NDArray[np.int64]
) -> int:
    """Agents on their way leave their task where one that is idle and asked for nothing would be there sooner
    by more than the gain, and has not itself left that task to another one (as the core's fleet/handover).
    """
    released = 0
    for e in range(actions.shape[0]):
        for i in range(actions.shape[1]):
            out.released[e, i] = False
            slot = copies.slot[e, i]
            left_ms = copies.busy_ms[e, i] - rules.dwell_ms
            if slot < 0 or left_ms <= 0 or out.allocated[e, i] >= 0 or copies.handed_over[e, i, slot]:
                continue
            heir = _heir(rules, copies, seen, scratch, actions, e, slot, left_ms - rules.handover_gain_ms)
            if heir < 0:
                continue
            scratch.fates[e, heir] = BUSY  # one task for each heir
            copies.handed_over[e, i, slot] = True
            copies.slot[e, i] = -1
            out.released[e, i] = True
            out.elapsed_ms[e, i] = copies.trip_ms[e, i] - left_ms
            seen.waiting[e, slot] = True
            released += 1
    return released


@njit(nogil=True)
def _heir(
    rules: Rules,
    copies: Copies,
    seen: Seen,
    scratch: Scratch,
    actions: NDArray[np.int64],
    e: int,
    slot: int,
    before_ms: int,
) -> int:
    """Who would be there first, the smallest id of several; -1 = nobody before `before_ms`."""
    heir = -1
    for i in range(actions.shape[1]):
        if not seen.available[e, i] or actions[e, i] != 0 or scratch.fates[e, i] == BUSY:
            continue
        if seen.costs_q[e, i, slot] == UNREACHABLE or copies.handed_over[e, i, slot]:
            continue
        trip_ms = _trip_ms(
            rules.travel_ms,
            copies.own_row_ms,
            copies.world[e],
            rules.vehicle[i],
            copies.place[e, i],
            e,
            i,
            copies.site[e, slot],
        )
        if trip_ms < before_ms:
            heir, before_ms = i, trip_ms
    return heir


@njit(nogil=True)
def _move(rules: Rules, copies: Copies, seen: Seen, out: Outcome) -> None:
    """A step of time passes; who is done is free where its task was."""
    destination, busy_ms, new_row, released = copies.destination, copies.busy_ms, copies.new_row, out.released
    for e in range(destination.shape[0]):
        completed = 0
        for i in range(destination.shape[1]):
            if destination[e, i] < 0 or released[e, i]:
                continue
            busy_ms[e, i] -= rules.step_ms
            new_row[e, i] = True
            if busy_ms[e, i] > 0:
                continue
            completed += 1
            busy_ms[e, i] = 0
            destination[e, i] = -1
            seen.available[e, i] = True
            seen.busy[e, i] = False
            seen.assigned[e, i] = False
            slot = copies.slot[e, i]
            copies.slot[e, i] = -1
            if rules.turnover == ON_COMPLETION:
                put_task(rules, copies, seen, e, slot)
        out.completed[e] = completed


@njit(nogil=True)
def _end(rules: Rules, copies: Copies, seen: Seen, out: Outcome) -> None:
    """Terminated: nobody is left who could get a task. Truncated: the steps are over."""
    costs_q, available, waiting = seen.costs_q, seen.available, seen.waiting
    count, agents, tasks = costs_q.shape
    for e in range(count):
        copies.steps[e] += 1
        ended = rules.turnover == NEVER
        for i in range(agents if ended else 0):
            for j in range(tasks if available[e, i] else 0):
                if waiting[e, j] and costs_q[e, i, j] != UNREACHABLE:
                    ended = False
                    break
            if not ended:
                break
        out.terminated[e] = ended
        out.truncated[e] = copies.steps[e] >= rules.episode_steps and not ended
