"""A sweep as if it had all been seen at one instant, from one place.

A lidar turns while the robot drives: at 1 rad/s a sweep of 0.18 s is bent by ten degrees. Samples come evenly
in time. Poses are the odometry's, in the odom frame; knows no map.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import LidarConfig
from hippomat_core.control.guard import returns, scan_points
from hippomat_core.messages import ScanReceived
from hippomat_core.slam.odometry import Odometry
from hippomat_core.slam.pose2 import Pose, inverse
from hippomat_core.slam.poses import placed
from hippomat_core.slam.steady_clock import SteadyClock

SAMPLE_NS = 500_000.0  # an RPLIDAR A1 takes 2,000 samples a second in the standard scan


def deskewed(
    scan: ScanReceived, clock: SteadyClock, odometry: Odometry, lidar: LidarConfig
) -> tuple[NDArray[np.float64], Pose, int]:
    """The sweep's returns in the base frame, (n, 2) [m], their pose (odom frame), its stamp.

    The pose is the newest one that the odometry knows of the time of the sweep. Returns outside the lidar's
    range are left out.
    """
    kept = returns(scan, lidar)
    x_m, y_m = scan_points(scan, lidar).T
    taken_ns = clock.end_ns + np.arange(1 - len(kept), 1, dtype=np.float64)[kept] * clock.period_ns
    at_ns = min(clock.end_ns, odometry.clock.end_ns)
    east_m, north_m, yaw_rad = odometry.poses_at(taken_ns)
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    in_odom = np.stack([east_m + c * x_m - s * y_m, north_m + s * x_m + c * y_m], axis=1)
    x, y, yaw = (float(axis[0]) for axis in odometry.poses_at(np.array([float(at_ns)])))
    return placed(in_odom, inverse((x, y, yaw))), (x, y, yaw), at_ns
