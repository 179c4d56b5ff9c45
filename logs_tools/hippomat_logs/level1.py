"""Level L1: the recorded serial bytes decode to the recorded events and encode to the same bytes again.

Knows bytes and events; what the core made of the events is level L2's.
"""

from __future__ import annotations

from typing import Any

from hippomat_core import messages as m
from hippomat_logs.byte_events import ByteStream
from hippomat_logs.reader import Record
from hippomat_logs.records import FROM_DEVICE, IDENTIFICATION, SerialRecord
from hippomat_logs.report import FAILED, NOT_RUN, OK, Divergence, LevelResult
from hippomat_logs.schema import EVENTS, differences

DECODED = (
    m.BaseFeedback,
    m.ScanReceived,
    m.StateHeard,
    m.RelayHeard,
    m.TasksHeard,
    m.StopHeard,
    m.FrameSent,
    m.RadioStatus,
)


class ByteCheck:
    """Feed every record of one run in order, then ask for the result. Stops at the first divergence."""

    def __init__(self, robot: int, started_ns: int, wall_offset_ns: int) -> None:
        self._robot, self._started_ns, self._offset_ns = robot, started_ns, wall_offset_ns
        self._streams: dict[tuple[int, int], ByteStream] = {}
        self._expected: list[Any] = []  # decoded, but not yet seen as recorded events
        self._tick = 0
        self._events = self._bytes = self._noise = 0
        self._notes: list[str] = []
        self.divergence: Divergence | None = None

    def feed(self, record: Record) -> None:
        if self.divergence is not None:
            return
        message = record.message
        if isinstance(message, m.Tick):
            self._tick += 1
        if isinstance(message, SerialRecord):
            self._serial(record, message)
        elif isinstance(message, DECODED):
            self._decoded(record, message)
        elif isinstance(message, m.LinkNoise):
            self._link_noise(record, message)
        elif isinstance(message, m.PortOpened | m.PortLost):
            self._retire(message.port)
        if type(message) in EVENTS and not isinstance(message, DECODED) and self._expected:
            self._missing(record)

    def result(self, may_be_cut: bool) -> LevelResult:
        """may_be_cut: the log's end was lost, so events of its last bytes may be missing."""
        for port in range(len(m.PORT_NAMES)):
            self._retire(port)
        if self.divergence is None and self._expected and not may_be_cut:
            last = Record(0, self._started_ns + self._offset_ns, "", None)
            self._missing(last)
        detail = f"{self._events} events from {self._bytes} bytes"
        if self._noise:
            detail += f", {self._noise} bytes of noise counted"
        if self.divergence is not None:
            return LevelResult("L1", FAILED, self._bytes, "bytes", detail, self._notes, self.divergence)
        if not self._bytes:
            return LevelResult("L1", NOT_RUN, 0, "bytes", "the log holds no serial bytes")
        return LevelResult("L1", OK, self._bytes, "bytes", detail, self._notes)

    def _serial(self, record: Record, serial: SerialRecord) -> None:
        if serial.phase == IDENTIFICATION:
            self._retire(serial.port)
            return
        if serial.direction == FROM_DEVICE and self._expected:
            self._missing(record)
            return
        key = serial.port, serial.direction
        stream = self._streams.setdefault(key, ByteStream(*key))
        self._bytes += len(serial.data)
        for event, same in stream.feed(serial.stamp_ns, serial.data):
            if not same:
                where = f"bytes {'to' if serial.direction else 'from'} the {m.PORT_NAMES[serial.port]}"
                self._diverge(record, where, "(these bytes)", "a frame that encodes to other bytes")
                return
            if event is not None and serial.direction == FROM_DEVICE:
                self._expected.append(event)

    def _decoded(self, record: Record, event: Any) -> None:
        self._events += 1
        name = type(event).__name__
        if not self._expected:
            self._diverge(record, name, "an event", "no such event in the bytes read before it")
            return
        for path, decoded, recorded in differences(self._expected.pop(0), event):
            self._diverge(record, f"{name}.{path}", recorded, decoded)
            return

    def _link_noise(self, record: Record, noise: m.LinkNoise) -> None:
        stream = self._streams.get((noise.port, FROM_DEVICE))
        counted = (stream.decoder.skipped_bytes, stream.decoder.bad_checksums) if stream else (0, 0)
        if counted != (noise.skipped_bytes, noise.bad_checksums):
            found = (noise.skipped_bytes, noise.bad_checksums)
            self._diverge(record, "LinkNoise.(skipped_bytes, bad_checksums)", found, counted)

    def _retire(self, port: int) -> None:
        """The port was closed or opened: its decoders start anew."""
        for direction in (0, 1):
            stream = self._streams.pop((port, direction), None)
            if stream is None:
                continue
            self._noise += stream.decoder.skipped_bytes
            if stream.unexplained:
                way = "to" if direction else "from"
                where = f"{way} the {m.PORT_NAMES[port]}"
                self._notes.append(f"{stream.unexplained} bytes {where} are in no whole frame or sweep")

    def _missing(self, record: Record) -> None:
        event = self._expected[0]
        self._diverge(record, type(event).__name__, "no such event", "an event in the bytes read before")

    def _diverge(self, record: Record, field: str, recorded: Any, replayed: Any) -> None:
        time_s = (record.log_time_ns - self._offset_ns - self._started_ns) / 1e9
        self.divergence = Divergence(
            "L1", self._robot, self._tick, record.number, time_s, field, recorded, replayed
        )
