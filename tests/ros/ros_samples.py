"""Transforms and scans as a ROS says them whose clock is years ahead of ours."""

from __future__ import annotations

import math

import numpy as np

from hippomat_core.messages import LaserScanReceived, TransformReceived

MS = 1_000_000
OFFSET_NS = -1_700_000_000_000 * MS  # our clock minus ROS's


def transform(
    parent: str,
    child: str,
    at_ms: float,
    pose=(0.0, 0.0, 0.0),
    fixed=False,
    ahead_ms=0.0,
    late_ms=0.0,
    z_m=0.0,
) -> TransformReceived:
    stamp_ns = round(at_ms * MS)
    ros_ns = stamp_ns - OFFSET_NS + round((ahead_ms - late_ms) * MS)
    x_m, y_m, yaw_rad = pose
    turn = (0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2))
    return TransformReceived(stamp_ns, ros_ns, parent, child, fixed, x_m, y_m, z_m, *turn)


def scan(at_ms: float, ranges, frame="laser", late_ms=0.0, low=-math.pi / 2, step=math.pi / 2):
    stamp_ns = round(at_ms * MS)
    ros_ns = stamp_ns - OFFSET_NS - round(late_ms * MS)
    return LaserScanReceived(stamp_ns, ros_ns, frame, low, step, 0.0, 0.1, 10.0, np.array(ranges, np.float32))
