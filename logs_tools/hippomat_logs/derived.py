"""Standard ROS topics computed from our records, so that RViz and Foxglove show a run without a plug-in.

Frames map -> odom -> base_link -> lidar (REP 105). These messages are a view: replay never reads them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from hippomat_core import messages as m
from hippomat_core.config import Config
from hippomat_logs.cdr_template import Template
from hippomat_logs.scan_kernel import SCAN_BINS, nearest_by_degree
from hippomat_logs.schema import DERIVED, MessageStore

_ROS_LEVELS = {m.INFO: 20, m.WARNING: 30, m.ERROR: 40}
Pose = tuple[float, float, float]
_STAMP = ("header.stamp.sec", "header.stamp.nanosec")
_TF_PATHS = tuple(
    f"transforms[{k}].{path}"
    for k in (0, 1)
    for path in (
        *_STAMP,
        *(f"transform.translation.{axis}" for axis in "xy"),
        *(f"transform.rotation.{axis}" for axis in "zw"),
    )
)
_ODOMETRY_PATHS = (
    *_STAMP,
    *(f"pose.pose.position.{axis}" for axis in "xy"),
    *(f"pose.pose.orientation.{axis}" for axis in "zw"),
    "twist.twist.linear.x",
    "twist.twist.angular.z",
)


class DerivedTopics:
    """Feed every record in order; keeps the last map and the integrated wheel odometry.

    prefix: of every frame but the map's, e.g. "robot03/", where several robots are shown at once.
    """

    def __init__(self, store: MessageStore, config: Config, prefix: str = "") -> None:
        self._prefix = prefix
        self._store = store
        self._lidar = config.lidar
        self._base_frame = config.ros.base_frame
        self._name = f"robot{config.robot.id}"
        self._odom: Pose = (0.0, 0.0, 0.0)
        self._map: m.MapReceived | None = None
        origin = (0.0, 0.0, 0.0)
        # templates: building these messages anew for every pose costs thirty times as much
        links = [self._transform(0, "map", "odom", origin), self._transform(0, "odom", "base_link", origin)]
        self._tf = self._template("/tf", self._new(DERIVED["/tf"], transforms=links), _TF_PATHS)
        self._odometry = self._template("/odom", self._new_odometry(), _ODOMETRY_PATHS)
        self._scans = self._template("/scan", self._new_scan(), _STAMP)
        self._ranges, self._intensities = self._scans.array("ranges"), self._scans.array("intensities")
        none = np.zeros(0, np.uint16)
        self._scan(m.ScanReceived(0, none.astype(np.uint8), none, none), 0)  # compiles
        self._views: dict[type, Callable[[Any, int], Iterable[tuple[str, bytes]]]] = {
            m.PoseEstimated: self._pose,
            m.BaseFeedback: self._integrate,
            m.ScanReceived: lambda scan, t: [self._scan(scan, t)],
            m.PathPlanned: lambda path, t: [self._path(path, t)],
            m.MapReceived: lambda grid, t: [self._grid(grid, t)],
            m.AlarmRaised: lambda alarm, t: [self._alarm(alarm, t)],
            m.LaserScanReceived: lambda scan, t: [self._laser(scan, t)],
            m.TransformReceived: self._mounts,
        }

    def static(self) -> Iterator[tuple[str, bytes]]:
        lidar = self._lidar
        offset = self._transform(0, "base_link", "lidar", (lidar.x_m, lidar.y_m, lidar.yaw_rad), lidar.z_m)
        yield self._encode("/tf_static", transforms=[offset])

    @property
    def kinds(self) -> frozenset[type]:
        """Records that of() must be given, in their order; nothing follows from any other."""
        return frozenset(self._views)

    def of(self, record: Any, log_time_ns: int) -> Iterable[tuple[str, bytes]]:
        """(topic, CDR) of everything that follows from one record; often nothing."""
        view = self._views.get(type(record))
        return view(record, log_time_ns) if view else ()

    def _integrate(self, feedback: m.BaseFeedback, _: int) -> Iterable[tuple[str, bytes]]:
        """Increments, not the absolute fields: int16 millimetres wrap at 32.767 m."""
        x, y, yaw = self._odom
        dx, dy, dyaw = feedback.delta_x_mm / 1e3, feedback.delta_y_mm / 1e3, feedback.delta_yaw_mrad / 1e3
        c, s = math.cos(yaw + dyaw / 2), math.sin(yaw + dyaw / 2)
        self._odom = (x + c * dx - s * dy, y + s * dx + c * dy, yaw + dyaw)
        return ()

    def _pose(self, pose: m.PoseEstimated, t: int) -> Iterable[tuple[str, bytes]]:
        in_odom = (*divmod(t, 10**9), *_planar(self._odom))
        map_to_odom = _compose((pose.x_m, pose.y_m, pose.yaw_rad), _inverse(self._odom))
        links = (*in_odom[:2], *_planar(map_to_odom), *in_odom)
        return (
            ("/tf", self._tf.fill(*links)),
            ("/odom", self._odometry.fill(*in_odom, pose.v_mps, pose.wz_radps)),
        )

    def _new_odometry(self) -> Any:
        zero, still = np.zeros(36), self._xyz(0.0, 0.0, 0.0)
        twist = self._new("geometry_msgs/msg/Twist", still, self._xyz(0.0, 0.0, 0.0))
        return self._new(
            DERIVED["/odom"],
            header=self._header(0, "odom"),
            child_frame_id=self._frame("base_link"),
            pose=self._new("geometry_msgs/msg/PoseWithCovariance", self._at((0.0, 0.0, 0.0)), zero),
            twist=self._new("geometry_msgs/msg/TwistWithCovariance", twist, zero),
        )

    def _scan(self, scan: m.ScanReceived, t: int) -> tuple[str, bytes]:
        """Nearest return per degree."""
        nearest_by_degree(scan.angle_q6, scan.distance_q2, scan.quality, self._ranges, self._intensities)
        return "/scan", self._scans.fill(*divmod(t, 10**9))

    def _new_scan(self) -> Any:
        step = 2 * math.pi / SCAN_BINS
        return self._new(
            DERIVED["/scan"],
            header=self._header(0, "lidar"),
            angle_min=0.0,
            angle_max=step * (SCAN_BINS - 1),
            angle_increment=step,
            time_increment=0.0,
            scan_time=0.0,
            range_min=self._lidar.min_range_m,
            range_max=self._lidar.max_range_m,
            ranges=np.zeros(SCAN_BINS, np.float32),
            intensities=np.zeros(SCAN_BINS, np.float32),
        )

    def _laser(self, scan: m.LaserScanReceived, t: int) -> tuple[str, bytes]:
        """As ROS said it, at our time."""
        return self._encode(
            "/scan",
            header=self._header(t, scan.frame),
            angle_min=scan.angle_min_rad,
            angle_max=scan.angle_min_rad + scan.angle_increment_rad * max(len(scan.ranges_m) - 1, 0),
            angle_increment=scan.angle_increment_rad,
            time_increment=scan.time_increment_s,
            scan_time=scan.time_increment_s * len(scan.ranges_m),
            range_min=scan.range_min_m,
            range_max=scan.range_max_m,
            ranges=np.ascontiguousarray(scan.ranges_m),
            intensities=np.zeros(0, np.float32),
        )

    def _mounts(self, link: m.TransformReceived, t: int) -> Iterable[tuple[str, bytes]]:
        """What is mounted on the base; the frames above it are ours, see _pose."""
        return [self._mount(link, t)] if link.parent == self._base_frame else []

    def _mount(self, link: m.TransformReceived, t: int) -> tuple[str, bytes]:
        move = self._xyz(link.x_m, link.y_m, link.z_m)
        turn = self._new("geometry_msgs/msg/Quaternion", link.qx, link.qy, link.qz, link.qw)
        said = self._new("geometry_msgs/msg/Transform", move, turn)
        header = self._header(t, "base_link")
        held = self._new("geometry_msgs/msg/TransformStamped", header, self._frame(link.child), said)
        return self._encode("/tf_static" if link.fixed else "/tf", transforms=[held])

    def _path(self, path: m.PathPlanned, t: int) -> tuple[str, bytes]:
        header = self._header(t, "map")
        poses: list[Any] = []
        if self._map is not None:
            xs = self._map.origin_x_m + (np.asarray(path.ix) + 0.5) * self._map.resolution_m
            ys = self._map.origin_y_m + (np.asarray(path.iy) + 0.5) * self._map.resolution_m
            for x, y in zip(xs.tolist(), ys.tolist(), strict=True):
                poses.append(self._new("geometry_msgs/msg/PoseStamped", header, self._at((x, y, 0.0))))
        return self._encode("/plan", header=header, poses=poses)

    def _grid(self, grid: m.MapReceived, t: int) -> tuple[str, bytes]:
        self._map = grid
        info = self._new(
            "nav_msgs/msg/MapMetaData",
            map_load_time=self._time(t),
            resolution=grid.resolution_m,
            width=grid.width,
            height=grid.height,
            origin=self._at((grid.origin_x_m, grid.origin_y_m, 0.0)),
        )
        return self._encode(
            "/map", header=self._header(t, "map"), info=info, data=np.asarray(grid.cells, np.int8)
        )

    def _alarm(self, alarm: m.AlarmRaised, t: int) -> tuple[str, bytes]:
        level = _ROS_LEVELS.get(alarm.level, 40)
        text = f"{alarm.code}: {alarm.text}"
        where = {"file": "", "function": "", "line": 0}
        return self._encode("/rosout", stamp=self._time(t), level=level, name=self._name, msg=text, **where)

    # ---- building blocks ----

    def _template(self, topic: str, message: Any, paths: tuple[str, ...]) -> Template:
        name = DERIVED[topic]
        return Template(self._store.fields(name), self._store.encode_standard(message, name), paths)

    def _new(self, kind: str, /, *values: Any, **fields: Any) -> Any:
        return self._store.standard(kind)(*values, **fields)

    def _encode(self, topic: str, /, **fields: Any) -> tuple[str, bytes]:
        name = DERIVED[topic]
        return topic, self._store.encode_standard(self._new(name, **fields), name)

    def _time(self, t: int) -> Any:
        return self._new("builtin_interfaces/msg/Time", t // 10**9, t % 10**9)

    def _header(self, t: int, frame: str) -> Any:
        return self._new("std_msgs/msg/Header", self._time(t), self._frame(frame))

    def _frame(self, name: str) -> str:
        return name if name == "map" else self._prefix + name

    def _xyz(self, x: float, y: float, z: float) -> Any:
        return self._new("geometry_msgs/msg/Vector3", x, y, z)

    def _turn(self, yaw: float) -> Any:
        return self._new("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))

    def _at(self, pose: Pose) -> Any:
        x, y, yaw = pose
        point = self._new("geometry_msgs/msg/Point", x, y, 0.0)
        return self._new("geometry_msgs/msg/Pose", point, self._turn(yaw))

    def _transform(self, t: int, parent: str, child: str, pose: Pose, z: float = 0.0) -> Any:
        x, y, yaw = pose
        move = self._new("geometry_msgs/msg/Transform", self._xyz(x, y, z), self._turn(yaw))
        named = self._header(t, parent), self._frame(child)
        return self._new("geometry_msgs/msg/TransformStamped", *named, move)


def _compose(a: Pose, b: Pose) -> Pose:
    c, s = math.cos(a[2]), math.sin(a[2])
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2]


def _inverse(a: Pose) -> Pose:
    c, s = math.cos(a[2]), math.sin(a[2])
    return -(c * a[0] + s * a[1]), s * a[0] - c * a[1], -a[2]


def _planar(pose: Pose) -> tuple[float, float, float, float]:
    """x, y, and z and w of the quaternion."""
    x, y, yaw = pose
    return x, y, math.sin(yaw / 2), math.cos(yaw / 2)
