"""Map sources by name: a map's YAML file, a recording of ROS 1 or ROS 2 or of ours, a rosbridge.

    lab.yaml   run.mcap   lab.bag:/map   lab.bag:/map@12.5   rosbag2_folder   ws://HOST:9090

`:/topic` where a recording holds several maps, `@SECONDS` for the one that held so long after the first (the
last one otherwise). Knows files; the rules of each are where its messages are decoded.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from hippomat_core.errors import HippomatError, MapError
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.maps.source import MapSource, map_at
from hippomat_logs.map_files import load_map
from hippomat_logs.ros.client import Rosbridge
from hippomat_logs.ros.dialect import MAP, ROS2, Dialect, Undecodable, message_in, short_name
from hippomat_logs.ros.events import grid_of
from hippomat_logs.ros.rosbridge import subscribe

RECORDINGS = (".bag", ".db3", ".mcap")
SPEC = re.compile(r"(?P<path>.+?)(?::(?P<topic>/(?!/)[^@]*))?(?:@(?P<after_s>[0-9]+(?:\.[0-9]*)?))?")
USUAL = "/map"
LIVE_S = 3.0


def map_from(name: str) -> OccupancyGrid:
    """The map that the name says. Raises MapError, or PortError for a rosbridge, in one line."""
    found = SPEC.fullmatch(name)
    if Path(name).exists() or found is None:
        return map_at(map_source(name))
    after_s = found["after_s"]
    return map_at(map_source(found["path"], found["topic"] or ""), float(after_s) if after_s else None)


def map_source(path: str, topic: str = "") -> MapSource:
    """The source behind a path or an address; topic "": /map, or the only one."""
    if path.startswith(("ws://", "wss://")):
        return RosbridgeMaps(path, topic or USUAL)
    if Path(path).is_dir() or Path(path).suffix in RECORDINGS:
        return RecordedMaps(Path(path), topic)
    return FileMap(path)


class FileMap:
    """One map: a YAML file and its image."""

    def __init__(self, path: str) -> None:
        self.name = f"map {path}"
        self._path = path

    def maps(self) -> Iterator[tuple[int, OccupancyGrid]]:
        yield 0, load_map(self._path)


class RecordedMaps:
    """The nav_msgs/OccupancyGrid messages of one topic of a recording, by the time they were recorded at."""

    def __init__(self, path: Path, topic: str = "") -> None:
        self.name = f"map {path}{':' if topic else ''}{topic}"
        self._path, self._topic = path, topic

    def maps(self) -> Iterator[tuple[int, OccupancyGrid]]:
        for at_ns, message in self._messages():
            yield at_ns, grid_of(message, self.name)

    def _messages(self) -> Iterator[tuple[int, Any]]:
        if not self._path.exists():
            raise MapError(f"{self.name}: there is no such file")
        reader = self._of_mcap if self._path.suffix == ".mcap" else self._of_bag
        try:
            yield from reader()
        except HippomatError:
            raise
        except Exception as error:  # whatever a reader of files makes of damage
            text = " ".join(str(error).split())[:150] or type(error).__name__
            raise MapError(f"{self.name}: cannot be read: {text}") from None

    def _of_mcap(self) -> Iterator[tuple[int, Any]]:
        """Through mcap itself: rosbags refuses a whole file for one channel that it cannot parse."""
        with self._path.open("rb") as file:
            summary = make_reader(file, validate_crcs=True).get_summary()
            if summary is None:
                raise MapError(f"{self.name}: has no summary; `hippomat-logs recover {self._path}` saves it")
            held = [c.topic for c in summary.channels.values() if summary.schemas[c.schema_id].name == MAP]
            topic = self._chosen(held)
            file.seek(0)
            dialect = Dialect()
            for _, _, message in make_reader(file, validate_crcs=True).iter_messages(topics=[topic]):
                yield message.log_time, dialect.decode_as(ROS2, MAP, message.data)

    def _of_bag(self) -> Iterator[tuple[int, Any]]:
        with AnyReader([self._path]) as reader:
            connections = [c for c in reader.connections if c.msgtype == MAP]
            topic = self._chosen(sorted({c.topic for c in connections}))
            wanted = [c for c in connections if c.topic == topic]
            for connection, at_ns, data in reader.messages(connections=wanted):
                yield at_ns, reader.deserialize(data, connection.msgtype)

    def _chosen(self, topics: list[str]) -> str:
        if self._topic in topics:
            return self._topic
        if not self._topic and USUAL in topics:
            return USUAL
        if not self._topic and len(topics) == 1:
            return topics[0]
        held = f"maps are on {', '.join(topics)}: give {self._path}:TOPIC" if topics else "it holds no map"
        raise MapError(f"{self.name}: {held}")


class RosbridgeMaps:
    """The maps that a running ROS publishes, until none came for LIVE_S; stamped by our monotonic clock."""

    def __init__(self, url: str, topic: str = USUAL, wait_s: float = LIVE_S) -> None:
        self.name = f"{url} {topic}"
        self._url, self._topic, self._wait_s = url, topic, wait_s

    def maps(self) -> Iterator[tuple[int, OccupancyGrid]]:
        dialect = Dialect()
        with Rosbridge(self._url) as bridge:
            bridge.say(subscribe(self._topic, short_name(MAP), "cbor-raw"))
            until_s = time.monotonic() + self._wait_s
            while (left_s := until_s - time.monotonic()) > 0:
                said = bridge.hear(left_s)
                if said is None or said["op"] != "publish":
                    continue
                try:
                    grid = grid_of(message_in(said, MAP, dialect), self.name)
                except (Undecodable, AttributeError, TypeError) as error:
                    raise MapError(f"{self.name}: {error}") from None
                yield time.monotonic_ns(), grid
                until_s = time.monotonic() + self._wait_s
