"""The queue between a control loop and the log's writer: bounded, and the loop never waits for it.

Decides record numbers and, where the writer is too slow, what is left out: bulk first. That is counted and
named by a drop record. One thread puts, another takes. Knows what is bulk, nothing else of what records mean.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import fields
from typing import Any

from hippomat_core.messages import LIDAR
from hippomat_logs.records import DropRecord, SerialRecord, is_bulk

_PORT = 1 + [one.name for one in fields(SerialRecord)].index("port")  # in the tuple of a SerialRecord
_FULL = "queue full: the disk was too slow"
_FILLING = "queue half full: bulk was shed"


class RecordQueue:
    """Entries are (number, log time, record); a record is a message, or its class and its fields.

    offset_ns: from stamps to log times. has_taker: where nothing may be left out, put() waits for room as
    long as this is true.
    """

    # Slots, because whoever puts has just slept: what it needs then lies close together.
    __slots__ = (
        "_dropping", "_half", "_has_taker", "_limit", "_next", "_offset_ns", "dropped", "entries", "last_ns",
        "shed",
    )  # fmt: skip

    def __init__(
        self, limit: int, offset_ns: int, last_ns: int, has_taker: Callable[[], bool] | None = None
    ) -> None:
        self.entries: deque[tuple[int, int, Any]] = deque()
        self._limit, self._half = limit, limit // 2
        self._offset_ns = offset_ns
        self._has_taker = has_taker
        self._next = 1
        self._dropping: tuple[int, str] | None = None  # first of the records that found no room, and why
        self.last_ns = last_ns  # log time of the last record: of a drop record too, whatever the clock does
        self.dropped = self.shed = 0

    @property
    def numbered(self) -> int:
        """Records so far, those left out included."""
        return self._next - 1

    @property
    def drop_cause(self) -> str:
        """Why records are left out just now; "" while there is room."""
        return self._dropping[1] if self._dropping is not None else ""

    def put(self, stamp_ns: int, record: Any) -> None:
        number = self._next
        self._next = number + 1
        if (self._dropping is not None or len(self.entries) >= self._half) and not self._takes(
            number, record
        ):
            return
        self.last_ns = log_time_ns = stamp_ns + self._offset_ns
        self.entries.append((number, log_time_ns, record))

    def serial(self, stamp_ns: int, port: int, direction: int, phase: int, data: bytes) -> None:
        """put() of a SerialRecord; repeats its lines, because this is half of all calls."""
        number = self._next
        self._next = number + 1
        record = SerialRecord, stamp_ns, port, direction, phase, bytes(data)
        if (self._dropping is not None or len(self.entries) >= self._half) and not self._takes(
            number, record
        ):
            return
        self.last_ns = log_time_ns = stamp_ns + self._offset_ns
        self.entries.append((number, log_time_ns, record))

    def is_hurried(self) -> bool:
        """Does the writer fall behind, although it may not be waited for?"""
        return self._has_taker is None and len(self.entries) > self._limit // 4

    def end(self) -> None:
        """Nothing more is put."""
        self._end_drop(self._next)

    def left(self) -> int:
        """Records in it that nobody has counted as lost yet, should nobody take them any more."""
        return sum(type(record) is not DropRecord for _, _, record in tuple(self.entries))

    # ---- inside ----

    def _takes(self, number: int, record: Any) -> bool:
        """Is there room in a queue that is half full or more? If so, what was dropped before is named; if
        not, the record is counted."""
        waiting = len(self.entries)
        if self._has_taker is not None:
            while len(self.entries) >= self._limit and self._has_taker():
                time.sleep(0.002)
        elif waiting >= self._limit:
            self.dropped += 1
            self._drop(number, _FULL)
            return False
        elif waiting >= self._half and may_go(record):
            self.shed += 1
            self._drop(number, _FILLING)
            return False
        self._end_drop(number)
        return True

    def _drop(self, number: int, cause: str) -> None:
        if self._dropping is not None and self._dropping[1] != cause:
            self._end_drop(number)
        if self._dropping is None:
            self._dropping = number, cause

    def _end_drop(self, before: int) -> None:
        """Put the drop record of what found no room before number `before`."""
        if self._dropping is not None:
            (first, cause), self._dropping = self._dropping, None
            self.entries.append((before - 1, self.last_ns, DropRecord(first, before - 1, cause)))


def may_go(record: Any) -> bool:
    """Is it bulk?"""
    if type(record) is tuple:
        return record[0] is SerialRecord and record[_PORT] == LIDAR
    return is_bulk(record)


def kind_of(record: Any) -> type:
    return record[0] if type(record) is tuple else type(record)
