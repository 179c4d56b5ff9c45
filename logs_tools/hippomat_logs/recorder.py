"""Record one run without ever holding up the robot: the caller only appends to a bounded queue.

Decides record numbers, the queue, and when chunks are closed; one writer thread encodes and writes. What
does not fit is counted and named by a drop record. Knows records and time stamps, not what they mean.
"""

from __future__ import annotations

import threading
import time
import zlib
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from hippomat_core.config import Config
from hippomat_core.messages import Effect, Event
from hippomat_logs.derived import DerivedTopics
from hippomat_logs.parts import Encoded, PartSeries
from hippomat_logs.records import DropRecord, SerialRecord, TimingRecord
from hippomat_logs.recovery import recover_directory
from hippomat_logs.schema import TOPICS, MessageStore
from hippomat_logs.sink import SinkOpener, file_sinks

FLUSH_S = 0.5
SYNC_S = 1.0
WAKE_S = 0.1
QUEUE_RECORDS = 8192


@dataclass(frozen=True, slots=True)
class RecorderStatus:
    """How recording goes; `problem` is "" while everything is kept."""

    records: int
    lost: int
    problem: str
    file: str


class Recorder:
    """Calls come from one thread, in the order that the record numbers shall have.

    manifest: see manifest.run_manifest. wall_ns and stamp_ns are read together; log times are the wall clock
    that results, so they never step.
    lossless=True waits for the writer instead of dropping (for replays). policy: the weights that decide.
    Raises OSError where `directory` cannot be written at the start; never afterwards.
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
    ) -> None:
        self._offset_ns = wall_ns - stamp_ns
        self._directory = Path(directory)
        self._store = MessageStore()
        self._store.warm_up()
        self._derived = DerivedTopics(self._store, config)
        self._next = 1
        self._queue: deque[tuple[int, int, Any]] = deque()
        self._limit = queue_records
        self._lossless = lossless
        self._dropping: int | None = None  # first number of the records that found the queue full
        self._dropped = 0
        self._fault = ""
        self._closing = threading.Event()
        facts = {**manifest, "wall_offset_ns": str(self._offset_ns), "started_ns": str(stamp_ns)}
        name = log_name(manifest, wall_ns)
        opener = open_sink or file_sinks(self._directory)
        self._series = PartSeries(opener, name, facts, self._store, config.log.part_mib << 20, policy)
        self._series.open()
        for topic, data in self._derived.static():
            self._series.add(Encoded(topic, 0, wall_ns, data, derived=True), time.monotonic())
        self._thread = threading.Thread(target=self._write_until_closed, name="recorder", daemon=True)
        self._thread.start()

    def event(self, event: Event) -> None:
        self._put(event.stamp_ns, event)

    def effect(self, stamp_ns: int, effect: Effect) -> None:
        self._put(stamp_ns, effect)

    def serial(self, stamp_ns: int, port: int, direction: int, phase: int, data: bytes) -> None:
        """port: messages.RADIO...; direction 0 from, 1 to the device; phase 0 identification, 1 running."""
        self._put(stamp_ns, SerialRecord(stamp_ns, port, direction, phase, zlib.crc32(data), bytes(data)))

    def timing(self, stamp_ns: int, compute_ns: int, lag_ns: int) -> None:
        self._put(stamp_ns, TimingRecord(stamp_ns, compute_ns, max(0, lag_ns)))

    def status(self) -> RecorderStatus:
        lost = self._dropped + self._series.lost_records
        problem = self._series.problem or self._fault
        if not problem and self._dropping is not None:
            problem = "the log's queue is full: the disk is too slow"
        return RecorderStatus(self._next - 1, lost, problem, self._series.name)

    def close(self, timeout_s: float = 10.0) -> RecorderStatus:
        """Write what is queued and finish the file. A disk that hangs is given `timeout_s`."""
        self._end_drop()
        self._closing.set()
        self._thread.join(timeout_s)
        return self.status()

    # ---- caller's thread ----

    def _put(self, stamp_ns: int, record: Any) -> None:
        number = self._next
        self._next = number + 1
        if len(self._queue) >= self._limit:
            if not self._lossless:
                self._dropped += 1
                if self._dropping is None:
                    self._dropping = number
                return
            while len(self._queue) >= self._limit and self._thread.is_alive():
                time.sleep(0.002)
        if self._dropping is not None:
            self._end_drop(number)
        self._queue.append((number, stamp_ns + self._offset_ns, record))

    def _end_drop(self, before: int | None = None) -> None:
        if self._dropping is None:
            return
        last = (self._next if before is None else before) - 1
        drop = DropRecord(self._dropping, last, "queue full: the disk was too slow")
        self._queue.append((last, time.time_ns(), drop))
        self._dropping = None

    # ---- writer's thread ----

    def _write_until_closed(self) -> None:
        try:
            self._write_and_flush()
            if self._series.abandoned:
                recover_directory(self._directory)
        except Exception as error:
            self._fault = f"recording ended: {type(error).__name__}: {error}"

    def _write_and_flush(self) -> None:
        flushed_s = synced_s = time.monotonic()
        while True:
            closing = self._closing.wait(WAKE_S)
            self._drain()
            now_s = time.monotonic()
            if now_s - flushed_s >= FLUSH_S:
                sync = now_s - synced_s >= SYNC_S - FLUSH_S / 2
                self._series.flush(now_s, sync)
                flushed_s = now_s
                synced_s = now_s if sync else synced_s
            if closing and not self._queue:
                break
        self._series.close(time.monotonic())

    def _drain(self) -> None:
        now_s = time.monotonic()
        while self._queue:
            number, log_time_ns, record = self._queue.popleft()
            try:
                encoded = Encoded(TOPICS[type(record)], number, log_time_ns, self._store.encode(record))
            except Exception as error:  # a wrong value must cost that record, not the run
                encoded = self._lost_for(number, log_time_ns, record, error)
            self._series.add(encoded, now_s)
            if not self._queue or len(self._queue) < self._limit // 2:  # derived topics are shed first
                for topic, data in self._views(record, log_time_ns):
                    self._series.add(Encoded(topic, number, log_time_ns, data, derived=True), now_s)

    def _views(self, record: Any, log_time_ns: int) -> list[tuple[str, bytes]]:
        try:
            return list(self._derived.of(record, log_time_ns))
        except Exception as error:  # a view that cannot be drawn must cost nothing else
            self._fault = f"no standard topic for {type(record).__name__}: {error}"
            return []

    def _lost_for(self, number: int, log_time_ns: int, record: Any, error: Exception) -> Encoded:
        cause = f"{type(record).__name__} does not fit its definition: {error}"
        self._fault = cause
        self._dropped += 1
        data = self._store.encode(DropRecord(number, number, cause))
        return Encoded(TOPICS[DropRecord], number, log_time_ns, data)


def log_name(manifest: Mapping[str, str], wall_ns: int) -> str:
    """robot03_20250301T101500Z_<boot id>-<session id>, the stem of every part's file name."""
    when = datetime.fromtimestamp(wall_ns // 10**9, timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    robot = manifest.get("robot", "-1")
    who = f"robot{int(robot):02d}" if robot.lstrip("-").isdigit() and int(robot) >= 0 else "observer"
    boot = manifest.get("boot_id", "").replace("-", "")[:8] or "noboot"
    return f"{who}_{when}_{boot}-{manifest.get('session_id', 'none')[:8]}"
