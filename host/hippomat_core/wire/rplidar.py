"""The lidar link: SLAMTEC RPLIDAR A1, standard scan (115200 8N1).

Requests are `A5 CMD`; answers start with a 7-byte descriptor. A scan is an endless run of 5-byte samples with
two check bits each and no checksum, so a decoder has to notice by itself that it lost its place. Knows bytes
and raw integers, not metres; the lidar's angles run clockwise.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import WireError

BAUD = 115_200
START = 0xA5
SCAN, STOP, RESET, GET_INFO, GET_HEALTH = 0x20, 0x25, 0x40, 0x50, 0x52
COMMANDS = (SCAN, STOP, RESET, GET_INFO, GET_HEALTH)

SCAN_DESCRIPTOR = bytes.fromhex("a55a0500004081")
INFO_DESCRIPTOR = bytes.fromhex("a55a1400000004")
HEALTH_DESCRIPTOR = bytes.fromhex("a55a0300000006")
INFO_SIZE, HEALTH_SIZE, SAMPLE_SIZE = 20, 3, 5

HUNT_SAMPLES = 8  # samples in a row that must check before a lost place counts as found: 1 in 4**8 by chance
MAX_SWEEP_SAMPLES = 8192  # an A1 gives at most 8000 / 5.5 Hz = 1455

_HUNT_BYTES = HUNT_SAMPLES * SAMPLE_SIZE
_HEALTH = struct.Struct("<BH")


@dataclass(frozen=True, slots=True)
class Info:
    """Answer to GET_INFO."""

    model: int
    firmware_minor: int
    firmware_major: int
    hardware: int
    serial: bytes  # 16 bytes

    def __str__(self) -> str:
        firmware = f"{self.firmware_major}.{self.firmware_minor:02d}"
        return f"RPLIDAR model {self.model}, firmware {firmware}, serial {self.serial.hex().upper()}"


@dataclass(frozen=True, slots=True)
class Health:
    """Answer to GET_HEALTH; status 0 good, 1 warning, 2 error."""

    status: int
    error: int


@dataclass(frozen=True, eq=False, slots=True)
class Sweep:
    """One revolution, first sample = the one with the start bit. All arrays (n,), raw integers."""

    quality: NDArray[np.uint8]  # 6 bits
    angle_q6: NDArray[np.uint16]  # degrees * 64, 15 bits, clockwise
    distance_q2: NDArray[np.uint16]  # millimetres * 4; 0 = no return

    def encode(self) -> bytes:
        """The samples as they came: start bit on the first only."""
        start = np.zeros(len(self.quality), dtype=np.bool_)
        start[:1] = True
        return encode_samples(self.quality, self.angle_q6, self.distance_q2, start)


def request(command: int) -> bytes:
    """The two bytes of a request."""
    return bytes((START, command))


class RequestDecoder:
    """The device's side: bytes in, known commands out, in any chunking; the rest is counted."""

    def __init__(self) -> None:
        self.skipped_bytes = 0
        self._started = False

    def feed(self, chunk: bytes) -> Iterator[int]:
        """The commands that `chunk` completes. Consume the iterator before the next call."""
        for byte in chunk:
            if self._started and byte in COMMANDS:
                self._started = False
                yield byte
                continue
            self.skipped_bytes += self._started  # the A5 before this byte led nowhere
            self._started = byte == START
            self.skipped_bytes += not self._started


def encode_info(info: Info) -> bytes:
    """Descriptor and body of the answer to GET_INFO."""
    if len(info.serial) != 16:
        raise WireError(f"lidar serial number has {len(info.serial)} bytes, must have 16")
    numbers = (info.model, info.firmware_minor, info.firmware_major, info.hardware)
    return INFO_DESCRIPTOR + bytes(numbers) + info.serial


def encode_health(health: Health) -> bytes:
    """Descriptor and body of the answer to GET_HEALTH."""
    return HEALTH_DESCRIPTOR + _HEALTH.pack(health.status, health.error)


def encode_scan_descriptor() -> bytes:
    """What the lidar sends once, before the samples."""
    return SCAN_DESCRIPTOR


def find_info(data: bytes) -> Info | None:
    """The last complete GET_INFO answer in `data`, or None."""
    at = data.rfind(INFO_DESCRIPTOR, 0, max(0, len(data) - INFO_SIZE))
    if at < 0:
        return None
    body = data[at + len(INFO_DESCRIPTOR) :][:INFO_SIZE]
    return Info(body[0], body[1], body[2], body[3], bytes(body[4:20]))


def find_health(data: bytes) -> Health | None:
    """The last complete GET_HEALTH answer in `data`, or None."""
    at = data.rfind(HEALTH_DESCRIPTOR, 0, max(0, len(data) - HEALTH_SIZE))
    if at < 0:
        return None
    return Health(*_HEALTH.unpack_from(data, at + len(HEALTH_DESCRIPTOR)))


def encode_samples(
    quality: NDArray[np.uint8],
    angle_q6: NDArray[np.uint16],
    distance_q2: NDArray[np.uint16],
    start: NDArray[np.bool_],
) -> bytes:
    """5 bytes per sample; all arguments (n,). Raises WireError where a value needs more bits than it has."""
    if quality.size and (int(quality.max()) > 0x3F or int(angle_q6.max()) > 0x7FFF):
        raise WireError(
            f"lidar sample out of range: quality {int(quality.max())} (at most 63), "
            f"angle_q6 {int(angle_q6.max())} (at most 32767)"
        )
    rows = np.empty((len(quality), SAMPLE_SIZE), dtype=np.uint8)
    rows[:, 0] = quality.astype(np.uint8) << 2 | np.where(start, 1, 2).astype(np.uint8)
    rows[:, 1:3] = (angle_q6.astype("<u2") << 1 | 1).astype("<u2").view(np.uint8).reshape(-1, 2)
    rows[:, 3:5] = distance_q2.astype("<u2").view(np.uint8).reshape(-1, 2)
    return rows.tobytes()


class SweepDecoder:
    """Bytes of a running scan in, whole sweeps out, in any chunking.

    A sweep is complete when the next one's start bit is seen. Samples before the first start bit, and a sweep
    with a hole in it, are dropped: half a sweep would show free space where nobody looked.
    skipped_bytes: bytes that are neither descriptor nor sample; bad_checksums: times the place was lost.
    """

    def __init__(self) -> None:
        self.skipped_bytes = 0
        self.bad_checksums = 0
        self._buffer = bytearray()
        self._locked = False
        self._rows: list[NDArray[np.uint8]] | None = None  # of the sweep that has begun

    def feed(self, chunk: bytes) -> Iterator[Sweep]:
        """The sweeps that `chunk` completes. Consume the iterator before the next call."""
        self._buffer += chunk
        while True:
            if not self._locked and not self._hunt():
                return
            rows = self._checked_rows()
            yield from self._sweeps(rows)
            if self._locked:
                return

    def _hunt(self) -> bool:
        """Skip to the next descriptor or the next HUNT_SAMPLES good samples; False: more bytes needed."""
        data = bytes(self._buffer)
        raw = np.frombuffer(data, dtype=np.uint8)
        good = _good(raw[:-1], raw[1:])
        places = max(0, len(data) - _HUNT_BYTES + 1)  # offsets with enough bytes behind them to judge
        run = np.ones(places, dtype=np.bool_)
        for k in range(HUNT_SAMPLES):
            run &= good[k * SAMPLE_SIZE :][:places]
        sampled = int(run.argmax()) if run.any() else places
        described = data.find(SCAN_DESCRIPTOR, 0, sampled + len(SCAN_DESCRIPTOR))
        found = described if described >= 0 else sampled
        self.skipped_bytes += found
        del self._buffer[:found]
        if described >= 0:
            del self._buffer[: len(SCAN_DESCRIPTOR)]
        self._locked = described >= 0 or sampled < places
        return self._locked

    def _checked_rows(self) -> NDArray[np.uint8]:
        """Take the whole samples off the buffer, up to the first that fails its check bits."""
        count = len(self._buffer) // SAMPLE_SIZE
        rows = np.frombuffer(bytes(self._buffer[: count * SAMPLE_SIZE]), dtype=np.uint8)
        rows = rows.reshape(count, SAMPLE_SIZE)
        good = _good(rows[:, 0], rows[:, 1])
        if not good.all():
            self._locked = False
            rows = rows[: int(good.argmin())]
        del self._buffer[: rows.size]
        return rows

    def _sweeps(self, rows: NDArray[np.uint8]) -> Iterator[Sweep]:
        begun = 0
        for start in np.flatnonzero(rows[:, 0] & 1):
            if self._rows is not None and (sweep := _sweep([*self._rows, rows[begun:start]])):
                yield sweep
            self._rows = []
            begun = int(start)
        if not self._locked:
            self._lose_place()
        elif self._rows is not None:
            self._rows.append(rows[begun:])
            if sum(map(len, self._rows)) > MAX_SWEEP_SAMPLES:
                self._rows = None

    def _lose_place(self) -> None:
        self._rows = None
        if not self._buffer.startswith(SCAN_DESCRIPTOR[:2]):  # a restarted scan is not damage
            self.bad_checksums += 1


def _good(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Check bits of a sample: S and its inverse differ, bit 0 of the second byte is 1."""
    good: NDArray[np.bool_] = ((first ^ first >> 1) & second & 1).astype(np.bool_)
    return good


def _sweep(parts: list[NDArray[np.uint8]]) -> Sweep | None:
    rows = np.concatenate(parts)
    if len(rows) > MAX_SWEEP_SAMPLES:
        return None
    angle = rows[:, 1:3].copy().view("<u2").ravel() >> 1
    distance = rows[:, 3:5].copy().view("<u2").ravel()
    quality = (rows[:, 0] >> 2).astype(np.uint8)
    return Sweep(quality, angle.astype(np.uint16), distance.astype(np.uint16))
