"""Read the bytes of one .mcap of ours, believing nothing: every length, checksum and count is checked.

Decides what counts as damage. Knows MCAP records (https://mcap.dev/spec), not what is in the messages.
Written for our own files only: profile ros2, zstd chunks, checksums of data section, chunks and summary.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field

import zstandard

from hippomat_core.errors import LogError
from hippomat_logs.part import END_METADATA, POLICY_ATTACHMENT, RUN_METADATA, ChannelSpec

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 1, 2, 3, 4, 5, 6, 7
ATTACHMENT, STATISTICS, METADATA, DATA_END = 0x09, 0x0B, 0x0C, 0x0F
FOOTER_BYTES, DATA_END_BYTES = 9 + 20, 9 + 4
MAX_CHUNK_BYTES = 64 << 20
_PREFIX = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")


@dataclass(frozen=True, slots=True)
class RawMessage:
    number: int  # record number, from the sequence field
    log_time_ns: int
    topic: str
    data: bytes


@dataclass(slots=True)
class Contents:
    """What a walk has met so far; complete when the walk has ended."""

    manifest: dict[str, str] = field(default_factory=dict)
    end: dict[str, str] = field(default_factory=dict)
    policy: bytes = b""  # safetensors; empty where the allocator has no weights
    channels: dict[int, ChannelSpec] = field(default_factory=dict)
    schemas: dict[int, tuple[str, bytes]] = field(default_factory=dict)
    messages: int = 0
    complete_bytes: int = 0  # everything before this offset was read
    damage: list[str] = field(default_factory=list)  # what a lenient walk passed over


def check_frame(data: memoryview, name: str) -> tuple[int, int]:
    """Verify magic, footer, summary and data-section checksums; (end of data section, messages promised)."""

    def damaged(what: str) -> LogError:
        return LogError(f"{name}: {what}; `hippomat-logs recover {name}` saves what can be read")

    if data[: len(MAGIC)] != MAGIC:
        raise LogError(f"{name}: does not begin with MCAP's magic bytes: not a log, or its head is damaged")
    footer = len(data) - len(MAGIC) - FOOTER_BYTES
    if footer < len(MAGIC) or data[-len(MAGIC) :] != MAGIC:
        raise damaged("does not end with MCAP's magic bytes: cut short or damaged")
    opcode, length = _PREFIX.unpack_from(data, footer)
    summary, offsets, summary_crc = struct.unpack_from("<QQI", data, footer + 9)
    if (opcode, length) != (FOOTER, 20) or not len(MAGIC) + DATA_END_BYTES <= summary <= offsets <= footer:
        raise damaged("footer damaged")
    if zlib.crc32(data[summary : footer + 9 + 16]) != summary_crc:
        raise damaged("summary or footer checksum wrong")
    end = summary - DATA_END_BYTES
    if _PREFIX.unpack_from(data, end) != (DATA_END, 4):
        raise damaged("end of the data section damaged")
    if zlib.crc32(data[:end]) != struct.unpack_from("<I", data, end + 9)[0]:
        raise damaged("data-section checksum wrong: at least one bit has changed")
    return end, _messages_promised(data, summary, offsets, damaged("summary holds no statistics"))


def _messages_promised(data: memoryview, start: int, end: int, missing: LogError) -> int:
    for opcode, body, _ in _records(data, start, end):
        if opcode == STATISTICS:
            return int(struct.unpack_from("<Q", body)[0])
    raise missing


def walk_strictly(data: memoryview, name: str, contents: Contents) -> Iterator[RawMessage]:
    """Every message of a finished file in file order; raises LogError on anything unexpected."""
    end, promised = check_frame(data, name)
    first = [opcode for (opcode, _, _), _ in zip(_records(data, len(MAGIC), end), range(2), strict=False)]
    if first != [HEADER, METADATA]:
        raise LogError(f"{name}: has no run manifest behind its header; was it recorded by hippomat?")
    yield from _walk(data, len(MAGIC), end, contents, None)
    if not contents.manifest:
        raise LogError(f"{name}: holds no {RUN_METADATA} metadata; was it recorded by hippomat?")
    if contents.messages != promised:
        raise LogError(f"{name}: {contents.messages} messages read, but its summary promises {promised}")


def walk_leniently(data: memoryview, contents: Contents) -> Iterator[RawMessage]:
    """Every message that can be had: whole chunks with a right checksum, and the head of a cut last chunk.

    What was passed over is in contents.damage.
    """
    if data[: len(MAGIC)] != MAGIC:
        contents.damage.append("no MCAP magic at the start")
        return
    try:
        yield from _walk(data, len(MAGIC), len(data), contents, contents.damage)
    except (LogError, struct.error, UnicodeDecodeError) as error:
        contents.damage.append(str(error))


def _records(data: memoryview, start: int, end: int) -> Iterator[tuple[int, memoryview, int]]:
    """(opcode, body, offset behind it) of the records in data[start:end]."""
    at = start
    while at < end:
        if at + 9 > end:
            raise LogError(f"record at byte {at} is cut short")
        opcode, length = _PREFIX.unpack_from(data, at)
        if length > end - at - 9:
            raise LogError(f"record at byte {at} (opcode {opcode}, {length} bytes) is cut short")
        yield opcode, data[at + 9 : at + 9 + length], at + 9 + length
        at += 9 + length


def _walk(
    data: memoryview, start: int, end: int, contents: Contents, damage: list[str] | None
) -> Iterator[RawMessage]:
    """Walk records; with `damage` given, bad chunks are noted there and a cut last chunk is salvaged."""
    at = start
    try:
        for opcode, body, behind in _records(data, start, end):
            if opcode == DATA_END:
                return
            if opcode == CHUNK:
                inside = _chunk(body, at, damage)
                if inside is not None:
                    yield from _inside(memoryview(inside), contents)
            elif opcode == METADATA:
                _metadata(body, contents)
            elif opcode == ATTACHMENT:
                _attachment(body, at, contents, damage)
            elif opcode not in (HEADER, MESSAGE_INDEX):
                raise LogError(f"record at byte {at} has opcode {opcode}, which our logs never hold there")
            at = contents.complete_bytes = behind
    except LogError:
        if damage is None:
            raise
        damage.append(f"nothing whole behind byte {at} of {end}")
        yield from _salvage(data[at:end], contents)


def _chunk(body: memoryview, at: int, damage: list[str] | None) -> bytes | None:
    """Uncompressed records of a chunk, or None if it is bad and `damage` is there to take the note."""
    try:
        size, crc, compressed = _chunk_head(body)
        stored = struct.unpack_from("<Q", body, compressed - 8)[0]
        if stored != len(body) - compressed or size > MAX_CHUNK_BYTES:
            raise LogError(f"chunk at byte {at} has impossible sizes")
        inside = zstandard.ZstdDecompressor().decompress(bytes(body[compressed:]), max_output_size=size)
        if len(inside) != size or zlib.crc32(inside) != crc:
            raise LogError(f"chunk at byte {at} has a wrong checksum")
        return inside
    except (LogError, struct.error, zstandard.ZstdError) as error:
        if damage is None:
            raise LogError(f"chunk at byte {at}: {error}") from None
        damage.append(f"chunk at byte {at} passed over: {error}")
        return None


def _chunk_head(body: memoryview) -> tuple[int, int, int]:
    """(uncompressed size, checksum, offset of the compressed bytes)."""
    size, crc, length = struct.unpack_from("<QII", body, 16)
    if bytes(body[32 : 32 + length]) != b"zstd":
        raise LogError("not compressed with zstd")
    return size, crc, 32 + length + 8


def _inside(inside: memoryview, contents: Contents) -> Iterator[RawMessage]:
    channels = contents.channels
    for opcode, body, _ in _records(inside, 0, len(inside)):
        if opcode == MESSAGE:
            channel, number, log_time_ns, _ = _MESSAGE.unpack_from(body)
            if channel not in channels:
                raise LogError(f"message on channel {channel}, which no whole chunk describes")
            contents.messages += 1
            yield RawMessage(number, log_time_ns, channels[channel].topic, bytes(body[22:]))
        elif opcode == SCHEMA:
            _schema(body, contents)
        elif opcode == CHANNEL:
            _channel(body, contents)
        else:
            raise LogError(f"record with opcode {opcode} inside a chunk")


def _salvage(tail: memoryview, contents: Contents) -> Iterator[RawMessage]:
    """Messages at the head of a chunk whose end is missing; no checksum covers them."""
    if len(tail) < 9 or tail[0] != CHUNK:
        return
    try:
        _, _, compressed = _chunk_head(tail[9:])
        inside = zstandard.ZstdDecompressor().decompressobj().decompress(bytes(tail[9 + compressed :]))
        yield from _inside(memoryview(inside), contents)
    except (LogError, struct.error, zstandard.ZstdError):
        return


def _string(body: memoryview, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", body, at)
    if at + 4 + length > len(body):
        raise LogError("string is longer than its record")
    return bytes(body[at + 4 : at + 4 + length]).decode(), at + 4 + length


def _pairs(body: memoryview, at: int) -> dict[str, str]:
    (length,) = struct.unpack_from("<I", body, at)
    at, end = at + 4, at + 4 + length
    pairs: dict[str, str] = {}
    while at < end:
        key, at = _string(body, at)
        pairs[key], at = _string(body, at)
    return pairs


def _metadata(body: memoryview, contents: Contents) -> None:
    name, at = _string(body, 0)
    if name == RUN_METADATA:
        contents.manifest.update(_pairs(body, at))
    elif name == END_METADATA:
        contents.end.update(_pairs(body, at))


def _attachment(body: memoryview, at: int, contents: Contents, damage: list[str] | None) -> None:
    """The weights, if it is those; bad ones are passed over if `damage` is there to take the note."""
    try:
        name, behind = _string(body, 16)
        _, behind = _string(body, behind)
        (length,) = struct.unpack_from("<Q", body, behind)
        if length != len(body) - behind - 12 or zlib.crc32(body[:-4]) != struct.unpack("<I", body[-4:])[0]:
            raise LogError("wrong length or checksum")
        if name == POLICY_ATTACHMENT:
            contents.policy = bytes(body[behind + 8 : -4])
    except (LogError, struct.error, UnicodeDecodeError) as error:
        if damage is None:
            raise LogError(f"attachment at byte {at}: {error}") from None
        damage.append(f"attachment at byte {at} passed over: {error}")


def _schema(body: memoryview, contents: Contents) -> None:
    (number,) = struct.unpack_from("<H", body)
    name, at = _string(body, 2)
    _, at = _string(body, at)
    contents.schemas[number] = name, bytes(body[at + 4 :])


def _channel(body: memoryview, contents: Contents) -> None:
    number, schema = struct.unpack_from("<HH", body)
    topic, at = _string(body, 4)
    _, at = _string(body, at)
    name, definition = contents.schemas[schema]
    contents.channels[number] = ChannelSpec(topic, name, definition, tuple(_pairs(body, at).items()))
