"""When each sample of a sweep was taken, and the sweep as if it had all been seen at one instant.

A lidar turns while the robot drives: at 1 rad/s a sweep of 0.18 s is bent by ten degrees. Samples come evenly
in time, but bytes are read late by a varying while, so the end of a sweep is tracked rather than believed.
Poses are the odometry's, in the odom frame; knows no map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import LidarConfig
from hippomat_core.messages import ScanReceived
from hippomat_core.slam.odometry import Odometry
from hippomat_core.slam.pose2 import Pose, inverse, transformed

NO_STAMP = -1
MISSED_NS = 60_000_000  # further from the expected end than this: a sweep was missed
SETTLE = 1 / 16  # share of a late arrival that is believed; an early one is believed whole
DRIFT = 1 / 64  # share of it that goes into the time between two samples, once that is known
FASTEST_NS, SLOWEST_NS = 50_000.0, 1_500_000.0  # from one sample to the next; an A1's standard scan: 500,000


@dataclass(frozen=True, slots=True)
class SweepClock:
    """When the last sweep ended, and the time from one sample to the next."""

    end_ns: int = NO_STAMP
    sample_ns: float = 500_000.0
    seen: int = 0  # sweeps in a row

    def after(self, stamp_ns: int, count: int) -> SweepClock:
        """After one more sweep of `count` samples, whose last bytes were read at stamp_ns."""
        expected_ns = self.end_ns + round(count * self.sample_ns)
        late_ns = stamp_ns - expected_ns
        if self.seen == 1 and FASTEST_NS <= (stamp_ns - self.end_ns) / count <= SLOWEST_NS:
            return SweepClock(stamp_ns, (stamp_ns - self.end_ns) / count, 2)
        if self.seen < 2 or abs(late_ns) > MISSED_NS:
            return SweepClock(stamp_ns, self.sample_ns, 1)
        sample_ns = self.sample_ns + max(1 / self.seen, DRIFT) * late_ns / count
        end_ns = expected_ns + (late_ns if late_ns < 0 else round(SETTLE * late_ns))
        return SweepClock(end_ns, sample_ns, self.seen + 1)

    def stamps_ns(self, count: int) -> NDArray[np.float64]:
        """(count,) of the samples of the sweep that ended last, relative to its end."""
        return np.arange(1 - count, 1, dtype=np.float64) * self.sample_ns


def deskewed(
    scan: ScanReceived, clock: SweepClock, odometry: Odometry, lidar: LidarConfig
) -> tuple[NDArray[np.float64], Pose, int]:
    """The sweep's returns in the base frame, (n, 2) [m], their pose (odom frame), its stamp.

    The pose is the newest one that the odometry knows of the time of the sweep. Returns outside the lidar's
    range are left out.
    """
    range_m = scan.distance_q2 / 4000.0
    kept = (scan.distance_q2 > 0) & (range_m >= lidar.min_range_m) & (range_m <= lidar.max_range_m)
    range_m = range_m[kept]
    angle_rad = lidar.yaw_rad - np.deg2rad(scan.angle_q6[kept] / 64.0)
    x_m = lidar.x_m + range_m * np.cos(angle_rad)
    y_m = lidar.y_m + range_m * np.sin(angle_rad)
    taken_ns = clock.end_ns + clock.stamps_ns(len(scan.distance_q2))[kept]
    at_ns = min(clock.end_ns, odometry.stamp_ns)
    east_m, north_m, yaw_rad = odometry.poses_at(taken_ns)
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    in_odom = np.stack([east_m + c * x_m - s * y_m, north_m + s * x_m + c * y_m], axis=1)
    x, y, yaw = (float(axis[0]) for axis in odometry.poses_at(np.array([float(at_ns)])))
    return transformed(inverse((x, y, yaw)), in_odom), (x, y, yaw), at_ns
