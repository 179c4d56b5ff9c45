"""Read the bytes of one finished .mcap of ours, believing nothing of it.

Decides what a file must hold to be a whole log. Written for our own files only: checksums of data section,
chunks, summary and manifest. What can be had of a damaged file is in lenient_walk.py.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from itertools import islice

from hippomat_core.errors import LogError
from hippomat_logs.mcap_writer import CHUNK, DATA_END, FOOTER, HEADER, MAGIC, METADATA, STATISTICS
from hippomat_logs.part import FUSED_METADATA, RUN_METADATA
from hippomat_logs.walk import (
    FOOTER_BYTES,
    PREFIX,
    SLICE_BYTES,
    Contents,
    Inside,
    RawMessage,
    forget,
    metadata_of,
    record,
    records,
    with_offsets,
)

DATA_END_BYTES = 9 + 4
BATCH = 4096  # messages at once in memory: a chunk of a foreign or hostile file may hold millions


def walk_strictly(
    data: memoryview, name: str, contents: Contents, inside: Inside | None = None
) -> Iterator[list[RawMessage]]:
    """Every message of a finished file in file order, in batches; raises LogError on anything unexpected.

    inside: messages_inside, or counted_inside where only `contents` is wanted.
    """
    end, promised = check_frame(data, name)
    first = [opcode for (opcode, _, _), _ in zip(records(data, len(MAGIC), end), range(2), strict=False)]
    if first != [HEADER, METADATA]:
        raise LogError(f"{name}: has no run manifest behind its header, as every log of ours does")
    for at, opcode, body, behind in with_offsets(data, len(MAGIC), end):
        found = record(opcode, body, at, contents, inside)
        if opcode == CHUNK:  # one record in twenty
            yield from batches(found)
        contents.complete_bytes = behind
    if not contents.manifest:
        raise LogError(f"{name}: holds no {RUN_METADATA} metadata, as every log of ours does")
    if contents.messages != promised:
        raise LogError(f"{name}: {contents.messages} messages read, but its summary promises {promised}")


def batches(messages: Iterable[RawMessage]) -> Iterator[list[RawMessage]]:
    """A few thousand at a time; what stands before a damaged one is given out before that is told."""
    source = iter(messages)
    while True:
        batch: list[RawMessage] = []
        try:
            batch.extend(islice(source, BATCH))
        except LogError:
            yield batch  # extend() has kept what came before
            raise
        if not batch:
            return
        yield batch


def check_frame(data: memoryview, name: str) -> tuple[int, int]:
    """Verify magic, footer, summary and data-section checksums; (end of data section, messages promised)."""

    def damaged(what: str) -> LogError:
        return LogError(f"{name}: {what}; `hippomat-logs recover {name}` saves what can be read")

    if data[: len(MAGIC)] != MAGIC:
        raise LogError(f"{name}: does not begin with MCAP's magic bytes: not a log, or its head is damaged")
    footer = len(data) - len(MAGIC) - FOOTER_BYTES
    if footer < len(MAGIC) or data[-len(MAGIC) :] != MAGIC:
        raise damaged("does not end with MCAP's magic bytes: cut short or damaged")
    opcode, length = PREFIX.unpack_from(data, footer)
    summary, offsets, summary_crc = struct.unpack_from("<QQI", data, footer + 9)
    if (opcode, length) != (FOOTER, 20) or not len(MAGIC) + DATA_END_BYTES <= summary <= offsets <= footer:
        raise damaged("footer damaged")
    end = summary - DATA_END_BYTES
    if not summary_crc or not struct.unpack_from("<I", data, end + 9)[0]:
        raise damaged("carries no checksums, as every log of ours does")
    if zlib.crc32(data[summary : footer + 9 + 16]) != summary_crc:
        raise damaged("summary or footer checksum wrong")
    if PREFIX.unpack_from(data, end) != (DATA_END, 4):
        raise damaged("end of the data section damaged")
    if crc32_of(data, end) != struct.unpack_from("<I", data, end + 9)[0]:
        raise damaged("data-section checksum wrong: at least one bit has changed")
    return end, _messages_promised(data, summary, offsets, damaged("summary holds no statistics"))


def _messages_promised(data: memoryview, start: int, end: int, missing: LogError) -> int:
    for opcode, body, _ in records(data, start, end):
        if opcode == STATISTICS and len(body) >= 8:
            return int(struct.unpack_from("<Q", body)[0])
    raise missing


def crc32_of(data: memoryview, end: int) -> int:
    """Checksum of data[:end] without holding it in memory."""
    crc = 0
    for at in range(0, end, SLICE_BYTES):
        behind = min(at + SLICE_BYTES, end)
        crc = zlib.crc32(data[at:behind], crc)
        forget(data, at, behind)
    return crc


def fused_runs(data: memoryview) -> tuple[str, ...]:
    """Prefixes of the runs in a fused file, by its first metadata; of any other file, whole or not: none."""
    try:
        first = [
            (o, body) for (o, body, _), _ in zip(records(data, len(MAGIC), len(data)), range(2), strict=False)
        ]
        if [opcode for opcode, _ in first] != [HEADER, METADATA]:
            return ()
        name, facts = metadata_of(first[1][1], 0)
    except LogError:
        return ()
    return tuple(facts.get("runs", "").split()) if name == FUSED_METADATA else ()
