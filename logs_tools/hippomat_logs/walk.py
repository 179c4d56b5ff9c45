"""Read the bytes of one .mcap of ours, believing nothing: every length, checksum and count is checked.

Decides what counts as damage. Knows MCAP records (https://mcap.dev/spec), not what is in the messages.
Written for our own files only: profile ros2, zstd chunks, checksums of data section, chunks, summary and
manifest. What can be had of a damaged file is in lenient_walk.py.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import zstandard

from hippomat_core.errors import LogError
from hippomat_logs.mcap_writer import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    METADATA,
    SCHEMA,
    STATISTICS,
)
from hippomat_logs.part import (
    CHANNELS_KEY,
    END_METADATA,
    FUSED_METADATA,
    POLICY_ATTACHMENT,
    RECOVERY_METADATA,
    RUN_METADATA,
    ChannelSpec,
    channels_crc32,
    facts_crc32,
)

FOOTER_BYTES, DATA_END_BYTES = 9 + 20, 9 + 4
MAX_CHUNK_BYTES = 64 << 20
SLICE_BYTES = 16 << 20  # of a file, in memory at once
PREFIX = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<BQHIQQ")  # opcode and length in front


class RawMessage(NamedTuple):
    """One message as its bytes."""

    number: int  # record number, from the sequence field
    log_time_ns: int
    topic: str
    data: bytes


@dataclass(slots=True)
class Contents:
    """What a walk has met so far; complete when the walk has ended.

    expected: the channels that this version would have written, for files that lost their description.
    inside: of a fused file, the run whose messages, facts and attachments are wanted, by its prefix
    ("/robot03"). They are given as its own log had them: without the prefix, at its own log times.
    """

    inside: str = ""
    expected: Mapping[int, ChannelSpec] = field(default_factory=dict)
    manifest: dict[str, str] = field(default_factory=dict)
    end: dict[str, str] = field(default_factory=dict)
    recovery: dict[str, str] = field(default_factory=dict)  # what a recovery kept and could not keep
    attachments: dict[str, bytes] = field(default_factory=dict)
    channels: dict[int, ChannelSpec] = field(default_factory=dict)
    schemas: dict[int, tuple[str, bytes]] = field(default_factory=dict)
    messages: int = 0
    counts: dict[int, int] = field(default_factory=dict)  # messages by channel, where they were only counted
    complete_bytes: int = 0  # everything before this offset was read
    damage: list[str] = field(default_factory=list)  # what a lenient walk passed over
    unverified: int = 0  # messages of a chunk that was cut: no checksum covers them

    @property
    def policy(self) -> bytes:
        """The weights that decided, as safetensors; empty where the allocator has none."""
        return self.attachments.get(POLICY_ATTACHMENT, b"")


def forget(data: memoryview, start: int, end: int) -> None:
    """Pages of a mapped file that were read no longer count as this process's memory."""
    if isinstance(data.obj, mmap.mmap):
        start, end = (at // mmap.PAGESIZE * mmap.PAGESIZE for at in (start, end))
        if end > start:
            data.obj.madvise(mmap.MADV_DONTNEED, start, end - start)


def crc32_of(data: memoryview, end: int) -> int:
    """Checksum of data[:end] without holding it in memory."""
    crc = 0
    for at in range(0, end, SLICE_BYTES):
        behind = min(at + SLICE_BYTES, end)
        crc = zlib.crc32(data[at:behind], crc)
        forget(data, at, behind)
    return crc


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
        if opcode == STATISTICS:
            return int(struct.unpack_from("<Q", body)[0])
    raise missing


Inside = Callable[[bytes, "Contents"], Iterable[RawMessage]]  # what is done with an inflated chunk


def walk_strictly(
    data: memoryview, name: str, contents: Contents, inside: Inside | None = None
) -> Iterator[RawMessage]:
    """Every message of a finished file in file order; raises LogError on anything unexpected.

    inside: messages_inside, or counted_inside where only `contents` is wanted.
    """
    end, promised = check_frame(data, name)
    first = [opcode for (opcode, _, _), _ in zip(records(data, len(MAGIC), end), range(2), strict=False)]
    if first != [HEADER, METADATA]:
        raise LogError(f"{name}: has no run manifest behind its header, as every log of ours does")
    for at, opcode, body, behind in with_offsets(data, len(MAGIC), end):
        yield from record(opcode, body, at, contents, inside)
        contents.complete_bytes = behind
    if not contents.manifest:
        raise LogError(f"{name}: holds no {RUN_METADATA} metadata, as every log of ours does")
    if contents.messages != promised:
        raise LogError(f"{name}: {contents.messages} messages read, but its summary promises {promised}")


def fused_runs(data: memoryview) -> tuple[str, ...]:
    """Prefixes of the runs in a fused file, by its first metadata; of any other file, whole or not: none."""
    try:
        first = [
            (o, body) for (o, body, _), _ in zip(records(data, len(MAGIC), len(data)), range(2), strict=False)
        ]
        if [opcode for opcode, _ in first] != [HEADER, METADATA]:
            return ()
        name, facts = metadata_of(first[1][1], 0)
    except (LogError, struct.error, UnicodeDecodeError):
        return ()
    return tuple(facts.get("runs", "").split()) if name == FUSED_METADATA else ()


def with_offsets(data: memoryview, start: int, end: int) -> Iterator[tuple[int, int, memoryview, int]]:
    """(offset, opcode, body, offset behind it) of the records in data[start:end]."""
    forgotten = at = start
    for opcode, body, behind in records(data, start, end):
        yield at, opcode, body, behind
        at = behind
        if at - forgotten > SLICE_BYTES:
            forget(data, forgotten, at)
            forgotten = at


def records(data: memoryview, start: int, end: int) -> Iterator[tuple[int, memoryview, int]]:
    """(opcode, body, offset behind it) of the records in data[start:end]."""
    at = start
    while at < end:
        if at + 9 > end:
            raise LogError(f"record at byte {at} is cut short")
        opcode, length = PREFIX.unpack_from(data, at)
        if length > end - at - 9:
            raise LogError(f"record at byte {at} (opcode {opcode}, {length} bytes) is cut short")
        yield opcode, data[at + 9 : at + 9 + length], at + 9 + length
        at += 9 + length


def record(
    opcode: int, body: memoryview, at: int, contents: Contents, inside: Inside | None = None
) -> Iterable[RawMessage]:
    """One record of the data section; its lengths must agree: a damaged head is no harmless record."""
    if opcode == CHUNK:
        return (inside or messages_inside)(inflated(body, at), contents)
    if opcode == METADATA:
        _metadata(body, at, contents)
    elif opcode == ATTACHMENT:
        _attachment(body, at, contents)
    elif opcode == MESSAGE_INDEX:
        if len(body) < 6 or struct.unpack_from("<I", body, 2)[0] != len(body) - 6:
            raise LogError(f"message index at byte {at} has an impossible length")
    elif opcode == HEADER:
        if string_of(body, string_of(body, 0)[1])[1] != len(body):
            raise LogError("file header damaged")
    else:
        raise LogError(f"record at byte {at} has opcode {opcode}, which our logs never hold there")
    return ()


def inflated(body: memoryview, at: int) -> bytes:
    """Uncompressed records of a chunk, checked."""
    try:
        size, crc, compressed = chunk_head(body)
        stored = struct.unpack_from("<Q", body, compressed - 8)[0]
        if stored != len(body) - compressed or size > MAX_CHUNK_BYTES:
            raise LogError("impossible sizes")
        inside = zstandard.ZstdDecompressor().decompress(bytes(body[compressed:]), max_output_size=size)
        if len(inside) != size or zlib.crc32(inside) != crc:
            raise LogError("wrong checksum")
        return inside
    except (LogError, struct.error, zstandard.ZstdError) as error:
        raise LogError(f"chunk at byte {at}: {error}") from None


def chunk_head(body: memoryview) -> tuple[int, int, int]:
    """(uncompressed size, checksum, offset of the compressed bytes)."""
    size, crc, length = struct.unpack_from("<QII", body, 16)
    if bytes(body[32 : 32 + length]) != b"zstd":
        raise LogError("not compressed with zstd")
    return size, crc, 32 + length + 8


def messages_inside(inside: bytes, contents: Contents) -> Iterator[RawMessage]:
    """The messages of an inflated chunk. Flat, because all that is read of a log comes through here."""
    channels, unpack, fused = contents.channels, _MESSAGE.unpack_from, bool(contents.inside)
    at, end = 0, len(inside)
    while at + _MESSAGE.size <= end:
        opcode, length, channel, number, log_time_ns, publish_ns = unpack(inside, at)
        behind = at + 9 + length
        if behind > end:
            break
        if opcode != MESSAGE:
            _description(opcode, memoryview(inside)[at + 9 : behind], contents)
        elif behind < at + _MESSAGE.size:
            raise LogError(f"message of {length} bytes inside a chunk")
        else:
            if channel not in channels:
                _take_expected(channel, contents)
            contents.messages += 1
            topic = channels[channel].topic
            if topic:  # else another run's, in a fused file
                time_ns = publish_ns if fused else log_time_ns
                yield RawMessage(number, time_ns, topic, inside[at + _MESSAGE.size : behind])
        at = behind
    for opcode, body, _ in records(memoryview(inside), at, end):  # shorter than any message, or cut
        _description(opcode, body, contents)


def counted_inside(inside: bytes, contents: Contents) -> Iterable[RawMessage]:
    """No message of an inflated chunk, but how many it holds of each channel, in contents.counts."""
    counts, unpack = contents.counts, _MESSAGE.unpack_from
    at, end = 0, len(inside)
    while at + _MESSAGE.size <= end:
        opcode, length, channel, *_ = unpack(inside, at)
        behind = at + 9 + length
        if behind > end:
            break
        if opcode == MESSAGE:
            if channel not in contents.channels:
                _take_expected(channel, contents)
            counts[channel] = counts.get(channel, 0) + 1
            contents.messages += 1
        else:
            _description(opcode, memoryview(inside)[at + 9 : behind], contents)
        at = behind
    for opcode, body, _ in records(memoryview(inside), at, end):
        _description(opcode, body, contents)
    return ()


def _description(opcode: int, body: memoryview, contents: Contents) -> None:
    """A schema or a channel: what else a chunk may hold."""
    if opcode == SCHEMA:
        _schema(body, contents)
    elif opcode == CHANNEL:
        _channel(body, contents)
    else:
        raise LogError(f"record with opcode {opcode} inside a chunk")


def _take_expected(channel: int, contents: Contents) -> None:
    """The first chunk describes all channels. Without it ours will do, if the manifest says so."""
    expected = contents.expected
    known = contents.manifest.get(CHANNELS_KEY) == channels_crc32(list(expected.values()))
    if channel not in expected or not known:
        raise LogError(f"message on channel {channel}, which no whole chunk describes")
    contents.channels.update(expected)


def string_of(body: memoryview, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", body, at)
    if at + 4 + length > len(body):
        raise LogError("string is longer than its record")
    return bytes(body[at + 4 : at + 4 + length]).decode(), at + 4 + length


def pairs_of(body: memoryview, at: int) -> dict[str, str]:
    (length,) = struct.unpack_from("<I", body, at)
    at, end = at + 4, at + 4 + length
    if end != len(body):
        raise LogError("key-value pairs are not as long as their record")
    pairs: dict[str, str] = {}
    while at < end:
        key, at = string_of(body, at)
        pairs[key], at = string_of(body, at)
    return pairs


def metadata_of(body: memoryview, at: int) -> tuple[str, dict[str, str]]:
    """Name and pairs of the metadata at byte `at`. MCAP has no checksum for them; ours carry one."""
    name, behind = string_of(body, 0)
    pairs = pairs_of(body, behind)
    crc = pairs.pop("crc32", None)
    if crc is not None and crc != facts_crc32(pairs):
        raise LogError(f"metadata {name} at byte {at}: wrong checksum")
    return name, pairs


def _metadata(body: memoryview, at: int, contents: Contents) -> None:
    name, pairs = metadata_of(body, at)
    if name == RUN_METADATA + contents.inside:
        contents.manifest.update(pairs)
    elif name == END_METADATA + contents.inside:
        contents.end.update(pairs)
    elif name == RECOVERY_METADATA + contents.inside:
        contents.recovery.update(pairs)


def _attachment(body: memoryview, at: int, contents: Contents) -> None:
    try:
        name, behind = string_of(body, 16)
        _, behind = string_of(body, behind)
        (length,) = struct.unpack_from("<Q", body, behind)
        if length != len(body) - behind - 12 or zlib.crc32(body[:-4]) != struct.unpack("<I", body[-4:])[0]:
            raise LogError("wrong length or checksum")
    except (LogError, struct.error, UnicodeDecodeError) as error:
        raise LogError(f"attachment at byte {at}: {error}") from None
    if (short := _own(name, contents.inside.strip("/"))) is not None:
        contents.attachments[short] = bytes(body[behind + 8 : -4])


def _own(name: str, inside: str) -> str | None:
    """What a run of a fused file calls it; None: it is another run's. A file of one run has no prefixes."""
    if not inside:
        return name
    return name[len(inside) + 1 :] if name.startswith(f"{inside}/") else None


def _schema(body: memoryview, contents: Contents) -> None:
    (number,) = struct.unpack_from("<H", body)
    name, at = string_of(body, 2)
    _, at = string_of(body, at)
    contents.schemas[number] = name, bytes(body[at + 4 :])


def _channel(body: memoryview, contents: Contents) -> None:
    number, schema = struct.unpack_from("<HH", body)
    topic, at = string_of(body, 4)
    _, at = string_of(body, at)
    name, definition = contents.schemas[schema]
    if contents.inside:
        short = _own(topic, contents.inside)
        topic = "" if short is None else "/" + short
    contents.channels[number] = ChannelSpec(topic, name, definition, tuple(pairs_of(body, at).items()))
