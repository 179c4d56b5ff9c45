"""What one robot heard of each sender: frames that came and were lost, signal strength, age of what it knew.

Lost are the gaps in a sender's sequence numbers, per boot; what it sent before the first and after the last
frame that was heard is not known here. Everything is measured by the receiver's own clock.

Age of information (Kaul, Yates, Gruteser 2012): time since the newest STATE of the sender was read. Its time
average over gaps g_1, g_2 ... between STATEs is sum(g^2 / 2) / sum(g); for frames sent every T and lost with
probability p, independently, that is T (1 + p) / (2 (1 - p)).
"""

from __future__ import annotations

import math
from array import array
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.errors import LogError
from hippomat_core.fleet.rows import HEARD_DIRECTLY
from hippomat_core.fleet.snapshot import LATE_ROUNDS
from hippomat_logs.metrics.samples import CAPACITY

Heard = m.StateHeard | m.RelayHeard | m.TasksHeard | m.StopHeard


@dataclass(frozen=True, slots=True)
class LinkMetrics:
    """One direction: a sender as this robot heard it. nan: nothing to measure."""

    sender: int
    received: int
    lost: int
    rssi_dbm: float = math.nan  # median
    rssi_low_dbm: float = math.nan  # 5th percentile
    state_age_ms: float = math.nan  # time average of the age of the newest STATE heard from it
    longest_gap_ms: float = math.nan  # between two of its STATEs
    row_age_ms: float = math.nan  # mean age of its row in decisions, relayed ones included
    row_age_95_ms: float = math.nan
    rows_direct: int = 0  # decisions whose row of it was of that round and came in its own STATE
    rows_relayed: int = 0  # the same, passed on by a third robot
    rows_late: int = 0  # decisions on an older row, or on none

    @property
    def loss(self) -> float:
        """0 .. 1; 0 where nothing was to be heard."""
        total = self.received + self.lost
        return self.lost / total if total else 0.0

    @property
    def delivery(self) -> float:
        """0 .. 1; nan where nothing was to be heard."""
        total = self.received + self.lost
        return self.received / total if total else math.nan

    @property
    def in_time(self) -> float:
        """Share of decisions that had its row of that round, however it came."""
        had = self.rows_direct + self.rows_relayed
        return had / (had + self.rows_late) if had + self.rows_late else math.nan


class _Sequences:
    """Which numbers of one sender and boot were heard: a bit each (a set would need 40 bytes)."""

    def __init__(self) -> None:
        self._bits = bytearray()
        self._low, self._high = 1 << 32, -1
        self.received = 0

    def add(self, number: int) -> None:
        byte, bit = number >> 3, 1 << (number & 7)
        if byte >= len(self._bits):
            self._bits.extend(bytes(byte + 1 - len(self._bits)))
        if not self._bits[byte] & bit:
            self._bits[byte] |= bit
            self.received += 1
            self._low, self._high = min(self._low, number), max(self._high, number)

    @property
    def lost(self) -> int:
        return self._high - self._low + 1 - self.received


class _Gaps:
    """Times between STATEs of one sender."""

    def __init__(self) -> None:
        self._last_ns = -1
        self._time_s = self._area_s2 = self._longest_s = 0.0

    def add(self, stamp_ns: int) -> None:
        if self._last_ns >= 0 and stamp_ns > self._last_ns:
            gap_s = (stamp_ns - self._last_ns) / 1e9
            self._time_s += gap_s
            self._area_s2 += gap_s * gap_s / 2.0
            self._longest_s = max(self._longest_s, gap_s)
        self._last_ns = max(self._last_ns, stamp_ns)

    def figures_ms(self) -> tuple[float, float]:
        """(time-average age, longest gap)."""
        if not self._time_s:
            return math.nan, math.nan
        return 1e3 * self._area_s2 / self._time_s, 1e3 * self._longest_s


class LinkReading:
    """Frames and decisions as they come, of one receiver."""

    def __init__(self, robot: int, size: int, round_s: float) -> None:
        self._robot = robot
        self._sequences: dict[tuple[int, int], _Sequences] = defaultdict(_Sequences)  # (sender, boot)
        self._rssi: dict[int, list[int]] = defaultdict(lambda: [0] * 256)  # sender -> how often -128 .. 127
        self._gaps: dict[int, _Gaps] = defaultdict(_Gaps)
        self._rows = _Rows(size, LATE_ROUNDS * round_s * 1e3)

    def heard(self, message: Heard) -> None:
        header = message.header
        self._sequences[header.sender, header.boot].add(header.sequence)
        self._rssi[header.sender][message.rssi_dbm + 128] += 1
        if isinstance(message, m.StateHeard):
            self._gaps[header.sender].add(message.stamp_ns)

    def decided(self, decision: m.RoundDecided) -> None:
        self._rows.add(decision)

    def result(self) -> list[LinkMetrics]:
        """By sender. Peers that were never heard are there too, once a decision had a place for them."""
        senders = {sender for sender, _ in self._sequences} | self._rows.owners
        return [self._link(sender) for sender in sorted(senders - {self._robot})]

    def _link(self, sender: int) -> LinkMetrics:
        state_age_ms, gap_ms = self._gaps[sender].figures_ms()
        age_ms, age_95_ms, direct, relayed, late = self._rows.figures(sender)
        boots = [one for (of, _), one in self._sequences.items() if of == sender]
        median, low = _of_histogram(self._rssi[sender], (0.5, 0.05))
        return LinkMetrics(
            sender,
            sum(one.received for one in boots),
            sum(one.lost for one in boots),
            median,
            low,
            state_age_ms,
            gap_ms,
            age_ms,
            age_95_ms,
            direct,
            relayed,
            late,
        )


class _Rows:
    """Ages and ways of the rows that decisions were made on, by owner; (N,) each."""

    def __init__(self, size: int, late_ms: float) -> None:
        self._size, self._late_ms = size, late_ms
        self._ages_ms = array("H")  # of every `stride`-th decision, N each
        self._decisions, self._stride = 0, 1
        self._sums = np.zeros((5, size), np.int64)  # direct, relayed, late, heard, age [ms] of those

    def add(self, decision: m.RoundDecided) -> None:
        ages = decision.row_age_ms
        if len(ages) != self._size:
            raise LogError(f"a decision has {len(ages)} rows in a fleet of {self._size} robots")
        fresh, direct = ages <= self._late_ms, decision.row_via == HEARD_DIRECTLY
        heard = ages != m.NEVER_HEARD_MS
        self._sums += (fresh & direct, fresh & ~direct, ~fresh, heard, ages * heard)
        if self._decisions % self._stride == 0:
            self._ages_ms.frombytes(np.ascontiguousarray(ages, np.uint16).tobytes())
            if len(self._ages_ms) >= CAPACITY * self._size:
                self._ages_ms = array("H", self._table()[::2].tobytes())
                self._stride *= 2
        self._decisions += 1

    @property
    def owners(self) -> set[int]:
        return set(range(self._size)) if self._decisions else set()

    def _table(self) -> NDArray[np.uint16]:
        return np.frombuffer(self._ages_ms, np.uint16).reshape(-1, self._size)

    def figures(self, owner: int) -> tuple[float, float, int, int, int]:
        """(mean age, 95th percentile [ms], direct, relayed, late)."""
        if owner >= self._size or not self._decisions:
            return math.nan, math.nan, 0, 0, 0
        direct, relayed, late, heard, total_ms = self._sums[:, owner].tolist()
        ages = self._table()[:, owner]
        ages = ages[ages != m.NEVER_HEARD_MS]
        high = float(np.percentile(ages, 95)) if ages.size else math.nan
        return total_ms / heard if heard else math.nan, high, direct, relayed, late


def _of_histogram(counts: list[int], shares: tuple[float, ...]) -> list[float]:
    """Quantiles of whole dBm, exactly; nan where nothing was counted."""
    total, sums = sum(counts), np.cumsum(counts)
    return [
        float(np.searchsorted(sums, max(1, math.ceil(share * total)))) - 128 if total else math.nan
        for share in shares
    ]
