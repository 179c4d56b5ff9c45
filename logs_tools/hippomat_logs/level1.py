"""Level L1: the recorded serial bytes decode to the recorded events, and encode to the same bytes again.

Knows bytes and events; what the core made of the events is level L2's.
"""

from __future__ import annotations

from typing import Any

from hippomat_core import messages as m
from hippomat_core.wire.device_events import DeviceDecoder, decoder_for
from hippomat_logs.reader import Record
from hippomat_logs.records import FROM_DEVICE, RUNNING, SerialRecord
from hippomat_logs.reencoding import Reencoding
from hippomat_logs.report import FAILED, NOT_RUN, OK, Divergence, LevelResult
from hippomat_logs.ros.topics import FROM_ROS
from hippomat_logs.schema import EVENTS, MessageStore, differences

_EVENTS = frozenset(EVENTS)
NOT_DECODED = (m.Started, m.MapReceived, m.Tick, m.PortOpened, m.PortLost, *FROM_ROS)  # no bytes hold them


class ByteCheck:
    """Feed every record of one run in order, then ask for the result. Stops at the first divergence."""

    def __init__(self, robot: int, store: MessageStore, started_ns: int, wall_offset_ns: int) -> None:
        self._store = store
        self._robot, self._started_ns, self._offset_ns = robot, started_ns, wall_offset_ns
        self._decoders: dict[int, DeviceDecoder] = {}  # of the ports that are open, as in the daemon
        self._streams: dict[tuple[int, int], Reencoding] = {}
        self._expected: list[Any] = []  # decoded, but not yet seen as recorded events
        self._tick = self._events = self._bytes = self._noise = self._ros = 0
        self._notes: list[str] = []
        self._last: Record | None = None
        self.divergence: Divergence | None = None

    def feed(self, record: Record) -> None:
        if self.divergence is not None:
            return
        self._last = record
        message = record.message
        if isinstance(message, SerialRecord):
            if message.phase == RUNNING:
                self._serial(record, message)
        elif isinstance(message, NOT_DECODED):
            self._other(record, message)
        elif type(message) in _EVENTS:
            self._decoded(record, message)

    def result(self, may_be_cut: bool) -> LevelResult:
        """may_be_cut: the log's end was lost, so events of its last bytes may be missing."""
        for port in range(len(m.PORT_NAMES)):
            self._retire(port)
        if self._last is not None and self.divergence is None and not may_be_cut:
            self._nothing_left(self._last)
        detail = f"{self._events:,} events; same bytes both ways"
        if self._noise:
            detail += f"; {self._noise} bytes of noise, counted as recorded"
        if self._ros:
            detail += f"; {self._ros} events from ROS have no bytes to compare"
        if self.divergence is not None:
            return LevelResult("L1", FAILED, self._bytes, "bytes", "", self._notes, self.divergence)
        if not self._bytes:
            return LevelResult("L1", NOT_RUN, 0, "bytes", "the log holds no serial bytes")
        return LevelResult("L1", OK, self._bytes, "bytes", detail, self._notes)

    def _serial(self, record: Record, serial: SerialRecord) -> None:
        self._bytes += len(serial.data)
        if serial.direction == FROM_DEVICE:
            self._nothing_left(record)
            if serial.port in self._decoders:
                self._expected = list(self._decoders[serial.port].events(serial.stamp_ns, serial.data))
        key = serial.port, serial.direction
        wrong = self._streams.setdefault(key, Reencoding(*key)).feed(serial.data)
        if wrong is not None:
            where = f"bytes {'from' if serial.direction == FROM_DEVICE else 'to'} the {_name(serial.port)}"
            self._diverge(record, where, serial.data, wrong)

    def _other(self, record: Record, event: Any) -> None:
        self._nothing_left(record)
        self._tick += isinstance(event, m.Tick)
        self._ros += isinstance(event, FROM_ROS)
        if isinstance(event, m.PortOpened | m.PortLost):
            self._retire(event.port)
        if isinstance(event, m.PortOpened) and event.port != m.ROS:
            self._decoders[event.port] = decoder_for(event.port)

    def _decoded(self, record: Record, event: Any) -> None:
        self._events += 1
        name = type(event).__name__
        if not self._expected:
            self._diverge(record, name, "an event", "no such event in the bytes read before it")
            return
        expected = self._expected.pop(0)
        if type(expected) is type(event) and self._store.encode(expected) == self._store.encode(event):
            return
        for path, decoded, recorded in differences(expected, event):
            self._diverge(record, f"{name}.{path}", recorded, decoded)
            return

    def _retire(self, port: int) -> None:
        """The port was closed or opened: its decoders start anew."""
        self._decoders.pop(port, None)
        for direction, way in enumerate(("from", "to")):
            stream = self._streams.pop((port, direction), None)
            if stream is not None:
                self._noise += stream.skipped_bytes
                if stream.unframed_bytes:
                    where = f"{way} the {_name(port)}"
                    self._notes.append(
                        f"{stream.unframed_bytes} bytes {where} are in no whole frame or sweep"
                    )

    def _nothing_left(self, record: Record) -> None:
        if self._expected:
            name = type(self._expected[0]).__name__
            self._diverge(record, name, "no such event", "an event in the bytes read before")

    def _diverge(self, record: Record, field: str, recorded: Any, replayed: Any) -> None:
        time_s = (record.log_time_ns - self._offset_ns - self._started_ns) / 1e9
        self.divergence = self.divergence or Divergence(
            "L1", self._robot, self._tick, record.number, time_s, field, recorded, replayed
        )


def _name(port: int) -> str:
    return m.PORT_NAMES[port]
