"""What ROS says of where the robot is and what its lidar sees, as one value.

The pose is the chain map -> odom -> base (REP 105). Its upper part is a localization's correction: newest
wins, because AMCL stamps it a second ahead. Its lower part is the base's odometry, kept for a second, so that
a scan gets the pose it was taken at. Knows no map and no port.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import RosConfig
from hippomat_core.control.guard import HOLE_Q6
from hippomat_core.messages import LaserScanReceived, OdometryReceived, TransformReceived
from hippomat_core.replaced import replace
from hippomat_core.ros.clock import RosClock
from hippomat_core.ros.transforms import HERE, Edge, Pose2, Transforms, along
from hippomat_core.slam.odometry import FASTEST_RADPS, JUMP_M, JUMP_RAD
from hippomat_core.slam.pose2 import compose

TRAIL_NS = 1_000_000_000
SPEED_NS = 150_000_000  # a speed from transforms is a mean over so long
FASTEST_MPS = 5.0  # [limits] speed_mps goes no higher
TOLD_NS = 500_000_000  # a measured speed (/odom) holds for so long
FOREVER = 2**62

Place = tuple[int, float, float, float]  # stamp_ns; x [m], y [m], yaw [rad] in the odom frame


@dataclass(frozen=True, slots=True, eq=False)
class RosFeed:
    """Since ROS was reached; a value."""

    clock: RosClock = field(default_factory=RosClock)
    transforms: Transforms = field(default_factory=lambda: Transforms({}))
    correction: Pose2 | None = None  # odom in map; None: they do not connect yet
    corrected_ns: int = 0  # when that was last said; FOREVER: it is fixed
    trail: tuple[Place, ...] = ()  # base in odom, oldest first
    jumps: int = 0  # of the odometry: its node started anew
    unplaced: int = 0  # scans in a row in a frame that is not known
    told: tuple[int, float, float] | None = None  # /odom: stamp_ns, v [m/s], wz [rad/s]

    @property
    def pose(self) -> Pose2 | None:
        """The base in the map frame."""
        return None if self.correction is None or not self.trail else compose(self.correction, self.odom)

    @property
    def odom(self) -> Pose2:
        """The base in the odom frame, which drifts and never jumps."""
        return self.trail[-1][1:] if self.trail else (0.0, 0.0, 0.0)

    @property
    def moved_ns(self) -> int:
        """How fresh the lower part is."""
        return self.trail[-1][0] if self.trail else -FOREVER

    @property
    def velocity(self) -> tuple[float, float]:
        """(v, wz) in the base frame: as measured, else from the trail."""
        if self.told is not None and self.moved_ns - self.told[0] < TOLD_NS:
            return self.told[1:]
        return _speed(self.trail)

    def odom_at(self, stamp_ns: int) -> Pose2:
        """The base in the odom frame at that time: between what was said before and after, or the nearest."""
        for before, after in zip(reversed(self.trail[:-1]), reversed(self.trail), strict=False):
            if before[0] <= stamp_ns <= after[0]:
                return _between(before, after, stamp_ns)
        oldest = self.trail and stamp_ns < self.trail[0][0]
        return self.trail[0][1:] if oldest else self.odom

    def localized(self, now_ns: int, ros: RosConfig) -> bool:
        """Both parts of the chain are known and fresh."""
        return (
            self.pose is not None
            and now_ns - self.moved_ns <= ros.pose_timeout_s * 1e9
            and now_ns - self.corrected_ns <= ros.localization_timeout_s * 1e9
        )


def with_transform(feed: RosFeed, event: TransformReceived, ros: RosConfig) -> RosFeed:
    """After one transform, of whatever frames."""
    clock = feed.clock
    if not event.fixed and event.parent != ros.map_frame:  # AMCL's is stamped ahead
        clock = clock.heard(event.stamp_ns, event.ros_ns, f"{event.parent}>{event.child}")
    taken_ns = clock.taken_ns(event.stamp_ns, event.ros_ns)
    transforms = feed.transforms.with_transform(event, taken_ns)
    feed = replace(feed, clock=clock, transforms=transforms)
    way = transforms.way(ros.base_frame, ros.map_frame)
    if way is None:  # before a localization runs, the base's own odometry
        return _with_place(feed, transforms.way(ros.base_frame, transforms.top(ros.base_frame)) or ())
    upper = way[-1]
    if all(edge.fixed for edge in way[:-1]):  # somebody says map -> base directly
        return _with_place(replace(feed, correction=HERE.flat(), corrected_ns=FOREVER), way)
    corrected_ns = FOREVER if upper.fixed else upper.stamp_ns
    feed = replace(feed, correction=upper.rigid.flat(), corrected_ns=corrected_ns)
    return _with_place(feed, way[:-1])


def with_odometry(feed: RosFeed, event: OdometryReceived) -> RosFeed:
    clock = feed.clock.heard(event.stamp_ns, event.ros_ns, "odometry")
    if not (math.isfinite(event.v_mps) and math.isfinite(event.wz_radps)):
        return replace(feed, clock=clock)
    return replace(feed, clock=clock, told=(event.stamp_ns, event.v_mps, event.wz_radps))


def with_scan(
    feed: RosFeed, event: LaserScanReceived, base_frame: str
) -> tuple[RosFeed, NDArray[np.float64] | None, int]:
    """The feed, the scan's returns (n, 2) [m] in the base frame, and when its first ray was shot.

    None where the lidar's frame is not known in the base frame.
    """
    mount = feed.transforms.between(event.frame, base_frame)
    clock = feed.clock.heard(event.stamp_ns, event.ros_ns, f"scan {event.frame}")
    feed = replace(feed, clock=clock, unplaced=0 if mount is not None else feed.unplaced + 1)
    points = None if mount is None else mount.flattened(scan_returns(event))
    return feed, points, feed.clock.taken_ns(event.stamp_ns, event.ros_ns)


def scan_returns(event: LaserScanReceived) -> NDArray[np.float64]:
    """(n, 2) [m] in the lidar's frame; without what is outside the lidar's own limits, or no number."""
    range_m = event.ranges_m.astype(np.float64)
    with np.errstate(invalid="ignore"):
        kept = np.isfinite(range_m) & (range_m >= event.range_min_m) & (range_m <= event.range_max_m)
    angle_rad = event.angle_min_rad + event.angle_increment_rad * np.flatnonzero(kept)
    return np.stack([range_m[kept] * np.cos(angle_rad), range_m[kept] * np.sin(angle_rad)], axis=1)


def says_something(event: LaserScanReceived) -> bool:
    """False where no ray came to a result, not even to that of seeing nothing: that shows no free space."""
    return bool((event.ranges_m > -np.inf).any())


def looks_all_round(event: LaserScanReceived) -> bool:
    """True where the rays that came to a result leave no hole: of the serial lidars, is_whole."""
    angle_rad = event.angle_min_rad + event.angle_increment_rad * np.flatnonzero(event.ranges_m > -np.inf)
    if not len(angle_rad):
        return False
    angle_rad = np.sort(np.mod(angle_rad, math.tau))
    hole_rad = np.diff(angle_rad, append=angle_rad[0] + math.tau).max()
    return bool(hole_rad <= math.radians(HOLE_Q6 / 64))


def _with_place(feed: RosFeed, way: tuple[Edge, ...]) -> RosFeed:
    """The trail after the lower part of the chain was said; a part in which nothing moves is no odometry."""
    taken_ns = max((edge.taken_ns for edge in way if not edge.fixed), default=-FOREVER)
    if taken_ns < feed.moved_ns or taken_ns == -FOREVER:  # late: what came since is newer
        return feed
    place = (taken_ns, *along(way).flat())
    if feed.trail and _jumped(feed.trail[-1], place):
        return replace(feed, trail=(place,), jumps=feed.jumps + 1)
    kept = tuple(old for old in feed.trail if taken_ns - TRAIL_NS <= old[0] < taken_ns)
    return replace(feed, trail=(*kept, place))


def _jumped(before: Place, after: Place) -> bool:
    seconds = (after[0] - before[0]) / 1e9
    moved_m = math.hypot(after[1] - before[1], after[2] - before[2])
    turned_rad = abs(math.remainder(after[3] - before[3], math.tau))
    return moved_m > JUMP_M + FASTEST_MPS * seconds or turned_rad > JUMP_RAD + FASTEST_RADPS * seconds


def _between(before: Place, after: Place, stamp_ns: int) -> Pose2:
    part = (stamp_ns - before[0]) / max(after[0] - before[0], 1)
    turned_rad = math.remainder(after[3] - before[3], math.tau)
    return (
        before[1] + part * (after[1] - before[1]),
        before[2] + part * (after[2] - before[2]),
        math.remainder(before[3] + part * turned_rad, math.tau),
    )


def _speed(trail: tuple[Place, ...]) -> tuple[float, float]:
    if len(trail) < 2:
        return 0.0, 0.0
    now = trail[-1]
    then = next((old for old in reversed(trail) if now[0] - old[0] >= SPEED_NS), trail[0])
    seconds = (now[0] - then[0]) / 1e9
    turned_rad = math.remainder(now[3] - then[3], math.tau)
    middle_rad = then[3] + turned_rad / 2
    forward_m = (now[1] - then[1]) * math.cos(middle_rad) + (now[2] - then[2]) * math.sin(middle_rad)
    return forward_m / seconds, turned_rad / seconds
