"""The lidar of a simulated robot: RPLIDAR A1 requests in, descriptors and samples out. Knows no walls.

The motor always turns: a pseudo-terminal has no DTR line to stop it with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hippomat_core.wire import rplidar

SAMPLES_PER_S = 2000.0
SWEEPS_PER_S = 5.5
_QUALITY = 47
_CORRECT = 0  # health


@dataclass(frozen=True, slots=True)
class RangeErrors:
    """Standard deviation of a range [m], and the share of samples without a return."""

    noise_m: float = 0.005
    missed: float = 0.005


def sample_angles(first: int, count: int) -> NDArray[np.float64]:
    """Clockwise angles [rad] in [0, 2 pi) of samples first .. first + count - 1 since the motor started."""
    turns = (first + np.arange(count)) * (SWEEPS_PER_S / SAMPLES_PER_S)
    return np.asarray((turns - np.floor(turns)) * 2 * math.pi)


@dataclass(slots=True)
class VirtualLidar:
    """Bytes in, bytes out; ranges come from the world. Deterministic given the seed."""

    seed: int
    errors: RangeErrors = field(default_factory=RangeErrors)
    scanning: bool = False
    _requests: rplidar.RequestDecoder = field(default_factory=rplidar.RequestDecoder)
    _rng: np.random.Generator = field(init=False)
    _last_angle_rad: float = math.inf

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng([self.seed, 0x11DA])

    @property
    def info(self) -> rplidar.Info:
        """What the lidar says of itself: an A1 of no real serial number."""
        serial = self.seed.to_bytes(8, "big") + b"VIRTUAL\0"
        return rplidar.Info(model=24, firmware_minor=29, firmware_major=1, hardware=7, serial=serial)

    def receive(self, data: bytes) -> bytes:
        """The answers to the host's requests."""
        answers = []
        for command in self._requests.feed(data):
            if command == rplidar.GET_INFO:
                answers.append(rplidar.encode_info(self.info))
            elif command == rplidar.GET_HEALTH:
                answers.append(rplidar.encode_health(rplidar.Health(_CORRECT, 0)))
            elif command == rplidar.SCAN:
                self.scanning, self._last_angle_rad = True, math.inf
                answers.append(rplidar.encode_scan_descriptor())
            else:  # STOP, RESET
                self.scanning = False
        return b"".join(answers)

    def samples(self, clockwise_rad: NDArray[np.float64], ranges_m: NDArray[np.float64]) -> bytes:
        """The bytes of n samples; inf = no return. Empty while the lidar does not scan."""
        if not self.scanning or not len(clockwise_rad):
            return b""
        measured = ranges_m + self.errors.noise_m * self._rng.standard_normal(len(ranges_m))
        missed = self._rng.random(len(ranges_m)) < self.errors.missed
        returned = np.isfinite(ranges_m) & ~missed
        distance_q2 = np.where(returned, np.clip(np.rint(measured * 4000), 0, 65535), 0).astype(np.uint16)
        quality = np.where(returned, _QUALITY, 0).astype(np.uint8)
        angle_q6 = np.floor(np.degrees(clockwise_rad) * 64).astype(np.uint16)
        start = np.diff(clockwise_rad, prepend=self._last_angle_rad) < 0
        self._last_angle_rad = float(clockwise_rad[-1])
        return rplidar.encode_samples(quality, angle_q6, distance_q2, start)
