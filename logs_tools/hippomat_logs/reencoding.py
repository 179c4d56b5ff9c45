"""Do recorded bytes encode to themselves? Every frame in a stream is decoded, encoded again and looked for.

Knows the three protocols through hippomat_core.wire, in both directions; what the frames mean is not asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Protocol

from hippomat_core import messages as m
from hippomat_core.errors import WireError
from hippomat_core.wire import cobs, codec, jetbot_base, link, rplidar


class _Frames(Protocol):
    """The frames of one direction, encoded again."""

    def again(self, chunk: bytes) -> Iterator[bytes]: ...

    @property
    def skipped_bytes(self) -> int: ...


class _Radio:
    def __init__(self) -> None:
        self._frames = cobs.FrameDecoder()

    @property
    def skipped_bytes(self) -> int:
        return self._frames.skipped_bytes

    def again(self, chunk: bytes) -> Iterator[bytes]:
        for payload in self._frames.feed(chunk):
            yield cobs.encode(_or_same(payload, _payload_again))


def _payload_again(payload: bytes) -> bytes:
    message = link.decode_message(payload)
    if isinstance(message, link.Heard):
        frame = _or_same(message.frame, lambda data: codec.encode_frame(*codec.decode_frame(data)))
        message = replace(message, frame=frame)
    elif isinstance(message, link.SendBody):
        kind = message.kind
        body = _or_same(message.body, lambda data: codec.encode_body(codec.decode_body(kind, data)))
        message = replace(message, body=body)
    return link.encode_payload(message)


def _or_same(data: bytes, decode_and_encode: Callable[[bytes], bytes]) -> bytes:
    """What does not decode is no event for anybody, and stays as it is."""
    try:
        return decode_and_encode(data)
    except WireError:
        return data


class _Base:
    def __init__(self) -> None:
        self._decoder = jetbot_base.Decoder()

    @property
    def skipped_bytes(self) -> int:
        return self._decoder.skipped_bytes

    def again(self, chunk: bytes) -> Iterator[bytes]:
        for frame in self._decoder.feed(chunk):
            if frame.type == jetbot_base.FEEDBACK:
                yield jetbot_base.encode_feedback(jetbot_base.decode_feedback(frame))
            elif frame.type == jetbot_base.VELOCITY:
                yield jetbot_base.encode_velocity(*jetbot_base.decode_velocity(frame))
            else:
                yield frame.encode()


class _Lidar:
    def __init__(self) -> None:
        self._decoder = rplidar.SweepDecoder()

    @property
    def skipped_bytes(self) -> int:
        return self._decoder.skipped_bytes

    def again(self, chunk: bytes) -> Iterator[bytes]:
        for sweep in self._decoder.feed(chunk):
            yield sweep.encode()


class _LidarRequests:
    def __init__(self) -> None:
        self._decoder = rplidar.RequestDecoder()

    @property
    def skipped_bytes(self) -> int:
        return self._decoder.skipped_bytes

    def again(self, chunk: bytes) -> Iterator[bytes]:
        for command in self._decoder.feed(chunk):
            yield rplidar.request(command)


def _frames_of(port: int, direction: int) -> _Frames:
    if port == m.RADIO:
        return _Radio()
    if port == m.BASE:
        return _Base()
    return _LidarRequests() if direction else _Lidar()


class Reencoding:
    """One direction (records.FROM_DEVICE, TO_DEVICE) of one port since it was opened."""

    def __init__(self, port: int, direction: int) -> None:
        self._frames = _frames_of(port, direction)
        self._unmatched = bytearray()  # behind the last frame found again
        self._between = 0  # bytes between frames: noise, broken sweeps

    def feed(self, chunk: bytes) -> bytes | None:
        """None if all frames that `chunk` completes are found again, else the first one that is not."""
        self._unmatched += chunk
        for frame in self._frames.again(chunk):
            at = self._unmatched.find(frame)
            if at < 0:
                return frame
            self._between += at - len(rplidar.SCAN_DESCRIPTOR) * self._unmatched.count(
                rplidar.SCAN_DESCRIPTOR, 0, at
            )
            del self._unmatched[: at + len(frame)]
        return None

    @property
    def skipped_bytes(self) -> int:
        """What the decoder counted as noise."""
        return self._frames.skipped_bytes

    @property
    def unframed_bytes(self) -> int:
        """Bytes between frames that the decoder did not count as noise."""
        return max(0, self._between - self.skipped_bytes)
