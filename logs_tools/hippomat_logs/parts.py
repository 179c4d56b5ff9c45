"""The parts of one run, one after the other: rotation by size and age, and what happens when the disk fails.

A failed write never stops the run: the part is abandoned, its unwritten chunk is tried once in a new part,
and what cannot be kept is named by a drop record as soon as there is room again. A part is ended in favour
of the next only once the next is on the disk, so that the last one always says that it is the last. Knows
encoded records only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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


@dataclass(slots=True)
class _OpenPart:
    """head_bytes: manifest, attachments and channels, which do not count for rotation."""

    writer: PartWriter
    file_name: str
    head_bytes: int
    begun_s: float | None = None  # when its first records were written


class PartSeries:
    """Writes records into NAME_000.mcap, NAME_001.mcap ...; only open() raises."""

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
        """part_s: a part that spans so much time is ended at the next flush; 0: any."""
        self._open_sink = open_sink
        self._name = name
        self._manifest = dict(manifest)
        self._store = store
        self._channels = our_channels(store)
        self._part_bytes = part_bytes
        self._part_s = part_s or float("inf")
        self._attachments = attachments or {}  # go into every part, as the manifest does
        self._part: _OpenPart | None = None
        self._index = 0  # of the next part
        self._retry_at_s = 0.0  # no part is begun before, neither the next nor one after a failure
        self._pending: list[Encoded] = []  # given to the part's open chunk, not yet in the file
        self._latched: dict[str, Encoded] = {}
        self._lost: tuple[int, int] | None = None
        self._why_lost = ""
        self._last_number = 0
        self._last_time_ns = 0
        self.name = f"{name}_000.mcap"  # of the newest part's file
        self.problem = ""  # why the disk does not take records, or no next part, now; "" = it does
        self.warning = ""  # what went wrong last although nothing need be lost by it: stays
        self.lost_records = 0
        self.abandoned: list[str] = []

    def open(self) -> None:
        """Begin the first part; raises OSError where the directory cannot be written at all."""
        self._take(self._begun(first_record=1))

    def add(self, record: Encoded, now_s: float) -> None:
        self.add_all((record,), now_s)

    def add_all(self, records: Sequence[Encoded], now_s: float) -> None:
        """Many at once cost half."""
        if not records:
            return
        if self._part is None and not self._reopened(records[0], now_s):
            self._lose(records)
            self._note(records)
            return
        assert self._part is not None  # _reopened() has made one
        try:
            self._part.writer.add_all(records)
        except Exception as error:  # what MCAP cannot hold must cost its batch, not the run
            self._fail(error, now_s)
            self._lose(records, str(error))
            self._name_lost()
            return
        self._pending += records
        self._note(records)

    def flush(self, now_s: float) -> None:
        """Put the open chunk onto the disk; afterwards rotate if the part is large or old enough."""
        part = self._part
        if part is None:
            return
        try:
            part.writer.flush()
            self._pending.clear()  # in the file: should the disk not take it, a new part must not repeat it
            part.writer.sink.sync()
        except Exception as error:
            self._fail(error, now_s)
            return
        part.begun_s = now_s if part.begun_s is None else part.begun_s
        size = part.writer.sink.tell() - part.head_bytes
        due = size >= self._part_bytes or (size and now_s - part.begun_s >= self._part_s)
        if due and now_s >= self._retry_at_s:
            self._rotate(part, now_s)

    def close(self, now_s: float, facts: Mapping[str, str]) -> None:
        """Finish the last part with `facts` in its end mark; what was lost and could not be said is left in
        lost_records."""
        if self._part is None and self._lost is not None:
            self._retry_at_s = now_s
            self._reopened(Encoded("", self._last_number + 1, self._last_time_ns, b""), now_s)
        self.flush(now_s)
        if self._part is not None:
            part, self._part = self._part, None
            self._finish(part, {**facts, "final": "yes"})

    def give_up(self, records: Sequence[Encoded]) -> None:
        """Nothing is written any more: the open part is left for a recovery, `records` are lost too."""
        part, self._part = self._part, None
        if part is not None:
            self._abandon(part)
        self._lose([*self._pending, *records])
        self._pending.clear()

    # ---- inside ----

    def _note(self, records: Sequence[Encoded]) -> None:
        for record in reversed(records):
            if not record.derived:
                self._last_number, self._last_time_ns = record.number, record.log_time_ns
                break
        for record in records:
            if record.topic in LATCHED:  # only views are
                self._latched[record.topic] = record

    def _write(self, record: Encoded) -> None:
        assert self._part is not None
        self._part.writer.add_all((record,))
        self._pending.append(record)

    def _begun(self, first_record: int) -> _OpenPart:
        """A new part whose manifest is on the disk; raises OSError and then leaves no file."""
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
        writer = PartWriter(sink, facts, self._channels, self._attachments)
        try:
            writer.flush()
            sink.sync()
        except OSError:
            sink.discard()
            raise
        self._index += 1
        return _OpenPart(writer, file_name, sink.tell())

    def _take(self, part: _OpenPart) -> None:
        """Go on in `part`."""
        self._part, self.name, self.problem = part, part.file_name, ""
        for latched in self._latched.values():
            self._write(latched)

    def _reopened(self, record: Encoded, now_s: float) -> bool:
        """Try to begin a part that starts with what was lost before `record`."""
        if now_s < self._retry_at_s:
            return False
        try:
            self._take(self._begun(self._lost[0] if self._lost else first_last(record, self._store)[0]))
        except OSError as error:
            self._stop(error, now_s)
            return False
        self._name_lost()
        return True

    def _name_lost(self) -> None:
        """Put the drop record of what was lost, if a part is open."""
        if self._lost is None or self._part is None:
            return
        drop, self._lost = DropRecord(*self._lost, self._why_lost), None
        self._write(Encoded(TOPICS[DropRecord], drop.last, self._last_time_ns, self._store.encode(drop)))

    def _rotate(self, part: _OpenPart, now_s: float) -> None:
        try:
            following = self._begun(self._last_number + 1)
        except (
            OSError
        ) as error:  # the part that there is goes on; should it fail as well, _fail deals with it
            self._stop(error, now_s, "no next part, the log goes on in this one: ")
            return
        self._take(following)
        self._finish(part, {"final": "no"})

    def _finish(self, part: _OpenPart, facts: Mapping[str, str]) -> None:
        try:
            part.writer.finish(END_METADATA, {"last_record": str(self._last_number), **facts})
        except OSError as error:
            self.warning = f"{part.file_name} was left for recovery: {error.strerror or error}"
            self._abandon(part)

    def _fail(self, error: Exception, now_s: float) -> None:
        """The open chunk did not get onto the disk: try what is not in the file once in a new part."""
        pending, self._pending = [r for r in self._pending if not r.derived], []
        part, self._part = self._part, None
        assert part is not None
        self._abandon(part)
        self.warning = f"{part.file_name} was left for recovery: {_said(error)}"
        try:
            self._take(
                self._begun(first_last(pending[0], self._store)[0] if pending else self._last_number + 1)
            )
            assert self._part is not None
            for record in pending:
                self._write(record)
            self._part.writer.flush()
            self._pending.clear()
        except Exception as again:
            if self._part is not None:
                self._abandon(self._part)
            self._part, self._pending = None, []
            self._stop(again, now_s)
            self._lose(pending)

    def _abandon(self, part: _OpenPart) -> None:
        self.abandoned.append(part.file_name)
        part.writer.sink.abandon()

    def _stop(self, error: Exception, now_s: float, what: str = "") -> None:
        self.problem = f"disk: {what}{_said(error)}"
        self._retry_at_s = now_s + RETRY_S

    def _lose(self, records: Sequence[Encoded], why: str = "") -> None:
        numbered = [record for record in records if not record.derived]
        if not numbered:
            return
        numbers = [first_last(record, self._store) for record in numbered]
        self._lost = (self._lost[0] if self._lost else numbers[0][0], numbers[-1][1])
        self._last_number = max(self._last_number, numbers[-1][1])
        self._why_lost = why or self.problem
        drop = TOPICS[DropRecord]  # what it names was counted by whoever dropped it
        self.lost_records += sum(record.topic != drop for record in numbered)


def first_last(record: Encoded, store: MessageStore) -> tuple[int, int]:
    """Numbers that a record stands for: a drop record stands for all that it names."""
    if record.topic == TOPICS[DropRecord]:
        drop = store.decode(DropRecord, record.data)
        return drop.first, drop.last
    return record.number, record.number


def _said(error: Exception) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else f"{type(error).__name__}: {error}"
