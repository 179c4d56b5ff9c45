"""The queue between a control loop and the log's writer: bounded, and the loop never waits for it.

Decides what is left out where the writer is too slow: bulk first. That is counted and named in its place. One
thread puts, another takes. Knows what is bulk, nothing else of what records mean.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

from hippomat_core.messages import LIDAR
from hippomat_logs.records import SerialRecord, is_bulk

_PORT = 1 + [one.name for one in fields(SerialRecord)].index("port")  # in the tuple of a SerialRecord
_FULL = "queue full: the disk was too slow"
_FILLING = "queue half full: bulk was shed"


@dataclass(slots=True)
class LeftOut:
    """Stands in the place of `count` records, the last of which came at stamp_ns."""

    stamp_ns: int
    count: int
    cause: str


class RecordQueue:
    """Entries are (stamp, record); a record is a message, its class and its fields, or a LeftOut.

    has_taker: where nothing may be left out, put() waits for room as long as this is true.
    """

    # Whoever puts has just slept, so that everything it touches must be fetched into the caches again. Hence
    # slots, and `_credit`: a call of len() alone would be a third of put().
    __slots__ = (
        "_credit", "_gap", "_granted", "_half", "_has_taker", "_limit", "_spent", "dropped", "entries",
        "shed",
    )  # fmt: skip

    def __init__(self, limit: int, has_taker: Callable[[], bool] | None = None) -> None:
        self.entries: deque[tuple[int, Any]] = deque()
        self._limit, self._half = limit, limit // 2
        self._credit = self._half  # puts that find less than half a queue, whatever is taken meanwhile
        self._granted, self._spent = self._credit, 0  # when it was granted; puts before
        self._has_taker = has_taker
        self._gap: LeftOut | None = None  # records that found no room, not in the queue yet
        self.dropped = self.shed = 0

    @property
    def numbered(self) -> int:
        """Records so far, those left out included."""
        return self._spent + self._granted - self._credit

    @property
    def drop_cause(self) -> str:
        """Why records are left out just now; "" while there is room."""
        return self._gap.cause if self._gap is not None else ""

    def put(self, stamp_ns: int, record: Any) -> None:
        self._credit -= 1
        if self._credit >= 0 or self._takes(stamp_ns, record):
            self.entries.append((stamp_ns, record))

    def serial(self, stamp_ns: int, port: int, direction: int, phase: int, data: bytes) -> None:
        """put() of a SerialRecord; repeats its lines, because this is half of all calls."""
        record = SerialRecord, stamp_ns, port, direction, phase, data if type(data) is bytes else bytes(data)
        self._credit -= 1
        if self._credit >= 0 or self._takes(stamp_ns, record):
            self.entries.append((stamp_ns, record))

    def is_hurried(self) -> bool:
        """Does the writer fall behind, although it may not be waited for?"""
        return self._has_taker is None and len(self.entries) > self._limit // 4

    def end(self) -> None:
        """Nothing more is put."""
        self._end_gap()

    def left(self) -> int:
        """Records in it, once nobody takes them any more."""
        return sum(type(record) is not LeftOut for _, record in self.entries)

    # ---- inside ----

    def _takes(self, stamp_ns: int, record: Any) -> bool:
        """Is there room? If so, what was left out before is named; if not, the record is counted."""
        waiting = len(self.entries)
        self._spent, self._granted, self._credit = self.numbered, 0, 0
        if self._has_taker is not None:
            while len(self.entries) >= self._limit and self._has_taker():
                time.sleep(0.002)
        elif waiting >= self._limit:
            self.dropped += 1
            self._leave_out(stamp_ns, _FULL)
            return False
        elif waiting >= self._half and may_go(record):
            self.shed += 1
            self._leave_out(stamp_ns, _FILLING)
            return False
        self._end_gap()
        self._granted = self._credit = max(0, self._half - len(self.entries) - 1)
        return True

    def _leave_out(self, stamp_ns: int, cause: str) -> None:
        if self._gap is not None and self._gap.cause != cause:
            self._end_gap()
        if self._gap is None:
            self._gap = LeftOut(stamp_ns, 0, cause)
        self._gap.stamp_ns, self._gap.count = stamp_ns, self._gap.count + 1

    def _end_gap(self) -> None:
        """Put what found no room, if anything."""
        if self._gap is not None:
            self.entries.append((self._gap.stamp_ns, self._gap))
            self._gap = None


def may_go(record: Any) -> bool:
    """Is it bulk?"""
    if type(record) is tuple:
        return record[0] is SerialRecord and record[_PORT] == LIDAR
    return is_bulk(record)


def kind_of(record: Any) -> type:
    return record[0] if type(record) is tuple else type(record)
