"""Write an .mcap out of what sources hold: the whole file appears at once under its name, or not at all.

Decides channels and their numbers. Every ROS tool opens the result as it opens our logs (profile ros2, CDR).
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from rosbags.typesys import Stores, get_typestore

from hippomat_logs.mcap_file import RawRow
from hippomat_logs.mcap_writer import McapWriter
from hippomat_logs.outputs import refuse_existing
from hippomat_logs.part import CHUNK_BYTES, ChannelSpec, facts_crc32, package_version
from hippomat_logs.sink import FileSink
from hippomat_logs.sources import Source, Stream

PARTIAL = ".partial"
FLUSH_ROWS = 10_000


class LogWriter:
    """Topics as they come; one channel per topic and definition. Use writing()."""

    def __init__(self, sink: FileSink) -> None:
        self._writer = McapWriter(sink, "ros2", f"hippomat {package_version()}", CHUNK_BYTES)
        self._sink = sink
        self._schemas: dict[tuple[str, str], int] = {}
        self._channels: dict[tuple[str, str, str], int] = {}
        self._of: dict[tuple[int, int, str], int] = {}  # source, its channel, prefix -> our channel
        self.messages = 0

    def facts(self, name: str, facts: Mapping[str, str]) -> None:
        """Metadata, with the checksum that ours carry."""
        self._writer.add_metadata(name, {**facts, "crc32": facts_crc32(facts)})

    def attach(self, name: str, data: bytes) -> None:
        self._writer.add_attachment(0, name, "application/octet-stream", data)

    def write(self, source: Source, row: RawRow, prefix: str = "") -> None:
        key = id(source), row.channel, prefix
        channel = self._of.get(key)
        if channel is None:
            channel = self._of[key] = self._channel(source.streams[row.channel], prefix)
        self._writer.add_message(channel, row.sequence, row.log_time_ns, row.data)
        self.messages += 1
        if self.messages % FLUSH_ROWS == 0:
            self._writer.flush()

    def channel(self, spec: ChannelSpec, topic: str) -> int:
        """The number of a new channel of that kind under this topic."""
        key = spec.type_name, spec.definition.decode()
        if key not in self._schemas:
            self._schemas[key] = self._writer.add_schema(spec.type_name, "ros2msg", spec.definition)
        return self._writer.add_channel(topic, "cdr", self._schemas[key], dict(spec.metadata))

    def add(self, channel: int, sequence: int, log_time_ns: int, publish_ns: int, data: bytes) -> None:
        self._writer.add_messages(((channel, sequence & 0xFFFFFFFF, log_time_ns, publish_ns, data),))
        self.messages += 1
        if self.messages % FLUSH_ROWS == 0:
            self._writer.flush()

    def finish(self) -> None:
        self._writer.finish()
        self._sink.finish()

    def _channel(self, stream: Stream, prefix: str) -> int:
        text = message_text(stream)
        schema = self._schemas.get((stream.type_name, text))
        if schema is None:
            schema = self._writer.add_schema(stream.type_name, "ros2msg", text.encode())
            self._schemas[stream.type_name, text] = schema
        key = prefix + stream.topic, stream.type_name, text
        if key not in self._channels:
            metadata = {"offered_qos_profiles": "", **stream.metadata}
            self._channels[key] = self._writer.add_channel(key[0], "cdr", schema, metadata)
        return self._channels[key]


def message_text(stream: Stream) -> str:
    """The definition as ros2msg, whatever it came as."""
    if not stream.idl:
        return stream.definition
    store = get_typestore(Stores.EMPTY)
    store.register(stream.types)
    return store.generate_msgdef(stream.type_name, ros_version=2)[0]


@contextmanager
def writing(path: Path) -> Iterator[LogWriter]:
    """A writer to a file that must not exist yet; finish() makes it, any error leaves nothing behind."""
    with whole_file(path) as sink:
        yield LogWriter(sink)


@contextmanager
def whole_file(path: Path) -> Iterator[FileSink]:
    """A new file that appears once its sink is finished, or not at all; nothing is overwritten."""
    refuse_existing(path)
    # named after the process: two that write the same name must not write into one file
    sink = FileSink(path.parent, path.name, f".{os.getpid()}{PARTIAL}")
    try:
        yield sink
    finally:
        sink.discard()
