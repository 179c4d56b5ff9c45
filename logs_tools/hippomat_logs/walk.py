"""Read the records of one .mcap of ours, believing nothing: every length and checksum is checked.

Decides which records are damaged. Knows MCAP records (https://mcap.dev/spec), not what is in the messages.
Written for our own files only: profile ros2, zstd chunks, checksums of chunks, attachments and metadata. What
a whole file must hold is in strict_walk.py, what can be had of a damaged one in lenient_walk.py.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import zstandard

from hippomat_core.errors import LogError
from hippomat_logs.facts import check_facts
from hippomat_logs.mcap_writer import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    HEADER,
    MESSAGE,
    MESSAGE_INDEX,
    METADATA,
    SCHEMA,
)
from hippomat_logs.part import (
    CHANNELS_KEY,
    END_METADATA,
    POLICY_ATTACHMENT,
    RECOVERY_METADATA,
    RUN_METADATA,
    ChannelSpec,
    channels_crc32,
    facts_crc32,
)

FOOTER_BYTES = 9 + 20
MAX_CHUNK_BYTES = 64 << 20
SLICE_BYTES = 16 << 20  # of a file, in memory at once
PREFIX = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<BQHIQQ")  # opcode and length in front
_LEAST = _MESSAGE.size - 9  # of its length
_UINT16, _UINT32, _UINT64, _TWO_UINT16 = map(struct.Struct, ("<H", "<I", "<Q", "<HH"))
_CHUNK_SIZES = struct.Struct("<QII")  # uncompressed size, checksum, length of the compression's name


class RawMessage(NamedTuple):
    """One message as its bytes."""

    number: int  # record number, from the sequence field
    log_time_ns: int
    topic: str
    data: bytes


# Its constructor without a Python call in between: every message of every log goes through it.
_raw_message = partial(tuple.__new__, RawMessage)


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


Inside = Callable[[bytes, "Contents"], Iterable[RawMessage]]  # what is done with an inflated chunk


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
    if opcode == MESSAGE_INDEX:  # nineteen of twenty
        if len(body) < 6 or _UINT32.unpack_from(body, 2)[0] != len(body) - 6:
            raise LogError(f"message index at byte {at} has an impossible length")
    elif opcode == CHUNK:
        return (inside or messages_inside)(inflated(body, at), contents)
    elif opcode == METADATA:
        _metadata(body, at, contents)
    elif opcode == ATTACHMENT:
        _attachment(body, at, contents)
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
        stored = unpacked(_UINT64, body, compressed - 8)[0]
        if stored != len(body) - compressed or size > MAX_CHUNK_BYTES:
            raise LogError("impossible sizes")
        inside = zstd_frame(bytes(body[compressed:]), size)
        if len(inside) != size or zlib.crc32(inside) != crc:
            raise LogError("wrong checksum")
        return inside
    except (LogError, zstandard.ZstdError) as error:
        raise LogError(f"chunk at byte {at}: {error}") from None


def zstd_frame(data: bytes, size: int) -> bytes:
    """The contents of a zstd frame, which must not be more than `size`.

    max_output_size alone bounds nothing: a size that the frame itself states wins, and is allocated at once.
    """
    stated = zstandard.frame_content_size(data)
    if stated not in (-1, size):
        raise LogError(f"its zstd frame states {stated} bytes, its chunk {size}")
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)


def chunk_head(body: memoryview) -> tuple[int, int, int]:
    """(uncompressed size, checksum, offset of the compressed bytes)."""
    size, crc, length = unpacked(_CHUNK_SIZES, body, 16)
    if bytes(body[32 : 32 + length]) != b"zstd":
        raise LogError("not compressed with zstd")
    return size, crc, 32 + length + 8


def messages_inside(inside: bytes, contents: Contents) -> Iterator[RawMessage]:
    """The messages of an inflated chunk. Flat, because all that is read of a log comes through here."""
    channels, fused, unpack = contents.channels, bool(contents.inside), _MESSAGE.unpack_from
    at, end, head = 0, len(inside), _MESSAGE.size
    while at + head <= end:
        opcode, length, channel, number, log_time_ns, publish_ns = unpack(inside, at)
        start, at = at, at + 9 + length
        if opcode != MESSAGE or length < _LEAST or at > end:
            at = _no_message(inside, start, contents)
            continue
        if channel not in channels:
            _take_expected(channel, contents)
        contents.messages += 1
        topic = channels[channel].topic
        if topic:  # else another run's, in a fused file
            time_ns = publish_ns if fused else log_time_ns
            yield _raw_message((number, time_ns, topic, inside[start + head : at]))
    _no_messages(inside, at, contents)


def counted_inside(inside: bytes, contents: Contents) -> Iterable[RawMessage]:
    """No message of an inflated chunk, but how many it holds of each channel, in contents.counts."""
    channels, counts, unpack = contents.channels, contents.counts, _MESSAGE.unpack_from
    at, end, head, messages = 0, len(inside), _MESSAGE.size, 0
    while at + head <= end:
        opcode, length, channel, _, _, _ = unpack(inside, at)
        start, at = at, at + 9 + length
        if opcode != MESSAGE or length < _LEAST or at > end:
            at = _no_message(inside, start, contents)
            continue
        messages += 1
        if channel in counts:
            counts[channel] += 1
            continue
        if channel not in channels:
            _take_expected(channel, contents)
        counts[channel] = 1
    contents.messages += messages
    _no_messages(inside, at, contents)
    return ()


def _no_message(inside: bytes, at: int, contents: Contents) -> int:
    """Take the record at `at` of a chunk, which is no whole message; the offset behind it."""
    opcode, body, behind = next(records(memoryview(inside), at, len(inside)))
    if opcode == MESSAGE:
        raise LogError(f"message of {len(body)} bytes inside a chunk")
    _description(opcode, body, contents)
    return behind


def _no_messages(inside: bytes, at: int, contents: Contents) -> None:
    """Take the records at the end of a chunk that are shorter than any message, or cut."""
    for opcode, body, _ in records(memoryview(inside), at, len(inside)):
        _description(opcode, body, contents)


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


def unpacked(layout: struct.Struct, body: memoryview, at: int) -> tuple[int, ...]:
    """Numbers at `at`; LogError where the record ends before."""
    if at + layout.size > len(body):
        raise LogError(f"record of {len(body)} bytes is too short")
    return layout.unpack_from(body, at)


def string_of(body: memoryview, at: int) -> tuple[str, int]:
    (length,) = unpacked(_UINT32, body, at)
    if at + 4 + length > len(body):
        raise LogError("string is longer than its record")
    text = bytes(body[at + 4 : at + 4 + length])
    try:
        return text.decode(), at + 4 + length
    except UnicodeDecodeError:
        raise LogError(f"string {text[:40]!r} is not UTF-8") from None


def pairs_of(body: memoryview, at: int) -> dict[str, str]:
    (length,) = unpacked(_UINT32, body, at)
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
    if crc is None and name.partition("/")[0] == END_METADATA:  # a recovery believes it, file checksum or not
        raise LogError(f"metadata {name} at byte {at}: carries no checksum, as every end mark of ours does")
    check_facts(name, pairs)
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
        (length,) = unpacked(_UINT64, body, behind)
        if length != len(body) - behind - 12 or zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little"):
            raise LogError("wrong length or checksum")
    except LogError as error:
        raise LogError(f"attachment at byte {at}: {error}") from None
    if (short := _own(name, contents.inside.strip("/"))) is not None:
        contents.attachments[short] = bytes(body[behind + 8 : -4])


def _own(name: str, inside: str) -> str | None:
    """What a run of a fused file calls it; None: it is another run's. A file of one run has no prefixes."""
    if not inside:
        return name
    return name[len(inside) + 1 :] if name.startswith(f"{inside}/") else None


def _schema(body: memoryview, contents: Contents) -> None:
    (number,) = unpacked(_UINT16, body, 0)
    name, at = string_of(body, 2)
    _, at = string_of(body, at)
    (length,) = unpacked(_UINT32, body, at)
    if at + 4 + length != len(body):
        raise LogError(f"schema {name} is not as long as its record")
    contents.schemas[number] = name, bytes(body[at + 4 :])


def _channel(body: memoryview, contents: Contents) -> None:
    number, schema = unpacked(_TWO_UINT16, body, 0)
    topic, at = string_of(body, 4)
    _, at = string_of(body, at)
    if schema not in contents.schemas:
        raise LogError(f"channel {topic} has schema {schema}, which no record before it describes")
    name, definition = contents.schemas[schema]
    if contents.inside:
        short = _own(topic, contents.inside)
        topic = "" if short is None else "/" + short
    spec = ChannelSpec(topic, name, definition, tuple(pairs_of(body, at).items()))
    if contents.channels.get(number, spec) != spec:
        raise LogError(f"channel {number} ({topic}) is described twice, and differently")
    contents.channels[number] = spec
