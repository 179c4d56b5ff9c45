"""Record a run that has no wall clock: written by the caller's own thread, chunks closed by the run's time.

The same records give the same file, byte for byte. For simulated robots, which can wait for the disk; a real
one must not, and has recorder.py. Nothing is shed: a disk that fails ends the run.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hippomat_core.config import Config
from hippomat_core.errors import HippomatError
from hippomat_logs.derived import DerivedTopics
from hippomat_logs.parts import Encoded
from hippomat_logs.recorder import SYNC_S
from hippomat_logs.records import SerialRecord
from hippomat_logs.run_series import attachments, begin, series_of
from hippomat_logs.schema import MessageStore
from hippomat_logs.sink import SinkOpener, file_sinks


class DirectRecorder:
    """The arguments are recorder.Recorder's; stamps of the calls never go back."""

    def __init__(
        self,
        directory: Path,
        manifest: Mapping[str, str],
        *,
        config: Config,
        wall_ns: int,
        stamp_ns: int,
        policy: bytes = b"",
        files: Mapping[str, bytes] | None = None,
        open_sink: SinkOpener | None = None,
    ) -> None:
        self._directory = directory
        self._offset_ns = wall_ns - stamp_ns
        self._store = MessageStore()
        self._store.warm_up()
        self._encoders = self._store.encoders()
        self._derived = DerivedTopics(self._store, config)
        self._drawn = self._derived.kinds
        self._number, self._stamp_ns, self._flush_ns = 0, stamp_ns, stamp_ns
        opener, carried = open_sink or file_sinks(directory), attachments(policy, files)
        self._series = series_of(opener, manifest, self._store, config, wall_ns, stamp_ns, carried)
        begin(self._series, self._derived, wall_ns, stamp_ns / 1e9)

    def serial(self, stamp_ns: int, port: int, direction: int, phase: int, data: bytes) -> None:
        """Numbers as in recorder.Recorder."""
        self.put(stamp_ns, SerialRecord(stamp_ns, port, direction, phase, zlib.crc32(data), data))

    def close(self) -> None:
        """Finish the file. Raises HippomatError where the disk did not take everything."""
        self._series.close(self._stamp_ns / 1e9, {"worst_sync_ms": "0", "shed": "0"})
        self._check()

    def put(self, stamp_ns: int, record: Any) -> None:
        self._number, self._stamp_ns = self._number + 1, stamp_ns
        now_s, log_time_ns = stamp_ns / 1e9, stamp_ns + self._offset_ns
        topic, encode = self._encoders[type(record)]
        self._series.add(Encoded(topic, self._number, log_time_ns, encode(record)), now_s)
        if type(record) in self._drawn:
            for view, data in self._derived.of(record, log_time_ns):
                self._series.add(Encoded(view, self._number, log_time_ns, data, derived=True), now_s)
        if stamp_ns - self._flush_ns >= SYNC_S * 1e9:
            self._flush_ns = stamp_ns
            self._series.flush(now_s)
            self._check()

    def _check(self) -> None:
        if self._series.problem or self._series.abandoned:
            why = self._series.problem or self._series.warning
            raise HippomatError(f"cannot record into {self._directory}: {why}")
