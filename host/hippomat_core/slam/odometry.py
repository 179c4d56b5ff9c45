"""Dead reckoning: the robot's pose in the map frame from the base's odometry and a known start pose.

Knows encoder poses only, so it drifts; scan matching replaces it where a saved map is localized in. The
base (Waveshare JetBot ROS AI kit) counts in int16 millimetres and milliradians that wrap, so only differences
are used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from hippomat_core.messages import BaseFeedback

JUMP_M = 0.5  # more than this between two frames (40 ms): the base restarted its counters
JUMP_RAD = 0.5  # the same of its heading, beyond what can be turned meanwhile
FASTEST_RADPS = 10.0  # [limits] turn_radps goes no higher
SPEED_WINDOW_NS = 100_000_000


@dataclass(frozen=True, slots=True)
class Odometry:
    """Pose in the map frame (x east, y north, yaw counter-clockwise) and measured speed in the base frame."""

    x_m: float
    y_m: float
    yaw_rad: float
    v_mps: float = 0.0
    wz_radps: float = 0.0
    last: tuple[int, int, int] | None = None  # raw x_mm, y_mm, yaw_mrad of the last frame
    stamp_ns: int = 0
    window: tuple[int, float, float] = (0, 0.0, 0.0)  # since when, driven [m], turned [rad]
    jumps: int = 0


def moved(odometry: Odometry, feedback: BaseFeedback) -> Odometry:
    """The pose after one frame of the base; a jump of its counters moves nothing and is counted."""
    raw = (feedback.odom_x_mm, feedback.odom_y_mm, feedback.odom_yaw_mrad)
    if odometry.last is None:
        return replace(odometry, last=raw, stamp_ns=feedback.stamp_ns, window=(feedback.stamp_ns, 0.0, 0.0))
    east_m = _wrapped(raw[0] - odometry.last[0]) / 1000.0
    north_m = _wrapped(raw[1] - odometry.last[1]) / 1000.0
    turned_rad = math.remainder(_wrapped(raw[2] - odometry.last[2]) / 1000.0, math.tau)
    turnable_rad = JUMP_RAD + FASTEST_RADPS * max(feedback.stamp_ns - odometry.stamp_ns, 0) / 1e9
    if math.hypot(east_m, north_m) > JUMP_M or abs(turned_rad) > turnable_rad:
        return replace(odometry, last=raw, stamp_ns=feedback.stamp_ns, jumps=odometry.jumps + 1)

    # The base reports in its own odom frame: turn the step into the base frame, then into the map frame.
    odom_yaw = odometry.last[2] / 1000.0
    forward_m = math.cos(odom_yaw) * east_m + math.sin(odom_yaw) * north_m
    left_m = -math.sin(odom_yaw) * east_m + math.cos(odom_yaw) * north_m
    yaw = odometry.yaw_rad
    measured = _speed(odometry, feedback.stamp_ns, forward_m, turned_rad)
    return replace(
        measured,
        x_m=odometry.x_m + math.cos(yaw) * forward_m - math.sin(yaw) * left_m,
        y_m=odometry.y_m + math.sin(yaw) * forward_m + math.cos(yaw) * left_m,
        yaw_rad=math.remainder(yaw + turned_rad, math.tau),
        last=raw,
        stamp_ns=feedback.stamp_ns,
    )


def _wrapped(difference: int) -> int:
    return (difference + 0x8000) % 0x10000 - 0x8000


def _speed(odometry: Odometry, stamp_ns: int, forward_m: float, turned_rad: float) -> Odometry:
    """Mean speed over about 100 ms: single frames arrive too unevenly to divide by their spacing."""
    since_ns, driven_m, turned_sum_rad = odometry.window
    driven_m += forward_m
    turned_sum_rad += turned_rad
    elapsed_ns = stamp_ns - since_ns
    if elapsed_ns < SPEED_WINDOW_NS:
        return replace(odometry, window=(since_ns, driven_m, turned_sum_rad))
    seconds = elapsed_ns / 1e9
    return replace(
        odometry,
        v_mps=driven_m / seconds,
        wz_radps=turned_sum_rad / seconds,
        window=(stamp_ns, 0.0, 0.0),
    )
