"""One part of a log: an .mcap that ROS tools open as it is. Decides profile, channels, chunks and CRCs.

Knows encoded records, not what they mean. Format: https://mcap.dev/spec
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from hippomat_logs.mcap_writer import LEVEL, McapWriter
from hippomat_logs.schema import DERIVED, LATCHED, TOPICS, MessageStore, type_name
from hippomat_logs.sink import Sink

CHUNK_BYTES = 256 * 1024
RUN_METADATA = "hippomat.run"  # directly behind the header of every part, and once more behind a gap
GAP_METADATA = "hippomat.gap"
GAP_BYTES = 4096  # a bad block of a disk must not reach both
POLICY_ATTACHMENT = "policy.safetensors"  # behind the manifest, where the allocator has weights
END_METADATA = "hippomat.end"  # last of a part that was finished
RECOVERY_METADATA = "hippomat.recovery"  # of a recovered part: what it lost; last where its end was lost
FUSED_METADATA = "hippomat.fused"  # first of a file that holds several runs: "runs" names their prefixes
MERGED_METADATA = "hippomat.merged"  # first of one that holds several side by side: their files
SPAN_METADATA = "hippomat.span"  # of each run in it: its first and last own log time
CHANNELS_KEY = (
    "channels_crc32"  # of the manifest: which channels the part has, should its first chunk be lost
)

_QOS = """- history: 1
  depth: {depth}
  reliability: 1
  durability: {durability}
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: 1
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""


def package_version() -> str:
    try:
        return version("hippomat")
    except PackageNotFoundError:
        return "0"


def qos_of(topic: str) -> str:
    """Offered QoS profile as rosbag2 writes it; numeric enumerations, transient_local = 1."""
    latched = topic in LATCHED
    return _QOS.format(depth=1 if latched else 10, durability=1 if latched else 2)


@dataclass(frozen=True, slots=True)
class ChannelSpec:
    """A channel and its schema, as they stand in a file."""

    topic: str
    type_name: str
    definition: bytes
    metadata: tuple[tuple[str, str], ...]


def our_channels(store: MessageStore) -> list[ChannelSpec]:
    """Every topic that this version records."""
    names = {topic: type_name(kind) for kind, topic in TOPICS.items()} | DERIVED
    return [
        ChannelSpec(
            topic,
            name,
            store.schema_text(name),
            (("offered_qos_profiles", qos_of(topic)), ("topic_type_hash", store.type_hash(name))),
        )
        for topic, name in names.items()
    ]


def channels_crc32(channels: Sequence[ChannelSpec]) -> str:
    """Names a list of channels, order included."""
    return f"{zlib.crc32(repr([(c.topic, c.type_name, c.definition) for c in channels]).encode()):08x}"


def facts_crc32(facts: Mapping[str, str]) -> str:
    """Checksum of metadata, for which MCAP has none."""
    return f"{zlib.crc32(json.dumps(dict(facts), sort_keys=True).encode()):08x}"


class PartWriter:
    """An open part. After an OSError it must be abandoned: the writer then holds a stale chunk."""

    def __init__(
        self,
        sink: Sink,
        manifest: Mapping[str, str],
        channels: Sequence[ChannelSpec],
        attachments: Mapping[str, bytes],
        level: int = LEVEL,
        chunk_bytes: int = CHUNK_BYTES,
    ) -> None:
        self.sink = sink
        self._writer = McapWriter(sink, "ros2", f"hippomat {package_version()}", chunk_bytes, level)
        facts = {**manifest, CHANNELS_KEY: channels_crc32(channels)}
        self.add_facts(RUN_METADATA, facts)
        self.add_facts(GAP_METADATA, {"": " " * GAP_BYTES})
        self.add_facts(RUN_METADATA, facts)  # nothing can be read without it, so one copy may be damaged
        wall_ns = int(manifest.get("started_ns", "0")) + int(manifest.get("wall_offset_ns", "0"))
        for name, data in attachments.items():
            self._writer.add_attachment(wall_ns, name, "application/octet-stream", data)
        schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        for spec in channels:
            if spec.type_name not in schemas:
                schemas[spec.type_name] = self._writer.add_schema(spec.type_name, "ros2msg", spec.definition)
            schema = schemas[spec.type_name]
            self._channels[spec.topic] = self._writer.add_channel(
                spec.topic, "cdr", schema, dict(spec.metadata)
            )

    def add(self, topic: str, number: int, log_time_ns: int, data: bytes) -> None:
        """`number` goes into the sequence field; a derived message carries its source's number."""
        self.add_all(((topic, number, log_time_ns, data, False),))

    def add_all(self, records: Iterable[tuple[str, int, int, bytes, bool]]) -> None:
        """The same of many: (topic, number, log time, data, anything)."""
        channels = self._channels
        self._writer.add_messages(
            [
                (channels[topic], number & 0xFFFFFFFF, log_time_ns, log_time_ns, data)
                for topic, number, log_time_ns, data, _ in records
            ]
        )

    def flush(self) -> None:
        """Close the chunk and append it to the file, whole or not at all."""
        self._writer.flush()

    def finish(self, name: str, facts: Mapping[str, str]) -> None:
        """name: END_METADATA or RECOVERY_METADATA."""
        self.add_facts(name, facts)
        self._writer.finish()
        self.sink.finish()

    def add_facts(self, name: str, facts: Mapping[str, str]) -> None:
        """Metadata behind what was added so far."""
        self._writer.add_metadata(name, {**facts, "crc32": facts_crc32(facts)})
