"""What can be had of a damaged or unfinished .mcap of ours: every whole chunk, wherever the damage is.

Decides where a walk goes on behind damage. Never gives out what a checksum contradicts; what no checksum
covers (the head of a chunk that was cut) is counted.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator

import zstandard

from hippomat_core.errors import LogError
from hippomat_logs.mcap_writer import ATTACHMENT, CHUNK, DATA_END, HEADER, MAGIC, MESSAGE_INDEX, METADATA
from hippomat_logs.part import END_METADATA, RUN_METADATA
from hippomat_logs.walk import (
    MAX_CHUNK_BYTES,
    PREFIX,
    Contents,
    RawMessage,
    chunk_head,
    inflated,
    messages_inside,
    record,
    with_offsets,
)

_OPCODES = (HEADER, CHUNK, MESSAGE_INDEX, ATTACHMENT, METADATA)
_CHUNK_MARK = b"\x04\0\0\0zstd"  # every chunk has it behind its sizes; opcode and length may be damaged
_MARK_OFFSET = 9 + 8 + 8 + 8 + 4


def walk_leniently(data: memoryview, contents: Contents) -> Iterator[RawMessage]:
    """Every message that can be had: all whole chunks with a right checksum, and the head of a cut last one.

    What was passed over is in contents.damage.
    """
    if data[: len(MAGIC)] != MAGIC:
        contents.damage.append("MCAP's magic bytes at the start are damaged")
    at: int | None = len(MAGIC)
    while at is not None:
        try:
            for at, opcode, body, behind in with_offsets(data, at, len(data)):  # noqa: B020 what follows damage
                if opcode == DATA_END and len(body) == 4:
                    return
                yield from record(opcode, body, at, contents)
                contents.complete_bytes = at = behind
            return
        except LogError as error:
            if _is_cut(data, at):
                contents.damage.append(f"the chunk at byte {at} is cut short")
                yield from _salvaged(data[at:], contents)
                return
            yield from _damaged_chunk(data, at, contents, str(error))
            at = _next_place(data, at, contents)


def _damaged_chunk(data: memoryview, at: int, contents: Contents, why: str) -> Iterator[RawMessage]:
    """The messages of a chunk at `at` whose opcode or length alone is damaged; else the damage is noted."""
    try:
        inside = inflated(data[at + 9 : at + 9 + _length_inside(data, at)], at)
        messages = list(messages_inside(inside, contents))
    except (LogError, struct.error):
        contents.damage.append(f"byte {at} passed over: {why}")
        return
    contents.damage.append(f"head of the chunk at byte {at} damaged, its contents are whole")
    yield from messages


def _next_place(data: memoryview, at: int, contents: Contents) -> int | None:
    """Where to go on: behind the damaged record if its frame makes sense.

    Never past a chunk or the end mark, nor past the run's manifest while that is not known.
    """
    place = _found(data, _CHUNK_MARK, at + 1, len(data), _MARK_OFFSET)
    for name in (END_METADATA, RUN_METADATA)[: 1 if contents.manifest else 2]:
        text = (name + contents.inside).encode()
        end = len(data) if place is None else place
        nearer = _found(data, struct.pack("<I", len(text)) + text, at + 1, end, PREFIX.size)
        place = place if nearer is None else nearer
    if len(data) - at >= 9:
        opcode, length = PREFIX.unpack_from(data, at)
        behind = at + 9 + length
        if opcode in _OPCODES and behind < len(data) and (place is None or behind <= place):
            return int(behind)
    return place


def _found(data: memoryview, mark: bytes, start: int, end: int, offset: int) -> int | None:
    """Where the first record in data[start:end] begins that has these bytes `offset` behind its beginning."""
    whole = data.obj
    assert isinstance(whole, (bytes, mmap.mmap))
    at = whole.find(mark, start + offset, end + offset + len(mark))
    return None if at < 0 else at - offset


def _length_inside(data: memoryview, at: int) -> int:
    """Length of the chunk record at `at` by what stands inside of it."""
    if bytes(data[at + _MARK_OFFSET : at + _MARK_OFFSET + len(_CHUNK_MARK)]) != _CHUNK_MARK:
        raise LogError(f"no chunk at byte {at}")
    head = _MARK_OFFSET + len(_CHUNK_MARK) + 8
    return int(struct.unpack_from("<Q", data, at + head - 8)[0]) + head - 9


def _is_cut(data: memoryview, at: int) -> bool:
    """A chunk whose head is whole (both lengths agree) and whose end is behind the file's."""
    try:
        opcode, length = PREFIX.unpack_from(data, at)
        return bool(opcode == CHUNK and at + 9 + length > len(data) and _length_inside(data, at) == length)
    except (LogError, struct.error):
        return False


def _salvaged(tail: memoryview, contents: Contents) -> Iterator[RawMessage]:
    """Messages at the head of a chunk whose end is missing; no checksum covers them, so they are counted."""
    try:
        size, _, compressed = chunk_head(tail[9:])
        reader = zstandard.ZstdDecompressor().stream_reader(bytes(tail[9 + compressed :]))
        inside = reader.read(min(size, MAX_CHUNK_BYTES))
        for message in messages_inside(inside, contents):
            contents.unverified += 1
            yield message
    except (LogError, zstandard.ZstdError):
        return
