"""ROS messages <-> events of the robot core, without loss for what we keep of them.

Decides which of a message's fields count, and what makes one unusable. Works on messages of any form (see
dialect.py). The way back serves replay: a stand-in for ROS says again what was recorded.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import MapError
from hippomat_core.maps.map_event import map_event
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import (
    Event,
    LaserScanReceived,
    MapReceived,
    OdometryReceived,
    TransformReceived,
)
from hippomat_logs.ros.dialect import MAP, ODOMETRY, SCAN, TF, Dialect, Undecodable

NS = 1_000_000_000
UPRIGHT = 1e-6  # a map's origin may be turned by no more [rad, about]


def grid_of(message: Any, name: str = "/map") -> OccupancyGrid:
    """The grid of a nav_msgs/OccupancyGrid; MapError where it is none that we can use."""
    info = message.info
    turn = info.origin.orientation
    if abs(turn.x) + abs(turn.y) + abs(turn.z) > UPRIGHT:
        raise MapError(f"{name}: the map's origin is turned, which is not supported: give origin yaw 0")
    cells = np.asarray(message.data)
    if cells.size != info.width * info.height or not cells.size:
        raise MapError(f"{name}: {cells.size} cells are not {info.width} x {info.height}")
    if cells.dtype != np.int8 and not ((cells >= -1) & (cells <= 100)).all():
        raise MapError(f"{name}: cells must be -1 or 0 .. 100")
    # ROS keeps the resolution in 32 bits: 0.05 comes as 0.05000000074505806, and the map's hash would differ
    resolution_m = float(str(np.float32(info.resolution)))
    shape = (info.height, info.width)
    grid = cells.astype(np.int8).reshape(shape)
    return OccupancyGrid(grid, resolution_m, float(info.origin.position.x), float(info.origin.position.y))


def events_of(kind: str, message: Any, fixed: bool = False) -> Iterator[Event]:
    """The events of one message, not stamped yet; raises MapError, or Undecodable where fields lack."""
    try:
        yield from _READERS[kind](message, fixed)
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise Undecodable(f"a {kind} that cannot be used: {error}") from None


def message_of(dialect: Dialect, event: Event) -> tuple[str, Any]:
    """(type, ROS 2 message) that says this event; KeyError for one that ROS does not say."""
    made: tuple[str, Any] = _WRITERS[type(event)](dialect, event)
    return made


# ---- from ROS ----


def _maps(message: Any, _: bool) -> Iterator[Event]:
    yield map_event(grid_of(message))


def _transforms(message: Any, fixed: bool) -> Iterator[Event]:
    for link in message.transforms:
        move, turn = link.transform.translation, link.transform.rotation
        yield TransformReceived(
            0,
            _ns(link.header.stamp),
            _frame(link.header.frame_id),
            _frame(link.child_frame_id),
            fixed,
            *map(float, (move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w)),
        )


def _scan(message: Any, _: bool) -> Iterator[Event]:
    if not (math.isfinite(_single(message.angle_min)) and 0.0 < abs(_single(message.angle_increment)) < 1.0):
        raise ValueError(f"rays from {message.angle_min} in steps of {message.angle_increment} rad")
    if not len(message.ranges):
        raise ValueError("no ranges")
    yield LaserScanReceived(
        0,
        _ns(message.header.stamp),
        _frame(message.header.frame_id),
        angle_min_rad=_single(message.angle_min),
        angle_increment_rad=_single(message.angle_increment),
        time_increment_s=_single(message.time_increment),
        range_min_m=_single(message.range_min),
        range_max_m=_single(message.range_max),
        ranges_m=_ranges(message.ranges),
    )


def _odometry(message: Any, _: bool) -> Iterator[Event]:
    twist = message.twist.twist
    yield OdometryReceived(0, _ns(message.header.stamp), float(twist.linear.x), float(twist.angular.z))


_READERS = {MAP: _maps, TF: _transforms, SCAN: _scan, ODOMETRY: _odometry}


def _ns(stamp: Any) -> int:
    return int(stamp.sec) * NS + int(stamp.nanosec)


def _frame(name: str) -> str:
    """tf2 has no leading slash, ROS 1's older nodes send one."""
    return str(name).removeprefix("/")


def _single(value: Any) -> float:
    """JSON of some servers rounds a 32-bit number to its shortest decimals; the number is the same."""
    return float(np.float32(value))


def _ranges(values: Any) -> NDArray[np.float32]:
    """inf wherever there is no number: JSON cannot tell infinity from the other kinds."""
    ranges_m = np.array(values, np.float32)  # None becomes nan
    ranges_m[~np.isfinite(ranges_m)] = np.inf
    return ranges_m


# ---- to ROS ----


def _header(dialect: Dialect, ros_ns: int, frame: str) -> Any:
    stamp = dialect.new("builtin_interfaces/msg/Time", sec=ros_ns // NS, nanosec=ros_ns % NS)
    return dialect.new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def _pose(dialect: Dialect, x_m: float = 0.0, y_m: float = 0.0) -> Any:
    point = dialect.new("geometry_msgs/msg/Point", x=x_m, y=y_m, z=0.0)
    turn = dialect.new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    return dialect.new("geometry_msgs/msg/Pose", position=point, orientation=turn)


def _vector(dialect: Dialect, x: float, y: float, z: float) -> Any:
    return dialect.new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _map_message(dialect: Dialect, event: MapReceived) -> tuple[str, Any]:
    info = dialect.new(
        "nav_msgs/msg/MapMetaData",
        map_load_time=dialect.new("builtin_interfaces/msg/Time", sec=0, nanosec=0),
        resolution=event.resolution_m,
        width=event.width,
        height=event.height,
        origin=_pose(dialect, event.origin_x_m, event.origin_y_m),
    )
    cells = np.asarray(event.cells, np.int8)
    return MAP, dialect.new(MAP, header=_header(dialect, 0, "map"), info=info, data=cells)


def _transform_message(dialect: Dialect, event: TransformReceived) -> tuple[str, Any]:
    turn = dialect.new("geometry_msgs/msg/Quaternion", x=event.qx, y=event.qy, z=event.qz, w=event.qw)
    move = _vector(dialect, event.x_m, event.y_m, event.z_m)
    link = dialect.new(
        "geometry_msgs/msg/TransformStamped",
        header=_header(dialect, event.ros_ns, event.parent),
        child_frame_id=event.child,
        transform=dialect.new("geometry_msgs/msg/Transform", translation=move, rotation=turn),
    )
    return TF, dialect.new(TF, transforms=[link])


def _scan_message(dialect: Dialect, event: LaserScanReceived) -> tuple[str, Any]:
    increment = event.angle_increment_rad
    message = dialect.new(
        SCAN,
        header=_header(dialect, event.ros_ns, event.frame),
        angle_min=event.angle_min_rad,
        angle_max=event.angle_min_rad + increment * max(len(event.ranges_m) - 1, 0),
        angle_increment=increment,
        time_increment=event.time_increment_s,
        scan_time=event.time_increment_s * len(event.ranges_m),
        range_min=event.range_min_m,
        range_max=event.range_max_m,
        ranges=np.ascontiguousarray(event.ranges_m, np.float32),
        intensities=np.zeros(0, np.float32),
    )
    return SCAN, message


def _odometry_message(dialect: Dialect, event: OdometryReceived) -> tuple[str, Any]:
    twist = dialect.new(
        "geometry_msgs/msg/Twist",
        linear=_vector(dialect, event.v_mps, 0.0, 0.0),
        angular=_vector(dialect, 0.0, 0.0, event.wz_radps),
    )
    unknown = np.zeros(36)
    message = dialect.new(
        ODOMETRY,
        header=_header(dialect, event.ros_ns, "odom"),
        child_frame_id="base_link",
        pose=dialect.new("geometry_msgs/msg/PoseWithCovariance", pose=_pose(dialect), covariance=unknown),
        twist=dialect.new("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
    )
    return ODOMETRY, message


_WRITERS: dict[type, Any] = {
    MapReceived: _map_message,
    TransformReceived: _transform_message,
    LaserScanReceived: _scan_message,
    OdometryReceived: _odometry_message,
}
