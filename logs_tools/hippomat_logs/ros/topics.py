"""Which topics of ROS the roles that it has for a robot need, and which event comes over which of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hippomat_core.config import RosConfig
from hippomat_core.messages import LaserScanReceived, MapReceived, OdometryReceived, TransformReceived
from hippomat_logs.ros.dialect import MAP, ODOMETRY, SCAN, TF, short_name
from hippomat_logs.ros.rosbridge import subscribe

FROM_ROS = (TransformReceived, LaserScanReceived, OdometryReceived)


@dataclass(frozen=True, slots=True)
class Topic:
    """One subscription."""

    name: str
    kind: str
    latched: bool = False  # said once, to be had for ever
    throttle_ms: int = 0
    queue: int = 0

    def request(self, encoding: str) -> dict[str, Any]:
        return subscribe(self.name, short_name(self.kind), encoding, self.throttle_ms, self.queue)


def topics_of(ros: RosConfig) -> list[Topic]:
    """/tf is not throttled: rosbridge throttles a topic, and each publisher says something else on it."""
    wanted: list[Topic] = []
    if ros.map:
        wanted.append(Topic(ros.map_topic, MAP, latched=True))
    if ros.pose or ros.lidar:
        wanted += [Topic(ros.tf_static_topic, TF, latched=True), Topic(ros.tf_topic, TF)]
    if ros.lidar:
        wanted.append(Topic(ros.scan_topic, SCAN, queue=1))
    if ros.pose and ros.odom_topic:
        wanted.append(Topic(ros.odom_topic, ODOMETRY, throttle_ms=40, queue=1))
    return [topic for topic in wanted if topic.name]


def is_of_ros(message: Any, ros: RosConfig) -> bool:
    """An event that came in through ROS."""
    return isinstance(message, FROM_ROS) or (isinstance(message, MapReceived) and ros.maps)


def topic_of(event: Any, ros: RosConfig) -> str:
    """The topic that an event of ROS came over."""
    if isinstance(event, TransformReceived):
        return ros.tf_static_topic if event.fixed else ros.tf_topic
    names = {
        MapReceived: ros.map_topic,
        LaserScanReceived: ros.scan_topic,
        OdometryReceived: ros.odom_topic,
    }
    return names[type(event)]
