"""From which round a row in a decision is, and how old: its ledger names the frame that brought it.

Remembers the last frames heard, with their claims. Knows frames and rounds, no allocation. The rules of
fleet/hearing.py decide which row a robot holds; here they are only looked up.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.fleet.rows import HEARD_DIRECTLY
from hippomat_core.wire.frames import NO_SLOT, AirClaim, RelayRow
from hippomat_logs.definitions import Task
from hippomat_logs.fleet_story.values import NO_ROUND

_REMEMBERED_ROUNDS = 64  # a row held for longer is of no known round
_NEVER = -(10**18)
_Key = tuple[int, int, int]  # via, boot, sequence


@dataclass(frozen=True, slots=True)
class _Brought:
    round: int
    since_ns: int  # its age counts from here, log time
    claim: Task | None


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """What the ledger says of the N rows of one decision."""

    rounds: NDArray[np.int64]
    claims: tuple[Task | None, ...]
    ages_ns: NDArray[np.float64]  # inf: never heard
    alive_ns: NDArray[np.float64]  # age of the newest sign of life


class Ledger:
    """Frames as they were heard by one robot; log times."""

    def __init__(self, robot: int, size: int, round_us: int) -> None:
        self._robot, self._round_us = robot, round_us
        self._brought: list[OrderedDict[_Key, _Brought]] = [OrderedDict() for _ in range(size)]
        self._alive_ns = [_NEVER] * size

    def state(self, log_time_ns: int, event: m.StateHeard) -> None:
        sender = event.header.sender
        if sender < len(self._brought):
            number = event.header.fleet_time_us // self._round_us
            key = HEARD_DIRECTLY, event.header.boot, event.header.sequence
            self._bring(sender, key, _Brought(number, log_time_ns, _claim(event.frame.claim)))

    def relay(self, log_time_ns: int, event: m.RelayHeard) -> None:
        header, round_us = event.header, self._round_us
        key = header.sender, header.boot, header.sequence
        for row in event.frame.rows:
            if row.robot < len(self._brought) and row.robot != self._robot:
                number = header.fleet_time_us // round_us - row.age
                since_ns = log_time_ns - 1000 * (header.fleet_time_us - number * round_us)
                self._bring(row.robot, key, _Brought(number, since_ns, _claim(row)))

    def _bring(self, robot: int, key: _Key, brought: _Brought) -> None:
        held = self._brought[robot]
        held[key] = brought
        self._alive_ns[robot] = max(self._alive_ns[robot], brought.since_ns)
        oldest = next(iter(held))
        while held[oldest].round < brought.round - _REMEMBERED_ROUNDS:
            del held[oldest]
            oldest = next(iter(held))

    def rows(self, log_time_ns: int, decided: m.RoundDecided, before_ns: int, own: Task | None) -> Rows:
        """before_ns: of the round end before, when our own row was given to the radio; own: its claim."""
        n = len(decided.row_via)
        rounds, ages_ns = np.full(n, NO_ROUND, np.int64), np.full(n, np.inf)
        alive_ns, claims = np.full(n, np.inf), list[Task | None]([None] * n)
        keys = zip(
            np.asarray(decided.row_via).tolist(),
            np.asarray(decided.row_boot).tolist(),
            np.asarray(decided.row_sequence).tolist(),
            strict=True,
        )
        for k, key in enumerate(keys):
            if k == self._robot:
                rounds[k], ages_ns[k], claims[k] = decided.round, log_time_ns - before_ns, own
                alive_ns[k] = ages_ns[k]
                continue
            brought = self._brought[k].get(key) if k < len(self._brought) else None
            if brought is not None:
                rounds[k], ages_ns[k] = brought.round, log_time_ns - brought.since_ns
                claims[k] = brought.claim
                alive_ns[k] = log_time_ns - max(self._alive_ns[k], brought.since_ns)
        return Rows(rounds, tuple(claims), ages_ns, alive_ns)


def _claim(claim: AirClaim | RelayRow) -> Task | None:
    return None if claim.slot == NO_SLOT else (claim.slot, claim.generation)
