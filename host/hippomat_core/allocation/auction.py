"""Allocation by auction and consensus, one task per robot (CBAA: Choi, Brunet and How 2009, "Consensus-based
decentralized auctions for robust task allocation", algorithms 1 and 2). Knows costs, not maps or radios.

In a message round every robot without a task bids for the cheapest one where it beats the best bid it has
heard, then all broadcast and keep the best bid of every task; who is outbid is without a task again. A bid is
the pair (cost, id), the smaller wins, as with claims. The auction is over when nobody bids.

Here every robot plays it out on the common snapshot, as it would run on a complete graph without loss. The
result is the stable matching, that of sequential greedy (greedy.py), in at most min(N, M) rounds. What it
adds is the number of rounds that a fleet would need which shares bids instead of rows of costs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.port import NO_LOGITS, Decision, Problem
from hippomat_core.config import MAX_ROBOTS

_NO_BID = np.iinfo(np.int64).max


@dataclass(frozen=True, slots=True, eq=False)
class Assignment:
    """slots: (N,) slot of every robot, -1 for none. rounds: message rounds in which somebody bid."""

    slots: NDArray[np.int64]
    rounds: int


def auction(costs_q: NDArray[np.uint8], eligible: NDArray[np.bool_]) -> Assignment:
    """The auction's end. costs_q: (N, M) codes  eligible: (N, M)."""
    robots, tasks = costs_q.shape
    ids = np.arange(robots)
    bids = np.where(
        eligible, costs_q.astype(np.int64) * MAX_ROBOTS + ids[:, None], _NO_BID
    )  # sorts by (cost, id)
    best = np.full(tasks, _NO_BID)  # of every task, as all have heard it
    slots = np.full(robots, -1, np.int64)
    rounds = 0
    while True:
        open_bids = np.where((slots < 0)[:, None] & (bids < best), bids, _NO_BID)
        wanted = open_bids.argmin(axis=1)  # of tasks that cost the same the smallest slot
        bidders = np.flatnonzero(open_bids[ids, wanted] < _NO_BID)
        if bidders.size == 0:
            return Assignment(slots, rounds)
        rounds += 1
        slots[bidders] = wanted[bidders]
        np.minimum.at(best, slots[bidders], bids[bidders, slots[bidders]])
        holders = np.flatnonzero(slots >= 0)
        outbid = bids[holders, slots[holders]] > best[slots[holders]]
        slots[holders[outbid]] = -1


class Auction:
    """Every robot plays the auction out on the common snapshot and takes its own part."""

    name = "auction"

    def allocate(self, problem: Problem) -> Decision:
        return Decision(int(self.actions(problem)[problem.self_index]), NO_LOGITS)

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        return auction(problem.costs_q, problem.eligible).slots + 1
