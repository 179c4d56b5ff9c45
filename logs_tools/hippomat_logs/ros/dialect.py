"""The messages we exchange with ROS, in every form they have on a wire: CDR, ROS 1's own, JSON.

Knows types and bytes, through rosbags; what a message means is in events.py. One class for all forms: the
message classes of ROS 2 (Time has sec and nanosec), so ROS 1's differences end here.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

MAP = "nav_msgs/msg/OccupancyGrid"
TF = "tf2_msgs/msg/TFMessage"
SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
TYPES = (MAP, TF, SCAN, ODOMETRY)

ROS1, ROS2 = 1, 2
_CDR_HEAD = b"\x00\x01\x00"  # little-endian CDR; the fourth byte is free


class Undecodable(ValueError):
    """Bytes or JSON that are no message of the wanted type."""


def short_name(kind: str) -> str:
    """nav_msgs/OccupancyGrid: the name that rosbridge takes for ROS 1 and ROS 2."""
    package, _, name = kind.split("/")
    return f"{package}/{name}"


class Dialect:
    """Encoder and decoder; slow to build (it reads every message definition), so build one and keep it."""

    def __init__(self) -> None:
        self._stores = {ROS1: get_typestore(Stores.ROS1_NOETIC), ROS2: get_typestore(Stores.ROS2_HUMBLE)}
        transforms = get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", TF)
        self._stores[ROS1].register(transforms)  # rosbags has it for ROS 2 alone
        self.speaks = 0  # ROS1 or ROS2 once a message in bytes has shown it

    def new(self, kind: str, **fields: Any) -> Any:
        """A message of ROS 2."""
        return self._stores[ROS2].types[kind](**fields)

    # ---- bytes ----

    def decode(self, kind: str, data: bytes) -> Any:
        """A message from bytes of which nobody says whether ROS 1 or ROS 2 made them (cbor-raw)."""
        cdr = data[:3] == _CDR_HEAD
        order = [self.speaks] if self.speaks else []
        for ros in dict.fromkeys([*order, *((ROS2, ROS1) if cdr else (ROS1,))]):
            try:
                message = self.decode_as(ros, kind, data)
            except Undecodable:
                continue
            self.speaks = ros
            return message
        raise Undecodable(f"{len(data)} bytes are no {short_name(kind)}")

    def decode_as(self, ros: int, kind: str, data: bytes) -> Any:
        store = self._stores[ros]
        try:
            if ros == ROS2:
                return store.deserialize_cdr(data, kind)
            return store.deserialize_ros1(data, kind)
        except Exception as error:  # generated code meets garbage with whatever fails first
            raise Undecodable(f"{len(data)} bytes are no {short_name(kind)}: {error}") from None

    def encode_as(self, ros: int, kind: str, message: Any) -> bytes:
        store = self._stores[ros]
        if ros == ROS2:
            return bytes(store.serialize_cdr(message, kind))
        return bytes(store.serialize_ros1(self._in_ros1(kind, message), kind))

    def _in_ros1(self, kind: str, message: Any) -> Any:
        """The same message with ROS 1's classes: a Header has a sequence number there."""
        fields = self._stores[ROS1].fielddefs[kind][1]
        values = {}
        for name, (node, argument) in fields:
            value = getattr(message, name, 0)
            if node == Nodetype.NAME:
                value = self._in_ros1(str(argument), value)
            elif isinstance(value, list) and argument[0][0] == Nodetype.NAME:
                value = [self._in_ros1(str(argument[0][1]), item) for item in value]
            values[name] = value
        return self._stores[ROS1].types[kind](**values)


# ---- JSON, as rosbridge writes it ----


def to_json(message: Any, ros: int = ROS2) -> Any:
    """Numbers and lists; what is no number becomes null; ROS 1 calls the parts of a time secs and nsecs."""
    if dataclasses.is_dataclass(message) and not isinstance(message, type):
        names = {f.name: f.name for f in dataclasses.fields(message) if not f.name.startswith("__")}
        if ros == ROS1:
            names |= {name: was for name, was in (("sec", "secs"), ("nanosec", "nsecs")) if name in names}
        return {shown: to_json(getattr(message, name), ros) for name, shown in names.items()}
    if isinstance(message, np.ndarray):
        return [to_json(value, ros) for value in message.tolist()]
    if isinstance(message, list):
        return [to_json(item, ros) for item in message]
    if isinstance(message, float) and not math.isfinite(message):
        return None
    return message


def from_json(value: Any) -> Any:
    """Something with the message's attributes; its arrays are lists, with None for what was no number."""
    if isinstance(value, Mapping):
        fields = {str(name): from_json(inner) for name, inner in value.items()}
        for name, was in (("sec", "secs"), ("nanosec", "nsecs")):
            if was in fields:
                fields[name] = fields.pop(was)
        return SimpleNamespace(**fields)
    if isinstance(value, list) and value and isinstance(value[0], Mapping):
        return [from_json(item) for item in value]
    return value


def message_in(operation: Mapping[str, Any], kind: str, dialect: Dialect) -> Any:
    """The ROS message of a `publish`, in whatever form it came; raises Undecodable."""
    held = operation.get("msg")
    if not isinstance(held, Mapping):
        raise Undecodable(f"no message in {operation.get('op')!r}")
    raw = held.get("bytes")
    return dialect.decode(kind, raw) if isinstance(raw, bytes) else from_json(held)
