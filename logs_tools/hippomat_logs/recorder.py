"""Record one run without ever holding up the robot: the caller only appends to a bounded queue.

Decides when chunks reach the disk; one writer thread encodes and writes. Where room on the disk runs out,
bulk goes first; what is left out is counted and named by a drop record.
Knows records and time stamps, not what they mean.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from hippomat_core.config import Config
from hippomat_logs.derived import DerivedTopics
from hippomat_logs.disk_space import NO_BULK, NO_VIEWS, DiskWatch, FreeBytes, check_forecast, free_bytes
from hippomat_logs.parts import Encoded
from hippomat_logs.record_queue import LeftOut, RecordQueue, kind_of, may_go
from hippomat_logs.records import DropRecord, ProcessRecord, TimingRecord
from hippomat_logs.recovery import recover_directory
from hippomat_logs.run_series import attachments, begin, series_of
from hippomat_logs.schema import TOPICS, MessageStore
from hippomat_logs.sink import SinkOpener, file_sinks

PLUG_S = 0.5  # a plug that is pulled costs so much at most: from one sync's begin to the next one's end
SYNC_S, MIN_SYNC_S = 0.4, 0.1  # from begin to begin; sooner where the disk takes longer than what is left
LOSSLESS_WAKE_S = 0.01  # somebody may be waiting for room in the queue; otherwise the writer wakes to sync
QUEUE_RECORDS = 8192
BATCH_RECORDS = 40  # on their way to the file at once: so many are lost where it does not take them
SWITCH_S = 1e-4
_MARGIN_S = 0.03  # for what comes between a record and the sync that holds it: encoding, and other processes
_LAST_NS = 2**63 - 1  # the latest log time that every reader takes
_new = tuple.__new__  # of a NamedTuple: its own constructor takes five times as long
_LOW = "disk low: bulk was shed"


def period_s(sync_s: float) -> float:
    """From the begin of one sync to that of the next, on a disk that took so long for the last."""
    return min(SYNC_S, max(MIN_SYNC_S, PLUG_S - _MARGIN_S - sync_s))


def bound_interpreter_wait() -> None:
    """Call once in a process with a control loop: it then asks for the interpreter after 0.1 ms, not Python's
    usual 5 ms, while the writer's thread runs Python code. Holds for every thread of the process."""
    sys.setswitchinterval(SWITCH_S)


@dataclass(frozen=True, slots=True)
class RecorderStatus:
    """How recording goes; `problem` is "" while everything is kept. shed: bulk left out."""

    records: int
    lost: int
    problem: str
    file: str
    shed: int = 0


class Recorder:
    """Calls come from one thread, in the order that the record numbers shall have.

    put(stamp_ns, record): an event, an effect or a record of the log's own. serial(stamp_ns, port, direction,
    phase, data): bytes that one read or write moved, see records.SerialRecord.

    manifest: see manifest.run_manifest. wall_ns and stamp_ns are read together; log times are the wall clock
    that results, so they never step.
    lossless=True waits for the writer instead of dropping (for replays, which also ask for no forecast).
    policy: the weights that decide; files: more that every part shall carry, by name.
    Raises OSError where `directory` cannot be written at the start, HippomatError where the expected run does
    not fit on its disk; nothing afterwards.
    """

    def __init__(
        self,
        directory: Path | str,
        manifest: Mapping[str, str],
        *,
        config: Config,
        wall_ns: int,
        stamp_ns: int,
        open_sink: SinkOpener | None = None,
        queue_records: int = QUEUE_RECORDS,
        lossless: bool = False,
        policy: bytes = b"",
        files: Mapping[str, bytes] | None = None,
        free: FreeBytes | None = None,
    ) -> None:
        self._directory = Path(directory)
        opener = open_sink or file_sinks(self._directory)
        free = free or partial(free_bytes, self._directory)
        if not lossless:
            check_forecast(self._directory, config.log, free)
        self._disk = DiskWatch(config.log.low_mib, free)
        self._store = MessageStore()
        self._store.warm_up()
        self._encoders, self._row_encoders = self._store.encoders(), self._store.row_encoders()
        self._derived = DerivedTopics(self._store, config)
        self._drawn = self._derived.kinds
        self._lossless = lossless
        self._queue = RecordQueue(queue_records, self._is_written if lossless else None)
        # what the control loop calls hundreds of times a second goes there without a detour
        self.put, self.serial = self._queue.put, self._queue.serial
        self._offset_ns, self._last_ns = wall_ns - stamp_ns, _held(wall_ns)  # from stamps to log times
        self._number = 0  # of the last record that the writer has taken
        self._unfit = self._shed = 0
        self._gap: DropRecord | None = None  # what the writer sheds just now
        self._ready: list[Encoded] = []  # a batch on its way to the file
        self._level = self._disk.level()
        self._worst_sync_s = 0.0
        self._fault = ""
        self._ended = False  # by an error of ours
        self._closing = threading.Event()
        carried = attachments(policy, files)
        self._series = series_of(opener, manifest, self._store, config, wall_ns, stamp_ns, carried)
        begin(self._series, self._derived, wall_ns, time.monotonic())
        self._thread = threading.Thread(target=self._write_until_closed, name="recorder", daemon=True)
        self._thread.start()

    def timing(self, stamp_ns: int, compute_ns: int, lag_ns: int) -> None:
        self._queue.put(stamp_ns, (TimingRecord, stamp_ns, compute_ns, max(0, lag_ns)))

    def process(self, stamp_ns: int, real_ns: int, cpu_ns: int, peak_memory_kib: int) -> None:
        self._queue.put(stamp_ns, ProcessRecord(stamp_ns, real_ns, cpu_ns, peak_memory_kib))

    def status(self) -> RecorderStatus:
        lost = self._queue.dropped + self._unfit + self._series.lost_records
        if self._ended:  # nobody takes any more out of the queue
            lost += self._queue.left()
        problem = self._series.problem or self._fault or self._disk.problem
        if not problem and (cause := self._queue.drop_cause):
            problem = f"the log's {cause}"
        problem = problem or self._series.warning
        shed = self._queue.shed + self._shed
        return RecorderStatus(self._queue.numbered, lost, problem, self._series.name, shed)

    def close(self, timeout_s: float = 10.0) -> RecorderStatus:
        """Write what is queued and finish the file. A disk that hangs is given `timeout_s`."""
        self._queue.end()
        self._closing.set()
        self._thread.join(timeout_s)
        return self.status()

    def _is_written(self) -> bool:
        return self._thread.is_alive() and not self._ended

    # ---- writer's thread ----

    def _write_until_closed(self) -> None:
        try:
            self._write_and_flush()
        except Exception as error:
            self._fault = f"recording ended: {type(error).__name__}: {error}"
            self._series.give_up(self._ready)
            self._ended = True
            self._closing.wait()  # a recovery now would take time from the robot
        if self._series.abandoned:
            try:
                recover_directory(self._directory)
            except Exception as error:
                self._fault = f"a part was left for recovery: {error}"

    def _write_and_flush(self) -> None:
        due_s = time.monotonic() + SYNC_S
        while True:
            wait_s = LOSSLESS_WAKE_S if self._lossless else due_s - time.monotonic()
            closing = self._closing.wait(max(0.0, wait_s))
            self._drain()
            if (now_s := time.monotonic()) >= due_s:
                self._series.flush(now_s)
                sync_s = time.monotonic() - now_s
                self._worst_sync_s = max(self._worst_sync_s, sync_s)
                self._level = self._disk.level()
                due_s = now_s + period_s(sync_s)
            if closing and not self._queue.entries:
                break
        self._end_gap(self._last_ns)
        self._hand_on(time.monotonic())
        shed = self._queue.shed + self._shed
        self._series.close(
            time.monotonic(), {"worst_sync_ms": f"{1e3 * self._worst_sync_s:.0f}", "shed": str(shed)}
        )

    def _drain(self) -> None:
        """What was there when it began: a queue that fills faster must not keep the rest from the disk."""
        waiting = len(self._queue.entries)
        while waiting > 0:
            self._write(min(BATCH_RECORDS, waiting))
            self._hand_on(time.monotonic())
            waiting -= BATCH_RECORDS

    def _write(self, count: int) -> None:
        """So many records as bytes, with the views of them, for _hand_on."""
        take, drawn, ready = self._queue.entries.popleft, self._drawn, self._ready
        encoders, rows, offset_ns, number = self._encoders, self._row_encoders, self._offset_ns, self._number
        sheds, views = self._level >= NO_BULK, self._level < NO_VIEWS and not self._queue.is_hurried()
        log_time_ns = self._last_ns
        for _ in range(count):
            stamp_ns, record = take()
            number, kind = number + 1, type(record)
            if sheds and may_go(record):
                self._shed += 1
                self._gap = DropRecord(self._gap.first if self._gap else number, number, _LOW)
                continue
            if self._gap is not None:
                self._end_gap(log_time_ns)
            if kind is LeftOut:
                kind, record = DropRecord, DropRecord(number, number + record.count - 1, record.cause)
                number = record.last
            try:
                log_time_ns = stamp_ns + offset_ns
                if not 0 <= log_time_ns <= _LAST_NS:
                    log_time_ns = _held(log_time_ns)
                topic, encode = encoders[kind] if kind is not tuple else rows[record[0]]
                ready.append(_new(Encoded, (topic, number, log_time_ns, encode(record), False)))
            except Exception as error:  # a wrong value must cost that record, not the run
                ready.append(self._lost_for(number, log_time_ns, kind_of(record), error))
            if kind in drawn and views:  # these are shed first
                for view, data in self._views(record, log_time_ns):
                    ready.append(Encoded(view, number, log_time_ns, data, derived=True))
        self._number, self._last_ns = number, log_time_ns

    def _hand_on(self, now_s: float) -> None:
        self._series.add_all(self._ready, now_s)
        self._ready.clear()

    def _end_gap(self, log_time_ns: int) -> None:
        if self._gap is not None:
            gap, self._gap = self._gap, None
            self._ready.append(Encoded(TOPICS[DropRecord], gap.last, log_time_ns, self._store.encode(gap)))

    def _views(self, record: Any, log_time_ns: int) -> Iterable[tuple[str, bytes]]:
        try:
            return tuple(self._derived.of(record, log_time_ns))
        except Exception as error:  # a view that cannot be drawn must cost nothing else
            self._fault = f"no standard topic for {type(record).__name__}: {error}"
            return ()

    def _lost_for(self, number: int, log_time_ns: int, kind: type, error: Exception) -> Encoded:
        cause = f"{kind.__name__} does not fit its definition: {error}"
        self._fault = cause
        self._unfit += 1
        data = self._store.encode(DropRecord(number, number, cause))
        return Encoded(TOPICS[DropRecord], number, log_time_ns, data)


def _held(log_time_ns: int) -> int:
    """The log time itself, unless the clock is off by centuries."""
    return min(max(log_time_ns, 0), _LAST_NS)
