"""The base of a simulated robot: velocity frames in, feedback frames at 25 Hz out (facts: JetBot ROS AI kit).

Odometry counts what the wheels turn, not where the body goes: seeded scale errors and noise make it drift,
and against a wall it runs on. Knows no pose in the map. Like the real base it holds its last command.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from hippomat_core.wire.jetbot_base import VELOCITY, Decoder, Feedback, decode_velocity, encode_feedback

FEEDBACK_PERIOD_S = 0.04
_TRACK_M = 0.17  # between the wheels


@dataclass(frozen=True, slots=True)
class OdometryErrors:
    """Relative: scale is the spread of each robot's constant factors, noise that of every increment."""

    scale: float = 0.002
    noise: float = 0.002


@dataclass(slots=True)
class VirtualBase:
    """Bytes in, velocity out; wheel motion in, bytes out. Deterministic given the seed."""

    seed: int
    errors: OdometryErrors = field(default_factory=OdometryErrors)
    command: tuple[float, float] = (0.0, 0.0)  # v [m/s], wz [rad/s]
    velocity_frames: int = 0
    _decoder: Decoder = field(default_factory=Decoder)
    _rng: np.random.Generator = field(init=False)
    _scales: tuple[float, float] = field(init=False)
    _travel: list[float] = field(default_factory=lambda: [0.0, 0.0])  # path length [m], turn [rad], true
    _reported: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # odom frame: x, y [m], yaw [rad]
    _next_s: float = FEEDBACK_PERIOD_S

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng([self.seed, 0xBA5E])
        v, wz = 1.0 + self.errors.scale * self._rng.standard_normal(2)
        self._scales = float(v), float(wz)

    def receive(self, data: bytes) -> None:
        """Bytes from the host; the last velocity frame counts."""
        for frame in self._decoder.feed(data):
            if frame.type == VELOCITY:
                self.command = decode_velocity(frame)
                self.velocity_frames += 1

    def turn_wheels(self, v_mps: float, wz_radps: float, duration_s: float) -> None:
        """The wheels turned like this for a while."""
        self._travel[0] += v_mps * duration_s
        self._travel[1] += wz_radps * duration_s

    def feedback(self, now_s: float, v_mps: float, wz_radps: float) -> bytes:
        """The frame that is due, or nothing; call at least every FEEDBACK_PERIOD_S."""
        if now_s < self._next_s:
            return b""
        self._next_s += FEEDBACK_PERIOD_S
        noise = 1.0 + self.errors.noise * self._rng.standard_normal(2)
        distance_m = self._travel[0] * self._scales[0] * float(noise[0])
        turn_rad = self._travel[1] * self._scales[1] * float(noise[1])
        self._travel = [0.0, 0.0]
        before = [round(1000 * value) for value in self._reported]
        x, y, yaw = self._reported
        heading = yaw + turn_rad / 2
        self._reported = [
            x + distance_m * math.cos(heading),
            y + distance_m * math.sin(heading),
            yaw + turn_rad,
        ]
        after = [round(1000 * value) for value in self._reported]
        return encode_feedback(self._frame(before, after, v_mps, wz_radps))

    def _frame(self, before: list[int], after: list[int], v_mps: float, wz_radps: float) -> Feedback:
        dx, dy = after[0] - before[0], after[1] - before[1]
        # The increments are the differences of the rounded odometry, turned into the base frame.
        cos, sin = math.cos(before[2] / 1000), math.sin(before[2] / 1000)
        yaw_rad = math.remainder(after[2] / 1000, 2 * math.pi)
        left, right = v_mps - wz_radps * _TRACK_M / 2, v_mps + wz_radps * _TRACK_M / 2
        v_set, wz_set = self.command
        left_set, right_set = v_set - wz_set * _TRACK_M / 2, v_set + wz_set * _TRACK_M / 2
        return Feedback(
            gyro=(0, 0, _int16(math.degrees(wz_radps) / 2000 * 32768)),
            accel=(0, 0, 16384),  # 1 g
            attitude_ddeg=(0, 0, _int16(math.degrees(yaw_rad) * 10)),
            odom_x_mm=_wrapped(after[0]),
            odom_y_mm=_wrapped(after[1]),
            odom_yaw_mrad=_int16(1000 * yaw_rad),
            delta_x_mm=_int16(cos * dx + sin * dy),
            delta_y_mm=_int16(cos * dy - sin * dx),
            delta_yaw_mrad=after[2] - before[2],
            wheels=tuple(_int16(1000 * speed) for speed in (left, right, left_set, right_set)),
        )


def _int16(value: float) -> int:
    return max(-32768, min(32767, round(value)))


def _wrapped(value: int) -> int:
    """As the base's int16 does it."""
    return (value + 32768) % 65536 - 32768
