"""The base link: frames of the Waveshare JetBot ROS AI kit, both directions (115200 8N1, no handshake).

`AA 55 SIZE TYPE payload CHECKSUM`; SIZE counts the whole frame, CHECKSUM is the sum of all bytes before it
modulo 256, integers are big-endian int16. Knows bytes and raw integers, and metres per second only for the
velocity command. Imports nothing heavy: the motor guard starts with this module and no NumPy.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

from hippomat_core.errors import WireError

BAUD = 115_200
HEAD = b"\xaa\x55"

FEEDBACK, VELOCITY, PID, CORRECTIONS = 0x01, 0x11, 0x12, 0x13
# Whole-frame sizes by type. The vendor's nodes differ in PID: kp, ki, kd on the JetBot; the JetRacer
# sibling adds a linear correction and the servo bias.
SIZES: dict[int, tuple[int, ...]] = {FEEDBACK: (45,), VELOCITY: (11,), PID: (11, 15), CORRECTIONS: (9,)}

_OVERHEAD = 5  # header, size, type, checksum
_VELOCITY = struct.Struct(">3h")
_FEEDBACK = struct.Struct(">19hH")
_INT16_MAX = 32_767


@dataclass(frozen=True, slots=True)
class BaseFrame:
    """One frame of the base link: its type and the bytes between type and checksum."""

    type: int
    payload: bytes

    def encode(self) -> bytes:
        """The frame as it is on the wire; raises WireError for a size that the type does not have."""
        size = len(self.payload) + _OVERHEAD
        if size not in SIZES.get(self.type, ()):
            known = ", ".join(f"0x{kind:02X}: {sizes}" for kind, sizes in SIZES.items())
            raise WireError(f"base frame of type 0x{self.type:02X} with {size} bytes; known sizes: {known}")
        body = HEAD + bytes((size, self.type)) + self.payload
        return body + bytes((sum(body) & 0xFF,))


class FeedbackFields(Protocol):
    """The raw integers of a 0x01 frame; messages.BaseFeedback has them too."""

    @property
    def gyro(self) -> Iterable[int]: ...
    @property
    def accel(self) -> Iterable[int]: ...
    @property
    def attitude_ddeg(self) -> Iterable[int]: ...
    @property
    def odom_x_mm(self) -> int: ...
    @property
    def odom_y_mm(self) -> int: ...
    @property
    def odom_yaw_mrad(self) -> int: ...
    @property
    def delta_x_mm(self) -> int: ...
    @property
    def delta_y_mm(self) -> int: ...
    @property
    def delta_yaw_mrad(self) -> int: ...
    @property
    def wheels(self) -> Iterable[int]: ...
    @property
    def reserved(self) -> int: ...


@dataclass(frozen=True, slots=True)
class Feedback:
    """A 0x01 frame as raw integers. gyro, accel: (3,); attitude: roll, pitch, yaw; wheels: see messages."""

    gyro: tuple[int, ...] = (0, 0, 0)  # raw / 32768 * 2000 deg/s
    accel: tuple[int, ...] = (0, 0, 0)  # raw / 32768 * 2 g
    attitude_ddeg: tuple[int, ...] = (0, 0, 0)
    odom_x_mm: int = 0  # wraps at 32.767 m: long runs use the increments
    odom_y_mm: int = 0
    odom_yaw_mrad: int = 0
    delta_x_mm: int = 0  # since the last frame, base frame
    delta_y_mm: int = 0
    delta_yaw_mrad: int = 0
    wheels: tuple[int, ...] = (0, 0, 0, 0)  # left, right speed; left, right set-point
    reserved: int = 0


class Decoder:
    """Bytes in, frames out, in any chunking. Every byte that is in no frame is counted.

    skipped_bytes: bytes that belong to no frame; bad_checksums: candidates with a wrong checksum. After a
    wrong candidate the search goes on one byte later, so a damaged frame never takes a whole one with it.
    """

    def __init__(self) -> None:
        self.skipped_bytes = 0
        self.bad_checksums = 0
        self._buffer = bytearray()

    @property
    def pending(self) -> int:
        """Bytes kept because they may begin a frame."""
        return len(self._buffer)

    def feed(self, chunk: bytes) -> Iterator[BaseFrame]:
        """The frames that `chunk` completes. Consume the iterator before the next call."""
        self._buffer += chunk
        while True:
            self._skip_to_head()
            if len(self._buffer) < 4:
                return
            size, kind = self._buffer[2], self._buffer[3]
            if size not in SIZES.get(kind, ()):
                self._skip(1)
            elif len(self._buffer) < size:
                return
            elif sum(self._buffer[: size - 1]) & 0xFF != self._buffer[size - 1]:
                self.bad_checksums += 1
                self._skip(1)
            else:
                payload = bytes(self._buffer[4 : size - 1])
                del self._buffer[:size]
                yield BaseFrame(kind, payload)

    def _skip_to_head(self) -> None:
        at = self._buffer.find(HEAD)
        if at < 0:  # the last byte may be the first of a header
            at = len(self._buffer) - self._buffer.endswith(HEAD[:1])
        self._skip(at)

    def _skip(self, count: int) -> None:
        self.skipped_bytes += count
        del self._buffer[:count]


def encode_velocity(v_mps: float, wz_radps: float) -> bytes:
    """The 0x11 frame: forward speed and turn rate, base frame (x forward, z up), clipped to int16.

    Raises WireError for a number that is not finite: such a command must never look like a speed.
    """
    return BaseFrame(VELOCITY, _VELOCITY.pack(_milli(v_mps), 0, _milli(wz_radps))).encode()


def decode_velocity(frame: BaseFrame) -> tuple[float, float]:
    """(v [m/s], wz [rad/s]) of a 0x11 frame."""
    _expect(frame, VELOCITY)
    v_mmps, _, wz_mradps = _VELOCITY.unpack(frame.payload)
    return v_mmps / 1000, wz_mradps / 1000


def encode_feedback(feedback: FeedbackFields) -> bytes:
    """The 0x01 frame of a Feedback or a messages.BaseFeedback; raises WireError outside int16."""
    f = feedback
    odometry = (f.odom_x_mm, f.odom_y_mm, f.odom_yaw_mrad, f.delta_x_mm, f.delta_y_mm, f.delta_yaw_mrad)
    numbers = [int(n) for n in (*f.gyro, *f.accel, *f.attitude_ddeg, *odometry, *f.wheels, f.reserved)]
    try:
        return BaseFrame(FEEDBACK, _FEEDBACK.pack(*numbers)).encode()
    except struct.error as error:
        raise WireError(f"base feedback does not fit its frame: {error}; found {numbers}") from None


def decode_feedback(frame: BaseFrame) -> Feedback:
    """The raw integers of a 0x01 frame."""
    _expect(frame, FEEDBACK)
    n = _FEEDBACK.unpack(frame.payload)
    odometry: tuple[int, int, int, int, int, int] = n[9:15]
    return Feedback(n[0:3], n[3:6], n[6:9], *odometry, n[15:19], n[19])


def _expect(frame: BaseFrame, kind: int) -> None:
    if frame.type != kind or len(frame.payload) + _OVERHEAD not in SIZES[kind]:
        found = f"type 0x{frame.type:02X} with {len(frame.payload)} payload bytes"
        raise WireError(f"expected a base frame of type 0x{kind:02X}, found {found}")


def _milli(value: float) -> int:
    try:
        return max(-_INT16_MAX, min(_INT16_MAX, round(value * 1000)))
    except (ValueError, OverflowError):
        raise WireError(f"velocity command {value!r} is not a finite number") from None
