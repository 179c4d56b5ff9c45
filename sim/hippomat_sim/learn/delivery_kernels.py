"""A round of the radio, compiled. The relays' rule is that of esp32_firmware/lib/radio_core/relay_table.c.

miss[s][k][i] is what agent s takes for the probability that agent i lacks row k of this round, in 1/255.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.wire.frames import UNREACHABLE
from hippomat_sim.learn.env_arrays import Copies, Seen
from hippomat_sim.learn.random_stream import draw_unit

CERTAIN = 255
NEED_MIN = 5  # RC_NEED_MIN: 0.02 in 1/255; where the chances sum to less, nobody needs the row
_CHANCES = 1 << 16  # of a link's loss, in whole numbers


class Air(NamedTuple):
    loss: float
    relays: int  # phases
    rows_per_relay: int
    dead_rounds: float  # an agent unheard for longer takes no part


class Rows(NamedTuple):
    """What holder i of copy e has of row k: [e, i, k]. The arrays of ProblemBatch, and the row's claim."""

    costs_q: NDArray[np.uint8]  # (E, N, N, M)
    available: NDArray[np.bool_]  # (E, N, N)
    busy: NDArray[np.bool_]  # (E, N, N)
    waiting: NDArray[np.bool_]  # (E, N, M)
    present: NDArray[np.bool_]  # (E, N, N)
    assigned: NDArray[np.bool_]  # (E, N, N)
    ages_rounds: NDArray[np.float32]  # (E, N, N), inf = never heard
    slot: NDArray[np.int64]  # (E, N, N) whose task is claimed; -1 = none
    generation: NDArray[np.int64]  # (E, N, N) of that task


class Turns(NamedTuple):
    """One round of one copy, as each agent knows it."""

    held: NDArray[np.bool_]  # (N, N) [holder, row]
    miss: NDArray[np.uint8]  # (N, N, N)
    needs: NDArray[np.int64]  # (N,)
    chosen: NDArray[np.int64]  # (N,) rows of one relay


def new_turns(agents: int) -> Turns:
    return Turns(
        held=np.zeros((agents, agents), np.bool_),
        miss=np.zeros((agents, agents, agents), np.uint8),
        needs=np.zeros(agents, np.int64),
        chosen=np.zeros(agents, np.int64),
    )


@njit(cache=True, nogil=True)
def exchange(air: Air, random: NDArray[np.uint64], stream: int, turns: Turns) -> None:
    """All frames of a round: turns.held says who holds which row after it."""
    held, miss, loss = turns.held, turns.miss, air.loss
    agents = len(held)
    held[:] = False
    for s in range(agents):
        held[s, s] = True
    if air.relays == 0:
        for s in range(agents):
            for r in range(agents):
                if r != s and draw_unit(random, stream) >= loss:
                    held[r, s] = True
        return
    _expect_losses(miss, loss)
    for s in range(agents):
        for r in range(agents):
            if r != s and draw_unit(random, stream) >= loss:
                for k in range(s):  # the bitmap of a STATE: what its sender heard of this round so far
                    miss[r, k, s] = 0 if held[s, k] else CERTAIN
                held[r, s] = True
    for _ in range(air.relays):
        for s in range(agents):
            count = _choose_rows(held, miss[s], turns.needs, turns.chosen, s, air.rows_per_relay, loss)
            for r in range(agents if count else 0):
                if r != s and draw_unit(random, stream) >= loss:
                    _hear_relay(held, miss[r], turns.chosen, count, s, r, loss)


@njit(nogil=True)
def _expect_losses(miss: NDArray[np.uint8], loss: float) -> None:
    """Nothing but the loss of the links is known; nobody lacks its own row or counts what it lacks itself."""
    agents = len(miss)
    miss[:] = min(int(loss * _CHANCES) >> 8, CERTAIN)
    for s in range(agents):
        for i in range(agents):
            miss[s, i, i] = 0
            miss[s, i, s] = 0


@njit(nogil=True)
def _choose_rows(
    held: NDArray[np.bool_],
    miss: NDArray[np.uint8],
    needs: NDArray[np.int64],
    chosen: NDArray[np.int64],
    s: int,
    most: int,
    loss: float,
) -> int:
    """The rows that s passes on: those with the largest sum of squares; ties cyclic from its own id."""
    agents = len(miss)
    for k in range(agents):
        total, squares = np.uint32(0), np.uint32(0)
        for i in range(agents if held[s, k] else 0):
            chance = np.uint32(miss[k, i])
            total += chance
            squares += chance * chance
        needs[k] = 0 if total < NEED_MIN else np.int64(squares)
    count = 0
    while count < most:
        best = s
        for step in range(1, agents):
            k = s + step if s + step < agents else s + step - agents
            if needs[k] > needs[best]:
                best = k
        if needs[best] == 0:
            break
        needs[best] = 0
        chosen[count] = best
        count += 1
        _count_as_sent(miss[best], loss)
    return count


@njit(nogil=True)
def _count_as_sent(chances: NDArray[np.uint8], loss: float) -> None:
    """Who lacked the row has missed this frame too; rounds down, so it reaches 0."""
    factor = np.uint32(min(int(loss * _CHANCES), _CHANCES - 1))
    for i in range(len(chances)):
        chances[i] = np.uint8((np.uint32(chances[i]) * factor) >> np.uint32(16))


@njit(nogil=True)
def _hear_relay(
    held: NDArray[np.bool_],
    miss: NDArray[np.uint8],
    chosen: NDArray[np.int64],
    count: int,
    s: int,
    r: int,
    loss: float,
) -> None:
    """Robot r hears a relay of s: which rows s holds, and some of them."""
    for k in range(len(miss)):
        miss[k, s] = 0 if held[s, k] else CERTAIN
    for n in range(count):
        _count_as_sent(miss[chosen[n]], loss)
        held[r, chosen[n]] = True


@njit(cache=True, nogil=True)
def forget(rows: Rows, which: NDArray[np.int64]) -> None:
    for e in which:
        rows.costs_q[e] = UNREACHABLE
        rows.available[e] = False
        rows.busy[e] = False
        rows.present[e] = False
        rows.assigned[e] = False
        rows.ages_rounds[e] = np.inf
        rows.slot[e] = -1


@njit(cache=True, nogil=True)
def deliver(
    air: Air,
    random: NDArray[np.uint64],
    rows: Rows,
    turns: Turns,
    copies: Copies,
    seen: Seen,
    which: NDArray[np.int64],
) -> None:
    """One more round in the copies of `which`: everybody sends its row of `seen`."""
    for e in which:
        exchange(air, random, e, turns)
        _keep_rows(air, rows, turns, copies, seen, e)
        _see_waiting(rows, copies.generation, e)


@njit(nogil=True)
def _keep_rows(air: Air, rows: Rows, turns: Turns, copies: Copies, seen: Seen, e: int) -> None:
    """Rows that came replace those held; the others age, and robots unheard for too long take no part."""
    held, ages, slot = turns.held, rows.ages_rounds, copies.slot
    agents = len(held)
    for i in range(agents):
        for k in range(agents):
            if held[i, k]:
                rows.costs_q[e, i, k] = seen.costs_q[e, k]
                rows.available[e, i, k] = seen.available[e, k]
                rows.busy[e, i, k] = seen.busy[e, k]
                rows.present[e, i, k] = True
                rows.assigned[e, i, k] = seen.assigned[e, k]
                ages[e, i, k] = 0.0
                rows.slot[e, i, k] = slot[e, k]
                rows.generation[e, i, k] = copies.generation[e, slot[e, k]] if slot[e, k] >= 0 else 0
                continue
            ages[e, i, k] += 1.0
            if ages[e, i, k] > air.dead_rounds:
                rows.available[e, i, k] = False
                rows.busy[e, i, k] = False
                rows.present[e, i, k] = False


@njit(nogil=True)
def _see_waiting(rows: Rows, generation: NDArray[np.int64], e: int) -> None:
    """A task waits for those who hold no row that claims it."""
    waiting, slot = rows.waiting, rows.slot
    for i in range(waiting.shape[1]):
        waiting[e, i] = True
        for k in range(slot.shape[2]):
            j = slot[e, i, k]
            if j >= 0 and rows.generation[e, i, k] == generation[e, j]:
                waiting[e, i, j] = False
