"""Dead reckoning: the robot's pose in the odom frame, which begins where the robot is told that it stands.

Knows encoder poses only, so it drifts; scan matching (localizer.py) says where the odom frame lies in the
map. Without a lidar's help the two frames are one. The base (Waveshare JetBot ROS AI kit) counts in int16
millimetres and milliradians that wrap, so only differences are used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.messages import BaseFeedback
from hippomat_core.replaced import replace
from hippomat_core.slam.steady_clock import SteadyClock

JUMP_M = 0.5  # more than this between two frames (40 ms): the base restarted its counters
JUMP_RAD = 0.5  # the same of its heading, beyond what can be turned meanwhile
FASTEST_RADPS = 10.0  # [limits] turn_radps goes no higher
SPEED_WINDOW_NS = 100_000_000
TRAIL_NS = 500_000_000  # of past poses are kept: a sweep takes 0.1 .. 0.2 s and is read a little later
FRAME_NS = 40_000_000.0  # between two frames of the base
AHEAD_NS = 80_000_000  # frames are 40 ms apart: the speed of the last one is believed for two

Trail = tuple[tuple[int, float, float, float], ...]  # stamp_ns, x [m], y [m], yaw [rad] without wrapping


@dataclass(frozen=True, slots=True)
class Odometry:
    """Pose in the odom frame (yaw counter-clockwise) and measured speed in the base frame."""

    x_m: float
    y_m: float
    yaw_rad: float
    v_mps: float = 0.0
    wz_radps: float = 0.0
    last: tuple[int, int, int] | None = None  # raw x_mm, y_mm, yaw_mrad of the last frame
    stamp_ns: int = 0
    window: tuple[int, float, float] = (0, 0.0, 0.0)  # since when, driven [m], turned [rad]
    jumps: int = 0
    clock: SteadyClock = SteadyClock(FRAME_NS)  # noqa: RUF009  # frozen
    trail: Trail = ()  # oldest first; the last one is the pose itself

    @property
    def pose(self) -> tuple[float, float, float]:
        return self.x_m, self.y_m, self.yaw_rad

    def poses_at(
        self, stamps_ns: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """x [m], y [m], yaw [rad], (n,) each, at some stamps: between the trail's poses, and on from there.

        Before the oldest pose the robot is taken to have stood there.
        """
        if not self.trail:
            return tuple(np.full(len(stamps_ns), value) for value in self.pose)  # type: ignore[return-value]
        trail = np.array(self.trail)
        since_ns = trail[:, 0] - trail[-1, 0]
        at_ns = stamps_ns - trail[-1, 0]
        x, y, yaw = (np.interp(at_ns, since_ns, trail[:, column]) for column in (1, 2, 3))
        after_s = np.clip(at_ns, 0, AHEAD_NS) / 1e9
        if len(trail) > 1 and after_s.any():
            rate = (trail[-1, 1:] - trail[-2, 1:]) / max((trail[-1, 0] - trail[-2, 0]) / 1e9, 1e-3)
            x, y, yaw = x + rate[0] * after_s, y + rate[1] * after_s, yaw + rate[2] * after_s
        return x, y, yaw


def moved(odometry: Odometry, feedback: BaseFeedback) -> Odometry:
    """The pose after one frame of the base; a jump of its counters moves nothing and is counted."""
    raw = (feedback.odom_x_mm, feedback.odom_y_mm, feedback.odom_yaw_mrad)
    clock = odometry.clock.after(feedback.stamp_ns)
    if odometry.last is None:
        begun = (feedback.stamp_ns, 0.0, 0.0)
        trail = ((clock.end_ns, *odometry.pose),)
        return replace(odometry, clock=clock, last=raw, stamp_ns=feedback.stamp_ns, window=begun, trail=trail)
    east_m = _wrapped(raw[0] - odometry.last[0]) / 1000.0
    north_m = _wrapped(raw[1] - odometry.last[1]) / 1000.0
    turned_rad = math.remainder(_wrapped(raw[2] - odometry.last[2]) / 1000.0, math.tau)
    turnable_rad = JUMP_RAD + FASTEST_RADPS * max(feedback.stamp_ns - odometry.stamp_ns, 0) / 1e9
    if math.hypot(east_m, north_m) > JUMP_M or abs(turned_rad) > turnable_rad:
        jumps = odometry.jumps + 1
        return replace(odometry, clock=clock, last=raw, stamp_ns=feedback.stamp_ns, jumps=jumps)

    # The base has an odom frame of its own: turn the step into the base frame, then into our odom frame.
    odom_yaw = odometry.last[2] / 1000.0
    forward_m = math.cos(odom_yaw) * east_m + math.sin(odom_yaw) * north_m
    left_m = -math.sin(odom_yaw) * east_m + math.cos(odom_yaw) * north_m
    yaw = odometry.yaw_rad
    x_m = odometry.x_m + math.cos(yaw) * forward_m - math.sin(yaw) * left_m
    y_m = odometry.y_m + math.sin(yaw) * forward_m + math.cos(yaw) * left_m
    v_mps, wz_radps, window = _speed(odometry, feedback.stamp_ns, forward_m, turned_rad)
    return replace(
        odometry,
        x_m=x_m,
        y_m=y_m,
        yaw_rad=math.remainder(yaw + turned_rad, math.tau),
        v_mps=v_mps,
        wz_radps=wz_radps,
        last=raw,
        stamp_ns=feedback.stamp_ns,
        window=window,
        clock=clock,
        trail=_longer(odometry, (clock.end_ns, x_m, y_m, turned_rad)),
    )


def _longer(odometry: Odometry, newest: tuple[int, float, float, float]) -> Trail:
    """The trail with one more pose, whose last entry is the turn since the one before."""
    stamp_ns, x_m, y_m, turned_rad = newest
    before_rad = odometry.trail[-1][3] if odometry.trail else odometry.yaw_rad
    recent = [pose for pose in odometry.trail if 0 < stamp_ns - pose[0] <= TRAIL_NS]
    return (*recent, (stamp_ns, x_m, y_m, before_rad + turned_rad))


def _wrapped(difference: int) -> int:
    return (difference + 0x8000) % 0x10000 - 0x8000


def _speed(
    odometry: Odometry, stamp_ns: int, forward_m: float, turned_rad: float
) -> tuple[float, float, tuple[int, float, float]]:
    """v [m/s], wz [rad/s] and window. Mean speed over about 100 ms: single frames arrive too unevenly."""
    since_ns, driven_m, turned_sum_rad = odometry.window
    driven_m += forward_m
    turned_sum_rad += turned_rad
    elapsed_ns = stamp_ns - since_ns
    if elapsed_ns < SPEED_WINDOW_NS:
        return odometry.v_mps, odometry.wz_radps, (since_ns, driven_m, turned_sum_rad)
    seconds = elapsed_ns / 1e9
    return driven_m / seconds, turned_sum_rad / seconds, (stamp_ns, 0.0, 0.0)
