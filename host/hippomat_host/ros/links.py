"""ROS as links of the daemon: the feed (map, transforms, scans, odometry) and the base behind /cmd_vel.

Both are child processes with a connection of their own (feed.py, base_guard.py).
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterator
from multiprocessing.connection import Connection
from typing import Any

from hippomat_core.config import RosConfig
from hippomat_core.errors import PortError
from hippomat_core.messages import BASE, ROS, Event
from hippomat_host.child_link import ChildLink
from hippomat_host.guard_link import stopped_text
from hippomat_host.happenings import EVENT, NOTE, OPENED, Happening
from hippomat_host.links import NEVER_NS

EVENTS_AT_ONCE = 64


class FeedLink(ChildLink):
    """What ROS says, as events."""

    def __init__(self, ros: RosConfig) -> None:
        super().__init__(ROS, ros.url, "ROS feed", ["hippomat_host.ros.feed", _settings(ros)])
        self._events: Connection | None = None

    def take(self, timeout_s: float) -> Event | None:
        """The next event, for a reactor that asks by itself; None if none came in time."""
        if self._events is None or not self._events.poll(timeout_s):
            return None
        event: Event = self._events.recv()
        return event

    def _read(self, now_ns: int) -> Iterator[Happening]:
        for _ in range(EVENTS_AT_ONCE):
            try:
                event = self.take(0.0)
            except EOFError:  # its last report says why
                return
            if event is None:
                return
            yield Happening(now_ns, EVENT, ROS, event=event)

    def _reported(self, report: dict[str, Any], now_ns: int) -> Iterator[Happening]:
        if "connected" in report and self._data is not None:
            self._events = Connection(os.dup(self._data.fileno()))
            self._has_opened(NEVER_NS)  # silence is the core's to judge: it knows what has to come
            yield Happening(now_ns, OPENED, ROS, text="rosbridge")
        else:
            yield from _remark(report, now_ns, ROS)

    def _end_child(self, kill: bool = False) -> None:
        events, self._events = self._events, None
        if events is not None:
            events.close()
        super()._end_child(kill)


class RosBaseLink(ChildLink):
    """A base that ROS drives. It says nothing here: where it is comes through the feed."""

    def __init__(self, ros: RosConfig) -> None:
        super().__init__(BASE, ros.url, "motor guard", ["hippomat_host.ros.base_guard", _settings(ros)])
        self._topic = ros.cmd_vel_topic

    def _read(self, now_ns: int) -> Iterator[Happening]:  # noqa: ARG002
        return iter(())

    def _reported(self, report: dict[str, Any], now_ns: int) -> Iterator[Happening]:
        if "connected" in report:
            self._has_opened(NEVER_NS)
            yield Happening(now_ns, OPENED, BASE, text=f"rosbridge {self._topic}")
        elif "silent_ns" in report:
            yield Happening(now_ns, NOTE, BASE, text=stopped_text(report["silent_ns"]))
        else:
            yield from _remark(report, now_ns, BASE)


def _remark(report: dict[str, Any], now_ns: int, port: int) -> Iterator[Happening]:
    if "remark" not in report:
        raise PortError(str(report.get("failed", report)))
    yield Happening(now_ns, NOTE, port, text=report["remark"])


def _settings(ros: RosConfig) -> str:
    return json.dumps(dataclasses.asdict(ros))
