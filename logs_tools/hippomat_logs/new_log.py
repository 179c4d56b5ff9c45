"""A log of ours made out of another: chosen records, numbered anew, in one small file that replays.

Decides that such a log has only the channels it uses. Knows encoded records, not why they were chosen.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from hippomat_logs.log_writer import whole_file
from hippomat_logs.part import CHANNELS_KEY, END_METADATA, PartWriter, our_channels
from hippomat_logs.schema import MessageStore

LEVEL = 19  # of zstd: such files are kept for years, and written once
CHUNK_BYTES = 4 << 20  # no crash can cut a file that appears whole; more at once compresses better
FLUSH_RECORDS = 20_000


class NewRecord(NamedTuple):
    """One record to be written."""

    log_time_ns: int
    topic: str
    data: bytes


def write_log(
    path: Path,
    manifest: Mapping[str, str],
    attachments: Mapping[str, bytes],
    records: Iterable[NewRecord],
    store: MessageStore,
) -> int:
    """How many records were written. The file appears whole or not at all; nothing is overwritten."""
    with whole_file(path) as sink:
        held = list(records)
        used = {record.topic for record in held}
        channels = [channel for channel in our_channels(store) if channel.topic in used]
        facts = {**manifest, "part": "0", "first_record": "1"}
        for gone in (CHANNELS_KEY, "recovered"):
            facts.pop(gone, None)
        part = PartWriter(sink, facts, channels, attachments, LEVEL, CHUNK_BYTES)
        for number, record in enumerate(held, 1):
            part.add(record.topic, number, record.log_time_ns, record.data)
            if number % FLUSH_RECORDS == 0:
                part.flush()
        part.finish(END_METADATA, {"last_record": str(len(held)), "final": "yes"})
    return len(held)
