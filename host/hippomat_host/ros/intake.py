"""Which of ROS's messages become events of this robot, and what to say of those that do not.

Pure: operations of rosbridge in, events out. Of /tf only what lies between the map, the base and the lidar is
kept: an arm's joints would fill the log. Stamps are set by the daemon.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from hippomat_core.config import RosConfig
from hippomat_core.errors import MapError
from hippomat_core.messages import Event, LaserScanReceived, TransformReceived
from hippomat_logs.ros.dialect import Dialect, Undecodable, message_in
from hippomat_logs.ros.events import events_of
from hippomat_logs.ros.topics import Topic, topics_of


class Intake:
    """Operations in, events out; remarks for the user collect in `remarks`."""

    def __init__(self, ros: RosConfig) -> None:
        self._ros = ros
        self._topics = {topic.name: topic for topic in topics_of(ros)}
        self._dialect = Dialect()
        self._frames = {ros.base_frame}  # that are of interest, as children
        self._waiting: dict[str, TransformReceived] = {}  # fixed transforms of other children
        self._said: set[str] = set()
        self.remarks: list[str] = []
        self.silent = set(self._topics)  # topics of which nothing came yet

    @property
    def topics(self) -> list[Topic]:
        return list(self._topics.values())

    def events(self, operation: Mapping[str, Any]) -> Iterator[Event]:
        if operation["op"] == "status":
            self._remark_on_status(operation)
        topic = self._topics.get(str(operation.get("topic"))) if operation["op"] == "publish" else None
        if topic is None:
            return
        self.silent.discard(topic.name)
        try:
            message = message_in(operation, topic.kind, self._dialect)
            for event in list(events_of(topic.kind, message, topic.name == self._ros.tf_static_topic)):
                yield from self._of_interest(event)
        except Undecodable as error:
            self._remark(topic.name, f"{topic.name}: {error}: is it of that type?")
        except MapError as error:
            self._remark(str(error), str(error))

    def _of_interest(self, event: Event) -> Iterator[Event]:
        if isinstance(event, TransformReceived):
            if event.fixed:
                self._waiting[event.child] = event
            if event.child in self._frames:
                self._waiting.pop(event.child, None)
                yield event
                yield from self._wanted(event.parent)
            return
        yield event
        if isinstance(event, LaserScanReceived):
            yield from self._wanted(event.frame)  # behind it: a replay says it again in this order

    def _wanted(self, frame: str) -> Iterator[Event]:
        """From now on this frame's transform is of interest, and so are those above it."""
        self._frames.add(frame)
        while frame in self._waiting:
            held = self._waiting.pop(frame)
            yield held
            frame = held.parent
            self._frames.add(frame)

    def _remark_on_status(self, said: Mapping[str, Any]) -> None:
        if said.get("level") in ("error", "warning"):
            text = " ".join(str(said.get("msg")).split())[:200]
            self._remark(text, f"rosbridge says: {text}")

    def _remark(self, key: str, text: str) -> None:
        """Once."""
        if key not in self._said and len(self._said) < 100:
            self._said.add(key)
            self.remarks.append(text)
