"""What the mcap package's writer takes for the same messages, given their bytes: the recorder's named peer.

It is called in the same loop at the same times. The recorder makes the bytes, too, draws views, takes
checksums and syncs. What it costs is told as a multiple of this as well: a share of a core says little where
nobody knows how fast the core is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from hippomat_logs.part import CHUNK_BYTES
from hippomat_logs.records import SerialRecord, TimingRecord
from hippomat_logs.schema import MessageStore
from hippomat_sim.bench.logs_stream import SERIAL, TIMING, Call, Step


def calls_of_peer(path: Path, steps: Iterable[Step]) -> Iterator[Call]:
    """Its call for every step; the file is left unfinished."""
    encoders = MessageStore().encoders()
    writer = Writer(str(path), chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
    writer.start()
    channels: dict[str, int] = {}
    for at_ns, what, content in steps:
        topic, encode = encoders[type(record := _record(at_ns, what, content))]
        if topic not in channels:
            channels[topic] = writer.register_channel(topic, "cdr", 0)
        yield at_ns, writer.add_message, (channels[topic], at_ns, encode(record), at_ns)


def _record(at_ns: int, what: str, content: Any) -> Any:
    if what == SERIAL:
        port, direction, data = content
        return SerialRecord(at_ns, port, direction, 1, 0, data)
    return TimingRecord(at_ns, content, 0) if what == TIMING else content
