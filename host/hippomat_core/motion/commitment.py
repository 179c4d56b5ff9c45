"""The rule that keeps robots apart, whatever they have or have not heard: commit only what nobody can cross.

A robot's *commitment* is its last two moves, cell to cell to cell, with the tick at which each begins; after
the second it stands in its last cell for ever. A commitment is only ever extended, by one move that begins in
the present tick, and each robot broadcasts it several times a tick. Robots decide in turn (their slots on the
air), so that no two decide at the same moment.

`may_extend` grants a move where it meets no commitment that any peer *can* have at that moment. A peer that
was heard since it last decided has exactly the commitment that was heard. One that was not can have extended
it by at most the moves that begin between the tick of that news and the present one; it may then be in any
cell within so many moves of the end that was heard (distance without obstacles: that only adds cells).

Why no two commitments ever meet: at the start everyone stands in a cell of its own. Let it be true before a
decision of robot i. Whatever i knows, the commitment that peer j really has is among those that i considers
possible, because j can only have extended the one that i heard, by moves of j's speed, beginning no later
than the present tick. i extends only if the new move, and standing at its end for ever, meets none of them;
so it does not meet the real one, and the statement is true after the decision. It does not matter whether j
has heard i: j's own decisions are judged by the same rule with i's possible extensions. And a robot that is
granted nothing stands where its commitment ends, which all others keep clear of: standing is always safe.

A robot that follows another, in the tick in which that one leaves, needs to have heard that it leaves: a cell
counts as taken to the end of the last *heard* commitment. Rings of robots that follow one another can
therefore not start; planners do not wish for them (window_kernels.py).

A peer that was silent for `forget` ticks counts as standing where it was last heard to go: it is dead,
or out of reach, and the scan guard next to the motors is left to answer for it. A newcomer that nobody
has heard is no part of the proof either: it stands until `may_start` lets it move.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.motion.graph import Ways, halfway

NEVER = -(1 << 40)


class Commitments(NamedTuple):
    """Of N robots, as one of them knows them."""

    nodes: NDArray[np.int32]  # (N, 3) the cell it left, the one it was or is in, the one it ends in
    begins: NDArray[np.int64]  # (N, 2) tick at which each of the two moves begins
    ticks: NDArray[np.int32]  # (N,) of a move
    heard: NDArray[np.int64]  # (N,) tick of the last news
    exact: NDArray[np.bool_]  # (N,) it has not decided since


def standing(nodes: NDArray[np.int32], ticks: NDArray[np.int32]) -> Commitments:
    """Everyone stands in its cell and has said so."""
    count = len(nodes)
    begins = np.full((count, 2), NEVER, np.int64)
    heard = np.full(count, -1, np.int64)
    return Commitments(np.repeat(nodes[:, None], 3, 1), begins, ticks, heard, np.ones(count, np.bool_))


@njit(cache=True, nogil=True)
def may_extend(
    ways: Ways,
    cells: NDArray[np.int32],
    diagonals: bool,
    known: Commitments,
    robot: int,
    head: int,
    now: int,
    forget: int,
) -> bool:
    """Whether `robot` may commit itself to move to node `head`, a neighbour of its last, from tick `now` on.

    cells: (K, 3) of the nodes
    """
    tail, begin = known.nodes[robot, 2], now
    end = begin + known.ticks[robot]
    if known.begins[robot, 1] + known.ticks[robot] > begin:
        return False  # it is still on its way to `tail`
    middle = halfway(ways, tail, head)
    if middle < 0:
        return False
    for peer in range(len(known.ticks)):
        if peer != robot and (
            _meets(ways, known, peer, head, middle, begin, end)
            or _may_reach(cells, diagonals, known, peer, head, now, forget)
        ):
            return False
    return True


@njit(cache=True, nogil=True)
def extend(known: Commitments, robot: int, head: int, now: int) -> None:
    """Commit `robot` to the move that may_extend granted it."""
    known.nodes[robot, 0] = known.nodes[robot, 1]
    known.nodes[robot, 1] = known.nodes[robot, 2]
    known.nodes[robot, 2] = head
    known.begins[robot, 0] = known.begins[robot, 1]
    known.begins[robot, 1] = now


@njit(cache=True, nogil=True)
def _meets(ways: Ways, known: Commitments, peer: int, head: int, middle: int, begin: int, end: int) -> bool:
    """Whether moving to `head` and staying there meets what the peer was heard to be committed to."""
    ticks = known.ticks[peer]
    if head == known.nodes[peer, 2]:
        return True
    for move in range(2):
        left, reached = known.nodes[peer, move], known.nodes[peer, move + 1]
        starts = known.begins[peer, move]
        if left == reached:
            continue
        # The cell is held up to the last tick before the peer's arrival; ours from the tick after `begin`.
        if left == head and starts + ticks - 1 >= begin + 1:
            return True
        if starts < end and begin < starts + ticks and halfway(ways, left, reached) == middle:
            return True
    return False


@njit(cache=True, nogil=True)
def _may_reach(
    cells: NDArray[np.int32],
    diagonals: bool,
    known: Commitments,
    peer: int,
    head: int,
    now: int,
    forget: int,
) -> bool:
    """Whether the peer can have committed itself to moves that lead it to `head`, beyond what was heard."""
    if known.exact[peer] or now - known.heard[peer] > forget:
        return False
    ticks = known.ticks[peer]
    earliest = max(known.begins[peer, 1] + ticks, known.heard[peer])
    moves = 0 if earliest > now else (now - earliest) // ticks + 1
    away = 0
    for axis in range(3):
        along = abs(cells[head, axis] - cells[known.nodes[peer, 2], axis])
        away = max(away, along) if diagonals else away + along
    return away <= moves


def may_start(heard_by: Iterable[bool], alone_s: float, least_alone_s: float) -> bool:
    """Whether a newcomer may make its first move: every peer that it hears has heard it, or it is alone.

    heard_by: for each peer heard lately, whether its heard-bitmap has us   alone_s: since it began to listen
    """
    answers = list(heard_by)
    return all(answers) if answers else alone_s >= least_alone_s
