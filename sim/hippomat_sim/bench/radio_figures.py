"""Counts of a run of `hippomat-bench radio`: who should hear whom, what arrived, and how well times agree."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hippomat_core.wire.frames import RELAY, STATE
from hippomat_sim.air import Ended

_OFF_US = 2**62
_SLACK = 0.999  # of a span of time: rounds follow clocks that are a little off


class Expectation:
    """Who should hear whom: stations that are on, and links that are open, both for settling_us."""

    def __init__(self, hears: NDArray[np.bool_], settling_us: int, round_us: int) -> None:
        """hears: (S, S) [sender, receiver] pairs that are not hidden from each other."""
        self._settling_us, self._round_us = settling_us, round_us
        stations = len(hears)
        self._hears = hears
        self._on_since_us = np.full(stations, _OFF_US)
        self._linked_since_us = np.full((stations, stations), -settling_us)
        self._settled_since_us = np.full(stations, _OFF_US)
        self._rounds_before = np.zeros(stations, np.int64)  # of spans that are over
        nobody: NDArray[np.bool_] = np.zeros((stations, stations), bool)
        self.direct = nobody  # [sender, receiver]
        self.rows = nobody  # [holder, row], its own included

    def on(self, station: int, at_us: int) -> None:
        self._on_since_us[station] = at_us

    def off(self, station: int) -> None:
        self._on_since_us[station] = _OFF_US

    def part(self, stations: Iterable[int]) -> None:
        """These and the others do not hear each other from now on."""
        inside = np.zeros(len(self._hears), bool)
        inside[list(stations)] = True
        self._linked_since_us[inside[:, None] != inside] = _OFF_US

    def heal(self, at_us: int) -> None:
        self._linked_since_us[self._linked_since_us == _OFF_US] = at_us

    def update(self, now_us: int, before_change: Callable[[], None]) -> None:
        """What holds from now on; before_change is called while the old still holds, if anything changes."""
        settled = self._on_since_us <= now_us - self._settling_us
        linked = (self._linked_since_us <= now_us - self._settling_us) & settled & settled[:, None]
        if (linked != self.rows).any():
            before_change()
            self._count(settled, now_us)
            self.rows, self.direct = linked, linked & self._hears

    def _count(self, settled: NDArray[np.bool_], now_us: int) -> None:
        before = self._settled_since_us < _OFF_US
        self._rounds_before[before & ~settled] += self._rounds_since(now_us)[before & ~settled]
        self._settled_since_us[settled & ~before] = now_us
        self._settled_since_us[~settled] = _OFF_US

    def _rounds_since(self, now_us: int) -> NDArray[np.int64]:
        spans_us = np.maximum(now_us - self._settled_since_us, 0)
        rounds: NDArray[np.int64] = (_SLACK * spans_us / self._round_us).astype(np.int64)
        return rounds

    def rounds_due(self, now_us: int) -> NDArray[np.int64]:
        """(S,) the whole rounds for which each station was settled, from the time alone."""
        return self._rounds_before + self._rounds_since(now_us)

    def groups(self) -> list[NDArray[np.int64]]:
        """The settled stations, those together that expect the same rows."""
        groups: dict[bytes, list[int]] = {}
        for station in np.flatnonzero(self.rows.diagonal()):
            groups.setdefault(self.rows[station].tobytes(), []).append(int(station))
        return [np.array(members) for members in groups.values()]


class DirectDelivery:
    """Frames that reach those who should hear them, by pair; for Medium.pop_ended()'s transmissions."""

    def __init__(self, expected: Expectation) -> None:
        stations = len(expected.direct)
        self._expected = expected
        self.due = np.zeros((stations, stations), np.int64)  # [sender, receiver], STATE
        self.got = np.zeros((stations, stations), np.int64)
        self.sent = np.zeros(stations, np.int64)  # STATEs of settled stations
        self.frames = {STATE: 0, RELAY: 0}
        self.bytes = {STATE: 0, RELAY: 0}

    def __call__(self, ended: Ended) -> None:
        kind = ended.frame[0] & 7
        if kind not in self.frames:
            return
        self.frames[kind] += 1
        self.bytes[kind] += len(ended.frame)
        if kind == STATE:
            row = self._expected.direct[ended.sender]
            self.sent[ended.sender] += self._expected.rows[ended.sender, ended.sender]
            self.due[ended.sender] += row
            self.got[ended.sender, ended.receivers] += row[ended.receivers]

    def mean_bytes(self, kind: int) -> int:
        return round(self.bytes[kind] / self.frames[kind]) if self.frames[kind] else 0


class Snapshots:
    """Rows that are held at the end of the rounds, by what the hosts are told."""

    def __init__(self, expected: Expectation) -> None:
        stations = len(expected.rows)
        self._expected = expected
        self.due = np.zeros((stations, stations), np.int64)  # [holder, row], without its own
        self.got = np.zeros((stations, stations), np.int64)
        self.told = np.zeros(stations, np.int64)  # rounds, of settled stations
        self.judged = self.complete = self.wrong_rows = 0  # snapshots: one a robot and round
        self.rounds = self.identical = 0  # rounds of a group of robots

    def add(self, told: NDArray[Any]) -> None:
        """Rounds that were told under the present expectation."""
        rows = self._expected.rows
        told = told[rows.diagonal()[told["station"]]]
        held = (told["held"][:, None] >> np.arange(len(rows), dtype=np.uint64) & 1).astype(bool)
        station = told["station"]
        for holder in np.unique(station):
            due = rows[holder] & (np.arange(len(rows)) != holder)
            mine = held[station == holder]
            self.due[holder] += due * len(mine)
            self.got[holder] += (mine & due).sum(0)
            self.complete += int((mine | ~rows[holder]).all(1).sum())
            self.judged += len(mine)
            self.told[holder] += len(mine)
        self.wrong_rows += int(told["wrong"].sum())
        for members in self._expected.groups():
            of_group = np.isin(station, members)
            self._compare(told["round"][of_group], held[of_group] & rows[members[0]], len(members))

    def _compare(self, rounds: NDArray[Any], held: NDArray[np.bool_], size: int) -> None:
        """Rounds of which the whole group was told here, and those in which all hold the same rows."""
        order = np.argsort(rounds, kind="stable")
        numbers, first, counts = np.unique(rounds[order], return_index=True, return_counts=True)
        for begin in first[counts == size] if len(numbers) else ():
            these = held[order[begin : begin + size]]
            self.rounds += 1
            self.identical += bool((these == these[0]).all())


@dataclass(frozen=True, slots=True)
class Share:
    """Parts of 1: over everything, and of the pair or station that fares worst. NaN where nothing was due."""

    mean: float
    worst: float


def share(got: NDArray[np.int64], due: NDArray[np.int64]) -> Share:
    """The worst is taken of those with at least ten due, or of those with the most if none has ten."""
    if not due.sum():
        return Share(float("nan"), float("nan"))
    enough = due >= min(10, due.max())
    return Share(float(got.sum() / due.sum()), float((got[enough] / due[enough]).min()))


def kept(done: NDArray[np.int64], due: NDArray[np.int64]) -> Share:
    """The same by station, where more was done than due is no gain."""
    return share(np.minimum(done, due), due)


class Agreement:
    """Fleet times of all settled stations at one moment: the widest difference within a part."""

    def __init__(self, expected: Expectation) -> None:
        self._expected = expected
        self.at_us: list[int] = []
        self.spread_us: list[int] = []

    def sample(self, now_us: int, times_us: NDArray[np.int64]) -> None:
        """times_us: (S,) of every station."""
        groups = self._expected.groups()
        if groups:
            self.at_us.append(now_us)
            self.spread_us.append(max(int(np.ptp(times_us[members])) for members in groups))
