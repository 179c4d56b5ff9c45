"""Where messages come from: an .mcap of anybody's, a ROS 1 .bag, a ROS 2 bag. All give CDR bytes by channel.

Decides what a channel is and which ones are left out, by name and reason; one channel that cannot be read
costs nothing else. Knows files and formats, not columns.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Protocol

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import MessageDefinitionFormat
from rosbags.interfaces.typing import Typesdict
from rosbags.typesys import get_types_from_idl, get_types_from_msg

from hippomat_core.errors import LogError
from hippomat_logs.cdr_layout import Field, fields_of_type
from hippomat_logs.file_kinds import Kind, refuse_no_log
from hippomat_logs.mcap_file import Channel, McapFile, RawRow, open_mcap
from hippomat_logs.part import FUSED_METADATA, SPAN_METADATA

FOREVER = 1 << 63
_SERVICE = "its definition is a service's (---), which is no message"


@dataclass
class Stream:
    """One channel: a topic, the definition of its messages, and how many there are (None: not known)."""

    topic: str
    type_name: str
    definition: str  # ros2msg
    count: int | None
    metadata: dict[str, str] = field(default_factory=dict)  # of the MCAP channel: offered_qos_profiles ...
    idl: bool = False  # the definition is OMG IDL

    @cached_property
    def types(self) -> Typesdict:
        """Everything the definition defines; LogError naming the channel where it cannot be parsed."""
        try:
            return _parsed(self.definition, self.type_name, self.idl)
        except Exception as error:  # rosbags' parser has no error of its own
            why = " ".join(str(error).split())[:80]
            raise LogError(f"channel {self.topic}: its definition cannot be parsed: {why}") from None

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        try:
            return fields_of_type(self.types, self.type_name)
        except LogError as error:
            raise LogError(f"channel {self.topic}: {error}") from None
        except KeyError as error:
            raise LogError(f"channel {self.topic}: its definition lacks {error}") from None


@cache
def _parsed(definition: str, type_name: str, idl: bool) -> Typesdict:
    """A hundred files of one kind are parsed once."""
    return get_types_from_idl(definition) if idl else get_types_from_msg(definition, type_name)


class Source(Protocol):
    """One file, or a ROS 2 bag's directory."""

    path: Path
    streams: dict[int, Stream]
    left_out: dict[str, str]  # topic -> why
    inside: str  # which run of a fused file this is; empty: all of the file

    @property
    def span_ns(self) -> tuple[int, int]: ...

    def rows(
        self, streams: Collection[int] | None = None, start_ns: int = 0, end_ns: int = FOREVER
    ) -> Iterator[RawRow]:
        """Messages as CDR, start_ns <= log time < end_ns."""
        ...


class McapSource:
    """An .mcap file."""

    inside = ""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.file: McapFile = open_mcap(path)
        self.streams: dict[int, Stream] = {}
        self.left_out: dict[str, str] = {}
        for number, channel in self.file.channels.items():
            why = _unreadable(channel)
            if why:
                self.left_out[channel.topic] = why
                continue
            counts = self.file.counts
            count = None if counts is None else counts.get(number, 0)
            text, idl = channel.schema.decode(errors="replace"), channel.schema_encoding == "ros2idl"
            self.streams[number] = Stream(
                channel.topic, channel.type_name, text, count, channel.metadata, idl
            )

    @property
    def span_ns(self) -> tuple[int, int]:
        return self.file.start_ns, self.file.end_ns

    def rows(
        self, streams: Collection[int] | None = None, start_ns: int = 0, end_ns: int = FOREVER
    ) -> Iterator[RawRow]:
        return self.file.rows(self.streams if streams is None else streams, start_ns, end_ns)


class FusedSource(McapSource):
    """One run in a fused file, as its own log was: without the prefix of its topics, at its own log times."""

    def __init__(self, path: Path, inside: str) -> None:
        super().__init__(path)
        self.inside = inside
        mine = {
            number: stream for number, stream in self.streams.items() if stream.topic.startswith(f"{inside}/")
        }
        self.streams = {
            number: replace(stream, topic=stream.topic[len(inside) :]) for number, stream in mine.items()
        }
        facts = self.file.metadata
        self.file.metadata = {
            name.removesuffix(inside): facts[name] for name in facts if name.endswith(inside)
        }
        folder = inside.strip("/") + "/"
        self.file.attachments = {
            name.removeprefix(folder): place
            for name, place in self.file.attachments.items()
            if name.startswith(folder)
        }

    @property
    def span_ns(self) -> tuple[int, int]:
        facts = self.file.metadata.get(SPAN_METADATA, {})
        return int(facts.get("first_ns", "0")), int(facts.get("last_ns", "0"))

    def rows(
        self, streams: Collection[int] | None = None, start_ns: int = 0, end_ns: int = FOREVER
    ) -> Iterator[RawRow]:
        for row in super().rows(streams):
            if start_ns <= row.own_ns < end_ns:
                yield row._replace(log_time_ns=row.own_ns)


def opened_sources(path: Path) -> list[Source]:
    """The file at `path`, or each of the runs that were fused in it."""
    source = open_source(path)
    if not isinstance(source, McapSource) or FUSED_METADATA not in source.file.metadata:
        return [source]
    prefixes = source.file.metadata[FUSED_METADATA].get("runs", "").split()
    return [FusedSource(path, inside) for inside in prefixes]


def _unreadable(channel: Channel) -> str:
    if channel.encoding != "cdr":
        return f"message encoding {channel.encoding!r} is not read, only cdr"
    if channel.schema_encoding not in ("ros2msg", "ros2idl"):
        return f"schema encoding {channel.schema_encoding!r} is not read, only ros2msg and ros2idl"
    return _SERVICE if b"\n---\n" in channel.schema else ""


class RosbagSource:
    """A ROS 1 .bag, or a ROS 2 bag (directory or .db3), through rosbags.

    ROS 1 messages become CDR of the bag's own definitions, so nothing is lost: a Header keeps its seq.
    """

    inside = ""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.left_out: dict[str, str] = {}
        with self._opened() as reader:
            self.streams = {
                number: self._stream(reader, connection)
                for number, connection in enumerate(reader.connections)
            }
            self._span_ns = (reader.start_time, reader.end_time) if reader.message_count else (0, 0)

    @property
    def span_ns(self) -> tuple[int, int]:
        return self._span_ns

    def rows(
        self, streams: Collection[int] | None = None, start_ns: int = 0, end_ns: int = FOREVER
    ) -> Iterator[RawRow]:
        with self._opened() as reader:
            numbers = {id(connection): number for number, connection in enumerate(reader.connections)}
            wanted = [reader.connections[number] for number in (self.streams if streams is None else streams)]
            if not wanted:
                return
            types = reader.typestore
            begin, end = start_ns or None, None if end_ns == FOREVER else end_ns
            for connection, time_ns, raw in reader.messages(wanted, start=begin, stop=end):
                name = connection.msgtype
                if not reader.is2:  # not ros1_to_cdr(), which takes the seq out of every Header
                    raw = bytes(types.serialize_cdr(types.deserialize_ros1(raw, name), name))
                yield RawRow(numbers[id(connection)], 0, time_ns, bytes(raw))

    def _stream(self, reader: AnyReader, connection: Any) -> Stream:
        idl = connection.msgdef.format == MessageDefinitionFormat.IDL
        text = connection.msgdef.data
        if not reader.is2 or not text:
            text, _ = reader.typestore.generate_msgdef(connection.msgtype, ros_version=2)
        return Stream(connection.topic, connection.msgtype, text, connection.msgcount, {}, idl)

    @contextmanager
    def _opened(self) -> Iterator[AnyReader]:
        try:
            with AnyReader([self.path]) as reader:
                yield reader
        except AnyReaderError as error:
            why = " ".join(str(error).split())
            raise LogError(f"{self.path}: {why}") from None


def open_source(path: Path) -> Source:
    """Whatever `path` is; one line says what is wrong with it."""
    kind = refuse_no_log(path)
    if kind is Kind.EMPTY:
        raise LogError(f"{path}: is empty; nothing was recorded in it")
    return RosbagSource(path) if kind in (Kind.BAG, Kind.DB3, Kind.ROS2_BAG) else McapSource(path)


def merged(sources: Collection[Source]) -> Iterator[tuple[Source, RawRow]]:
    """All messages of all sources by log time; equal times in the order of sources and files."""

    def named(source: Source) -> Iterator[tuple[Source, RawRow]]:
        for row in source.rows():
            yield source, row

    yield from heapq.merge(*map(named, sources), key=lambda pair: pair[1].log_time_ns)
