"""Serial bytes of a running device -> events of the robot core, one decoder per port.

Decides which event a frame becomes and when noise is worth an event; the frames themselves are decoded by
cobs.py, link.py, codec.py, jetbot_base.py and rplidar.py. Knows no clock: the stamp is an argument.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from hippomat_core.errors import WireError
from hippomat_core.messages import (
    BASE,
    LIDAR,
    RADIO,
    BaseFeedback,
    Event,
    FrameSent,
    LinkNoise,
    RadioStatus,
    RelayHeard,
    RoundEnded,
    ScanReceived,
    StateHeard,
    StopHeard,
    TasksHeard,
)
from hippomat_core.wire import jetbot_base, rplidar
from hippomat_core.wire.cobs import FrameDecoder
from hippomat_core.wire.codec import decode_frame
from hippomat_core.wire.frames import RelayFrame, StateFrame, TasksFrame
from hippomat_core.wire.link import Heard, Round, Sent, Status, decode_message


class DeviceDecoder(Protocol):
    """Bytes of one port in, events out. A new one for each time the port is opened."""

    def events(self, stamp_ns: int, chunk: bytes) -> Iterator[Event]:
        """The events that `chunk` completes, stamped; at most one LinkNoise, behind the others."""
        ...


def decoder_for(port: int) -> DeviceDecoder:
    """The decoder of messages.RADIO, BASE or LIDAR."""
    if port == RADIO:
        return RadioEvents()
    return BaseEvents() if port == BASE else LidarEvents()


class _Counters(Protocol):
    @property
    def skipped_bytes(self) -> int: ...
    @property
    def bad_checksums(self) -> int: ...


class _Noise:
    """Turns growing counters into LinkNoise events."""

    def __init__(self, port: int, counters: _Counters) -> None:
        self._port, self._counters = port, counters
        self._told = (0, 0)
        self.undecodable_bytes = 0  # of intact link frames with a wrong message inside

    def event(self, stamp_ns: int) -> Iterator[LinkNoise]:
        skipped = self._counters.skipped_bytes + self.undecodable_bytes
        counts = (skipped & 0xFFFFFFFF, self._counters.bad_checksums & 0xFFFFFFFF)
        if counts != self._told:
            self._told = counts
            yield LinkNoise(stamp_ns, self._port, *counts)


class RadioEvents:
    """Messages of the radio. Its answers to questions, and what only a host sends, are no events."""

    def __init__(self) -> None:
        self._frames = FrameDecoder()
        self._noise = _Noise(RADIO, self._frames)

    def events(self, stamp_ns: int, chunk: bytes) -> Iterator[Event]:
        for payload in self._frames.feed(chunk):
            try:
                event = _radio_event(stamp_ns, payload)
            except WireError:
                self._noise.undecodable_bytes += len(payload)
                continue
            if event is not None:
                yield event
        yield from self._noise.event(stamp_ns)


class BaseEvents:
    """Feedback frames of the base; other frame types are no event."""

    def __init__(self) -> None:
        self._frames = jetbot_base.Decoder()
        self._noise = _Noise(BASE, self._frames)

    def events(self, stamp_ns: int, chunk: bytes) -> Iterator[Event]:
        for frame in self._frames.feed(chunk):
            if frame.type == jetbot_base.FEEDBACK:
                yield _feedback_event(stamp_ns, jetbot_base.decode_feedback(frame))
        yield from self._noise.event(stamp_ns)


class LidarEvents:
    """Whole sweeps."""

    def __init__(self) -> None:
        self._sweeps = rplidar.SweepDecoder()
        self._noise = _Noise(LIDAR, self._sweeps)

    def events(self, stamp_ns: int, chunk: bytes) -> Iterator[Event]:
        for sweep in self._sweeps.feed(chunk):
            yield ScanReceived(stamp_ns, sweep.quality, sweep.angle_q6, sweep.distance_q2)
        yield from self._noise.event(stamp_ns)


def _radio_event(stamp_ns: int, payload: bytes) -> Event | None:
    message = decode_message(payload)
    if isinstance(message, Heard):
        return _heard_event(stamp_ns, message)
    if isinstance(message, Sent):
        return FrameSent(stamp_ns, message.radio_time_us, message.kind, message.sequence, message.sent)
    if isinstance(message, Status):
        return RadioStatus(stamp_ns, **{name: getattr(message, name) for name in Status.__dataclass_fields__})
    if isinstance(message, Round):
        return RoundEnded(stamp_ns, **{name: getattr(message, name) for name in Round.__dataclass_fields__})
    return None


def _heard_event(stamp_ns: int, heard: Heard) -> Event:
    header, frame = decode_frame(heard.frame)
    at = (stamp_ns, heard.radio_time_us, heard.fleet_time_us, heard.rssi_dbm, header)
    if isinstance(frame, StateFrame):
        return StateHeard(*at, frame)
    if isinstance(frame, RelayFrame):
        return RelayHeard(*at, frame)
    if isinstance(frame, TasksFrame):
        return TasksHeard(*at, frame)
    return StopHeard(*at, frame)


def _feedback_event(stamp_ns: int, feedback: jetbot_base.Feedback) -> BaseFeedback:
    return BaseFeedback(
        stamp_ns,
        gyro=np.array(feedback.gyro, dtype=np.int16),
        accel=np.array(feedback.accel, dtype=np.int16),
        attitude_ddeg=np.array(feedback.attitude_ddeg, dtype=np.int16),
        odom_x_mm=feedback.odom_x_mm,
        odom_y_mm=feedback.odom_y_mm,
        odom_yaw_mrad=feedback.odom_yaw_mrad,
        delta_x_mm=feedback.delta_x_mm,
        delta_y_mm=feedback.delta_y_mm,
        delta_yaw_mrad=feedback.delta_yaw_mrad,
        wheels=np.array(feedback.wheels, dtype=np.int16),
        reserved=feedback.reserved,
    )
