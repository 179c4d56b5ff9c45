"""Records of a damaged log in order, with a drop record for every gap that a bad chunk has left.

Decides whether the end mark still holds. If it does, what is missing in front of it is named too, and the log
has its end. Knows record numbers, not bytes.
"""

from __future__ import annotations

from collections.abc import Iterator

from hippomat_logs.records import DropRecord
from hippomat_logs.schema import CLASSES, TOPICS, MessageStore
from hippomat_logs.walk import Contents, RawMessage

CAUSE = "the chunk that held them is damaged"


class NamedGaps:
    """One log's gaps. Faults of single records are noted in contents.damage."""

    def __init__(self, contents: Contents, store: MessageStore) -> None:
        self._contents = contents
        self._store = store
        self._expected = 0  # number of the next record; 0: no record was met
        self._time_ns = 0
        self.made = 0  # drop records that the log itself did not hold
        self.end: dict[str, str] = {}  # the end mark, once all was read; empty: the log's end is lost

    def filled(self, raws: Iterator[RawMessage]) -> Iterator[RawMessage]:
        """Every message, and the drop records; stops at what does not decode or stands in the wrong order."""
        for raw in raws:
            if raw.topic not in CLASSES:
                yield raw
                continue
            expected = self._expected or self._first_record
            try:
                message = self._store.decode(CLASSES[raw.topic], raw.data)
            except Exception as error:
                self._contents.damage.append(f"record {raw.number} does not decode: {error}")
                return
            first = message.first if isinstance(message, DropRecord) else raw.number
            if first < expected:
                self._contents.damage.append(f"record {raw.number} follows record {expected - 1}")
                return
            if first > expected:
                yield self._drop(expected, first - 1, raw.log_time_ns)
            self._expected, self._time_ns = raw.number + 1, raw.log_time_ns
            yield raw
        yield from self._before_end_mark()

    def _before_end_mark(self) -> Iterator[RawMessage]:
        """The drop record of what the last chunks held, where the end mark says how far the log went."""
        if not (self._contents.end and self._contents.manifest):
            return
        expected, last = self._expected or self._first_record, int(self._contents.end["last_record"])
        if last < expected - 1:
            what = f"the end mark says that record {last} is the last, but record {expected - 1} is there"
            self._contents.damage.append(what)
            return
        if last > expected - 1:
            yield self._drop(expected, last, self._time_ns or self._started_ns)
        self.end = dict(self._contents.end)

    def _drop(self, first: int, last: int, log_time_ns: int) -> RawMessage:
        self.made += 1
        data = self._store.encode(DropRecord(first, last, CAUSE))
        return RawMessage(last, log_time_ns, TOPICS[DropRecord], data)

    @property
    def _first_record(self) -> int:
        return int(self._contents.manifest.get("first_record", "1"))

    @property
    def _started_ns(self) -> int:
        """On the log's clock, which has no time before 1970."""
        manifest = self._contents.manifest
        return max(0, int(manifest.get("started_ns", "0")) + int(manifest["wall_offset_ns"]))
