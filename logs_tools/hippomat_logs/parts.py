"""The parts of one run, one after the other: rotation by size and age, and what happens when the disk fails.

A failed write never stops the run: the part is abandoned, its unwritten chunk is tried once in a new part,
and what cannot be kept is named by a drop record as soon as there is room again. Knows encoded records only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from hippomat_logs.part import END_METADATA, PartWriter, our_channels
from hippomat_logs.records import DropRecord
from hippomat_logs.schema import LATCHED, TOPICS, MessageStore
from hippomat_logs.sink import SinkOpener

RETRY_S = 1.0
MAX_PARTS = 1000


class Encoded(NamedTuple):
    """A message ready for the file; `derived` ones repeat their source's number and are not counted."""

    topic: str
    number: int
    log_time_ns: int
    data: bytes
    derived: bool = False


class PartSeries:
    """Writes records into NAME_000.mcap, NAME_001.mcap ...; add() and maintain() never raise OSError."""

    def __init__(
        self,
        open_sink: SinkOpener,
        name: str,
        manifest: Mapping[str, str],
        store: MessageStore,
        part_bytes: int,
        part_s: float = 0.0,
        attachments: Mapping[str, bytes] | None = None,
    ) -> None:
        """part_s: no part spans more time than this; 0: any."""
        self._open_sink = open_sink
        self._name = name
        self._manifest = dict(manifest)
        self._store = store
        self._channels = our_channels(store)
        self._part_bytes = part_bytes
        self._part_s = part_s or float("inf")
        self._attachments = attachments or {}  # go into every part, as the manifest does
        self._begun_s: float | None = None  # when the part's first records were written
        self._part: PartWriter | None = None
        self._head_bytes = (
            0  # of the part: manifest, attachments and channels, which do not count for rotation
        )
        self._index = 0  # of the next part
        self._retry_at_s = 0.0
        self._pending: list[Encoded] = []  # given to the part's open chunk, not yet in the file
        self._latched: dict[str, Encoded] = {}
        self._lost: tuple[int, int] | None = None
        self._last_number = 0
        self._last_time_ns = 0
        self.problem = ""  # why the disk does not take records now, "" = it does
        self.lost_records = 0
        self.abandoned: list[str] = []

    @property
    def name(self) -> str:
        """File name of the newest part."""
        return f"{self._name}_{max(self._index - 1, 0):03d}.mcap"

    def open(self) -> None:
        """Begin the first part; raises OSError where the directory cannot be written at all."""
        self._begin(first_record=1)

    def add(self, record: Encoded, now_s: float) -> None:
        self._last_time_ns = record.log_time_ns
        if record.topic in LATCHED:
            self._latched[record.topic] = record
        if not record.derived:
            self._last_number = record.number
        if self._part is None and not self._reopened(record, now_s):
            self._lose([record])
            return
        self._pending.append(record)
        self._part.add(*record[:4])  # type: ignore[union-attr]  # _reopened() has made one

    def add_all(self, records: Sequence[Encoded], now_s: float) -> None:
        """Many at once cost half."""
        if self._part is None:
            for record in records:
                self.add(record, now_s)
            return
        for record in records:
            if not record.derived:
                self._last_number, self._last_time_ns = record.number, record.log_time_ns
            elif record.topic in LATCHED:
                self._latched[record.topic] = record
        self._pending += records
        self._part.add_all(records)

    def flush(self, now_s: float) -> None:
        """Put the open chunk onto the disk; afterwards rotate if the part is large or old enough."""
        if self._part is None:
            return
        try:
            self._part.flush()
            self._pending.clear()  # in the file: should the disk not take it, a new part must not repeat it
            self._part.sink.sync()
        except OSError as error:
            self._fail(error, now_s)
            return
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        size = self._part.sink.tell() - self._head_bytes
        if size >= self._part_bytes or (size and now_s - self._begun_s >= self._part_s):
            self._rotate(now_s)

    def close(self, now_s: float, facts: Mapping[str, str]) -> None:
        """Finish the last part with `facts` in its end mark; what was lost and could not be said is left in
        lost_records."""
        if self._part is None and self._lost is not None:
            self._retry_at_s = now_s
            self._reopened(Encoded("", self._last_number + 1, self._last_time_ns, b""), now_s)
        self.flush(now_s)
        if self._part is not None:
            self._finish(self._part, {**facts, "final": "yes"})

    # ---- inside ----

    def _write(self, record: Encoded) -> None:
        assert self._part is not None
        self._pending.append(record)
        self._part.add(record.topic, record.number, record.log_time_ns, record.data)

    def _begin(self, first_record: int) -> None:
        for _ in range(MAX_PARTS):
            file_name = f"{self._name}_{self._index:03d}.mcap"
            try:
                sink = self._open_sink(file_name)
            except FileExistsError:
                self._index += 1
                continue
            break
        else:
            raise FileExistsError(f"{self._name}_000.mcap and {MAX_PARTS} more exist")
        facts = {**self._manifest, "part": str(self._index), "first_record": str(first_record)}
        part = PartWriter(sink, facts, self._channels, self._attachments)
        try:
            part.flush()
        except OSError:
            sink.abandon()
            raise
        self._index += 1
        self._part, self._head_bytes, self._begun_s = part, sink.tell(), None
        for latched in self._latched.values():
            self._write(latched)

    def _reopened(self, record: Encoded, now_s: float) -> bool:
        """Try to begin a part that starts with what was lost before `record`."""
        if now_s < self._retry_at_s:
            return False
        first = self._lost[0] if self._lost else first_last(record, self._store)[0]
        try:
            self._begin(first)
        except OSError as error:
            self._stop(error, now_s)
            return False
        self.problem, cause = "", self.problem
        if self._lost is not None:
            drop = DropRecord(*self._lost, cause)
            topic = TOPICS[DropRecord]
            self._write(Encoded(topic, drop.last, self._last_time_ns, self._store.encode(drop)))
            self._lost = None
        return True

    def _rotate(self, now_s: float) -> None:
        part, self._part = self._part, None
        assert part is not None
        if self._finish(part, {"final": "no"}):
            try:
                self._begin(self._last_number + 1)
            except OSError as error:
                self._stop(error, now_s)

    def _finish(self, part: PartWriter, facts: Mapping[str, str]) -> bool:
        try:
            part.finish(END_METADATA, {"last_record": str(self._last_number), **facts})
        except OSError as error:
            self.problem = f"the log could not be finished: {error}"
            self._abandon(part)
            return False
        return True

    def _fail(self, error: OSError, now_s: float) -> None:
        """The open chunk did not get into the file: try it once in a new part."""
        pending, self._pending = self._pending, []
        part, self._part = self._part, None
        assert part is not None
        self._abandon(part)
        numbered = [record for record in pending if not record.derived]
        try:
            self._begin(first_last(numbered[0], self._store)[0] if numbered else self._last_number + 1)
            assert self._part is not None
            for record in numbered:
                self._write(record)
            self._part.flush()
            self._pending.clear()
        except OSError:
            if self._part is not None:
                self._abandon(self._part)
            self._part, self._pending = None, []
            self._stop(error, now_s)
            self._lose(numbered)

    def _abandon(self, part: PartWriter) -> None:
        self.abandoned.append(f"{self._name}_{self._index - 1:03d}.mcap")
        part.sink.abandon()

    def _stop(self, error: OSError, now_s: float) -> None:
        self.problem = f"disk: {error.strerror or error}"
        self._retry_at_s = now_s + RETRY_S

    def _lose(self, records: list[Encoded]) -> None:
        numbers = [first_last(r, self._store) for r in records if not r.derived]
        if not numbers:
            return
        first = self._lost[0] if self._lost else numbers[0][0]
        self._lost = (first, numbers[-1][1])
        self.lost_records += sum(last - first + 1 for first, last in numbers)


def first_last(record: Encoded, store: MessageStore) -> tuple[int, int]:
    """Numbers that a record stands for: a drop record stands for all that it names."""
    if record.topic == TOPICS[DropRecord]:
        drop = store.decode(DropRecord, record.data)
        return drop.first, drop.last
    return record.number, record.number
