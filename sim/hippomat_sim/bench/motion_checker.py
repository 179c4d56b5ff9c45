"""Did any two robots touch, and is every move a move? Shares no code with the planners that it judges.

Everything is looked at as geometry: robots are points that move straight and evenly from cell centre to cell
centre, and two of them collide where they come nearer than NEAREST cells at any moment, not only at ticks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Round a corner one after the other, robots come as near as 0.71 cells; with diagonals as 0.45.
NEAREST = 0.4


@dataclass(frozen=True, slots=True)
class Move:
    """From cell to cell, [ix, iy, iz], between two ticks."""

    robot: int
    begin: int
    end: int
    tail: tuple[int, int, int]
    head: tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Verdict:
    """meetings: at a tick (a cell with two robots) and between ticks (swaps, crossings)."""

    at_ticks: int
    between_ticks: int
    wrong_moves: tuple[str, ...]
    nearest: float  # [cells] that two robots ever came to each other; inf for one robot

    @property
    def collisions(self) -> int:
        return self.at_ticks + self.between_ticks


def judge(
    free: NDArray[np.bool_],
    starts: NDArray[np.int32],
    moves: Sequence[Move],
    ticks_of_move: Sequence[int],
    ticks: int,
    diagonals: bool,
) -> Verdict:
    """A run of so many ticks. free: (Z, Y, X)   starts: (N, 3) [ix, iy, iz]"""
    at, wrong = _followed(free, starts, moves, ticks_of_move, ticks, diagonals)
    at_ticks = between = 0
    nearest = np.inf
    one, other = np.triu_indices(len(starts), 1)
    for tick in range(ticks):
        before, after = (at[t, one] - at[t, other] for t in (tick, tick + 1))
        along = after - before
        length2 = (along * along).sum(axis=1)
        share = np.clip(-(before * along).sum(axis=1) / np.maximum(length2, 1e-12), 0.0, 1.0)
        gap = np.linalg.norm(before + share[:, None] * along, axis=1)
        meets_after = np.linalg.norm(after, axis=1) < NEAREST
        at_ticks += int(meets_after.sum())
        between += int(((gap < NEAREST) & ~meets_after & (np.linalg.norm(before, axis=1) >= NEAREST)).sum())
        nearest = min(nearest, float(gap.min(initial=np.inf)))
    return Verdict(at_ticks, between, tuple(wrong), nearest)


def _followed(
    free: NDArray[np.bool_],
    starts: NDArray[np.int32],
    moves: Sequence[Move],
    ticks_of_move: Sequence[int],
    ticks: int,
    diagonals: bool,
) -> tuple[NDArray[np.float64], list[str]]:
    """(ticks + 1, N, 3) where everyone is at each tick, and the moves that cannot be."""
    at = np.repeat(starts[None].astype(np.float64), ticks + 1, axis=0)
    ends = np.zeros(len(starts), np.int64)
    wrong = []
    for move in moves:
        robot, begin, end = move.robot, move.begin, move.end
        fault = _fault(free, move, ticks_of_move[robot], diagonals)
        if begin < ends[robot]:
            fault = "it begins before the one before has ended"
        elif tuple(at[min(begin, ticks), robot]) != move.tail:
            fault = "it begins elsewhere than where the robot is"
        if fault:
            wrong.append(f"robot {robot} at tick {begin}: {move.tail} to {move.head}: {fault}")
        ends[robot] = end
        for tick in range(begin, min(end, ticks) + 1):
            share = (tick - begin) / (end - begin)
            at[tick, robot] = np.array(move.tail) + share * (np.array(move.head) - np.array(move.tail))
        at[min(end, ticks + 1) :, robot] = move.head
    return at, wrong


def _fault(free: NDArray[np.bool_], move: Move, ticks: int, diagonals: bool) -> str:
    (ax, ay, az), (bx, by, bz) = move.tail, move.head
    sides = (abs(ax - bx), abs(ay - by), abs(az - bz))
    if move.end - move.begin != ticks:
        return f"it takes {move.end - move.begin} ticks, not {ticks}"
    if max(sides) != 1 or (sum(sides) > 1 and not diagonals):
        return "the cells are not neighbours"
    if min(ax, ay, az, bx, by, bz) < 0:
        return "it leaves the map"
    box = free[min(az, bz) : max(az, bz) + 1, min(ay, by) : max(ay, by) + 1, min(ax, bx) : max(ax, bx) + 1]
    if box.size != np.prod(np.array(sides) + 1):
        return "it leaves the map"
    return "" if box.all() else "it touches a cell that is not free"
