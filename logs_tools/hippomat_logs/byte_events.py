"""From serial bytes to events and back, for level L1: what each port's recorded bytes must have meant.

Knows the three protocols through hippomat_core.wire. Every decoded frame is encoded again at once; where its
bytes are not found again in the stream, decoder and encoder disagree.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from hippomat_core import messages as m
from hippomat_core.errors import WireError
from hippomat_core.wire import cobs, codec, frames, jetbot_base, link, rplidar


class PortDecoder(Protocol):
    """One direction of one port since it was opened. feed(): (event or None, its bytes encoded again)."""

    @property
    def skipped_bytes(self) -> int: ...
    @property
    def bad_checksums(self) -> int: ...

    def feed(self, stamp_ns: int, chunk: bytes) -> Iterator[tuple[Any, bytes]]: ...


class _RadioStream:
    def __init__(self) -> None:
        self._frames = cobs.FrameDecoder()

    @property
    def skipped_bytes(self) -> int:
        return self._frames.skipped_bytes

    @property
    def bad_checksums(self) -> int:
        return self._frames.bad_checksums

    def feed(self, stamp_ns: int, chunk: bytes) -> Iterator[tuple[Any, bytes]]:
        for payload in self._frames.feed(chunk):
            try:
                message = link.decode_message(payload)
            except WireError:
                yield None, cobs.encode(payload)  # whole, but of another version: no event
                continue
            yield radio_event(stamp_ns, message), _encode_link(message)


def _encode_link(message: link.LinkMessage) -> bytes:
    if isinstance(message, link.Heard):
        frame = _again(message.frame, lambda data: codec.encode_frame(*codec.decode_frame(data)))
        message = link.Heard(message.radio_time_us, message.rssi_dbm, frame)
    elif isinstance(message, link.SendBody):
        kind = message.kind
        body = _again(message.body, lambda data: codec.encode_body(codec.decode_body(kind, data)))
        message = link.SendBody(kind, body)
    return link.encode_message(message)


def _again(data: bytes, decode_and_encode: Callable[[bytes], bytes]) -> bytes:
    """What a frame encodes to after decoding; one that does not decode is no event and stays as it is."""
    try:
        return decode_and_encode(data)
    except WireError:
        return data


def radio_event(stamp_ns: int, message: link.LinkMessage) -> Any:
    """The event that a message from the radio is, or None."""
    if isinstance(message, link.Sent):
        return m.FrameSent(stamp_ns, message.radio_time_us, message.kind, message.sequence, message.sent)
    if isinstance(message, link.Status):
        names = link.Status.__dataclass_fields__
        return m.RadioStatus(stamp_ns, **{name: getattr(message, name) for name in names})
    if not isinstance(message, link.Heard):
        return None
    try:
        header, frame = codec.decode_frame(message.frame)
    except WireError:
        return None
    heard = (stamp_ns, message.radio_time_us, message.rssi_dbm, header)
    if isinstance(frame, frames.StateFrame):
        return m.StateHeard(*heard, frame)
    if isinstance(frame, frames.RelayFrame):
        return m.RelayHeard(*heard, frame)
    if isinstance(frame, frames.TasksFrame):
        return m.TasksHeard(*heard, frame)
    return m.StopHeard(*heard, frame)


class _BaseStream:
    def __init__(self) -> None:
        self._decoder = jetbot_base.Decoder()

    @property
    def skipped_bytes(self) -> int:
        return self._decoder.skipped_bytes

    @property
    def bad_checksums(self) -> int:
        return self._decoder.bad_checksums

    def feed(self, stamp_ns: int, chunk: bytes) -> Iterator[tuple[Any, bytes]]:
        for frame in self._decoder.feed(chunk):
            if frame.type == jetbot_base.FEEDBACK:
                event = base_event(stamp_ns, jetbot_base.decode_feedback(frame))
                yield event, jetbot_base.encode_feedback(event)
            elif frame.type == jetbot_base.VELOCITY:
                yield None, jetbot_base.encode_velocity(*jetbot_base.decode_velocity(frame))
            else:
                yield None, frame.encode()


def base_event(stamp_ns: int, f: jetbot_base.Feedback) -> m.BaseFeedback:
    odometry = (f.odom_x_mm, f.odom_y_mm, f.odom_yaw_mrad, f.delta_x_mm, f.delta_y_mm, f.delta_yaw_mrad)
    gyro, accel, attitude, wheels = (
        np.array(v, np.int16) for v in (f.gyro, f.accel, f.attitude_ddeg, f.wheels)
    )
    return m.BaseFeedback(stamp_ns, gyro, accel, attitude, *odometry, wheels, f.reserved)


class _LidarStream:
    def __init__(self) -> None:
        self._decoder = rplidar.SweepDecoder()

    @property
    def skipped_bytes(self) -> int:
        return self._decoder.skipped_bytes

    @property
    def bad_checksums(self) -> int:
        return self._decoder.bad_checksums

    def feed(self, stamp_ns: int, chunk: bytes) -> Iterator[tuple[Any, bytes]]:
        for sweep in self._decoder.feed(chunk):
            event = m.ScanReceived(stamp_ns, sweep.quality, sweep.angle_q6, sweep.distance_q2)
            yield event, sweep.encode()


class _LidarRequests:
    """Host to lidar: two bytes each."""

    def __init__(self) -> None:
        self._decoder = rplidar.RequestDecoder()

    @property
    def bad_checksums(self) -> int:
        return 0

    @property
    def skipped_bytes(self) -> int:
        return self._decoder.skipped_bytes

    def feed(self, stamp_ns: int, chunk: bytes) -> Iterator[tuple[Any, bytes]]:
        del stamp_ns
        for command in self._decoder.feed(chunk):
            yield None, rplidar.request(command)


def decoder_of(port: int, direction: int) -> PortDecoder:
    """A fresh decoder for one direction (records.FROM_DEVICE, TO_DEVICE) of one port."""
    if port == m.RADIO:
        return _RadioStream()
    if port == m.BASE:
        return _BaseStream()
    return _LidarRequests() if direction else _LidarStream()


@dataclass(slots=True)
class ByteStream:
    """Bytes of one direction since the port was opened, matched against what was decoded from them."""

    port: int
    direction: int
    decoder: PortDecoder = field(init=False)
    total: int = 0
    encoded: int = 0
    unmatched: bytearray = field(default_factory=bytearray)  # behind the last frame found again
    between: int = 0  # bytes between frames found again: noise, descriptors, broken sweeps

    def __post_init__(self) -> None:
        self.decoder = decoder_of(self.port, self.direction)

    def feed(self, stamp_ns: int, chunk: bytes) -> Iterator[tuple[Any, bool]]:
        """(event or None, whether the frame encodes to bytes of this stream) for each frame it completes."""
        self.total += len(chunk)
        self.unmatched += chunk
        for event, again in self.decoder.feed(stamp_ns, chunk):
            at = self.unmatched.find(again)
            if at >= 0:
                self.between += at
                self.encoded += len(again)
                del self.unmatched[: at + len(again)]
            yield event, at >= 0

    @property
    def unexplained(self) -> int:
        """Bytes in no frame that the decoder neither counted as noise nor can still be holding."""
        return max(0, self.between - self.decoder.skipped_bytes)
