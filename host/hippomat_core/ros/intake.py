"""What events from ROS do to the robot's state, and how the faults of its links look when ROS is behind them.

step.py and faults.py come here for all that concerns ROS. What the messages mean is in feed.py.
"""

from __future__ import annotations

import math

import numpy as np

from hippomat_core.control.guard import carried_along, hidden_points
from hippomat_core.messages import (
    BASE,
    LIDAR,
    WARNING,
    AlarmCleared,
    AlarmRaised,
    Effect,
    LaserScanReceived,
    OdometryReceived,
    TransformReceived,
)
from hippomat_core.replaced import replace
from hippomat_core.ros.feed import (
    RosFeed,
    looks_all_round,
    says_something,
    with_odometry,
    with_scan,
    with_transform,
)
from hippomat_core.slam.pose2 import Pose, apart
from hippomat_core.state import Scan, State, elsewhere

NO_MOUNT = "scan_frame"
PATIENCE_SCANS = 10
RELOCATED_M, RELOCATED_RAD = 0.5, math.radians(20.0)
Stepped = tuple[State, tuple[Effect, ...]]


def ros_opened(state: State) -> State:
    """The bridge was reached: transforms, and what the clocks differ by, begin anew."""
    return _with_feed(_with_lidar(state, True), RosFeed())


def ros_lost(state: State) -> State:
    """Nothing comes any more: the pose gets old by itself, a lidar of ROS is gone at once."""
    state = _with_lidar(state, False)
    return replace(state, scan=None) if state.config.ros.scans else state


def transform(state: State, event: TransformReceived) -> Stepped:
    jumps, before = state.ros.jumps, state.external_pose
    state = _with_feed(state, with_transform(state.ros, event, state.config.ros))
    if _jumped(before, state.external_pose):
        state = elsewhere(state, event.stamp_ns)
    if state.ros.jumps == jumps:
        return state, ()
    text = "the odometry from ROS jumped, as after a restart of its node: does localization find the robot?"
    return replace(state, scan=None), (AlarmRaised(WARNING, "odometry_jump", text),)


def odometry_received(state: State, event: OdometryReceived) -> Stepped:
    return replace(state, ros=with_odometry(state.ros, event)), ()


def laser_scan(state: State, event: LaserScanReceived) -> Stepped:
    """The scan takes the age and the pose of its first ray: the guard must not think it newer than it is."""
    ros, lidar = state.config.ros, state.config.lidar
    feed, points, taken_ns = with_scan(state.ros, event, ros.base_frame)
    state = replace(state, ros=feed)
    if points is None:
        return _without_mount(state, event)
    if not says_something(event):  # a blinded lidar: what it saw last gets old
        return state, ()
    pose = feed.odom_at(taken_ns) if state.external_pose is not None else state.steady_pose
    if state.scan is not None:
        mount = feed.transforms.between(event.frame, ros.base_frame)
        at_m = (0.0, 0.0, 0.0) if mount is None else mount.move
        blind = replace(lidar, x_m=at_m[0], y_m=at_m[1], min_range_m=event.range_min_m)
        before = carried_along(state.scan.points, state.scan.pose, pose)
        points = np.concatenate([hidden_points(before, blind), points])
    state = replace(state, scan=Scan(taken_ns, points, pose, looks_all_round(event)))
    if NO_MOUNT not in state.alarms:
        return state, ()
    return replace(state, alarms=state.alarms - {NO_MOUNT}), (AlarmCleared(NO_MOUNT),)


def base_silent(state: State, now_ns: int, silent_ns: int) -> bool:
    """The base has not said for too long where it is."""
    if state.config.ros.drives:
        return now_ns - state.ros.moved_ns > silent_ns
    odometry = state.odometry
    return odometry.last is None or now_ns - odometry.stamp_ns > silent_ns


def not_localized(state: State, now_ns: int) -> bool:
    ros = state.config.ros
    if ros.localizes:
        return not state.ros.localized(now_ns, ros)
    return not state.config.robot.start_known


def text_for(state: State, code: str) -> str:
    """What an alarm says where ROS is what fails; "" where it is not."""
    ros = state.config.ros
    if code == "no_map" and ros.maps:
        return f"no map from ROS yet ({ros.map_topic}): is map_server active?"
    if code == "lidar_lost" and ros.scans:
        return f"no fresh scan from ROS ({ros.scan_topic}): standing still"
    if code == "base_lost" and ros.drives and state.ports[BASE]:
        return f"ROS does not say where {ros.base_frame} is ({ros.tf_topic}): does the base's driver run?"
    if code == "not_localized" and ros.localizes:
        return _why_not_localized(state)
    return ""


def _why_not_localized(state: State) -> str:
    ros, transforms = state.config.ros, state.ros.transforms
    top = transforms.top(ros.base_frame)
    if state.ros.pose is not None:
        return f"{ros.map_frame} -> {ros.base_frame} from ROS is too old: does localization (amcl) still run?"
    if top == ros.base_frame:
        return f"ROS says nothing of frame {ros.base_frame!r}: is [ros] base_frame right?"
    return f"no way from {ros.map_frame!r} to {top!r} in ROS's transforms: is localization (amcl) running?"


def _with_feed(state: State, feed: RosFeed) -> State:
    """A scan from before a pose of ROS came or went lies in another frame: the guard waits for the next."""
    known = state.external_pose is not None
    state = replace(state, ros=feed)
    return state if known == (state.external_pose is not None) else replace(state, scan=None)


def _jumped(before: Pose | None, after: Pose | None) -> bool:
    """Localization put the robot elsewhere; a correction while it drives is smaller."""
    if before is None or after is None:
        return before is not after
    away_m, turn_rad = apart(before, after)
    return away_m > RELOCATED_M or turn_rad > RELOCATED_RAD


def _with_lidar(state: State, is_open: bool) -> State:
    if not state.config.ros.scans:
        return state
    ports = list(state.ports)
    ports[LIDAR] = is_open
    return replace(state, ports=(ports[0], ports[1], ports[2]))


def _without_mount(state: State, event: LaserScanReceived) -> Stepped:
    """A scan that cannot be placed is no scan: said once, and not of the first, before its transform."""
    if NO_MOUNT in state.alarms or state.ros.unplaced < PATIENCE_SCANS:
        return state, ()
    text = (
        f"scans are in frame {event.frame!r}, which ROS's transforms do not tie to "
        f"{state.config.ros.base_frame!r}: publish it (static_transform_publisher)"
    )
    return replace(state, alarms=state.alarms | {NO_MOUNT}), (AlarmRaised(WARNING, NO_MOUNT, text),)
