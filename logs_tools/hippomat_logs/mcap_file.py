"""Any finished .mcap, read by its index: channels, chunks by time and channel, messages as bytes.

Decides what can be read of files that others wrote (chunks of zstd, lz4 or none, or no chunks at all), and
refuses data whose checksum is wrong. Knows MCAP records (https://mcap.dev/spec), not messages.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import lz4.frame
import zstandard

from hippomat_core.errors import LogError
from hippomat_logs.mcap_writer import (
    ATTACHMENT_INDEX,
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    METADATA_INDEX,
    SCHEMA,
    STATISTICS,
)
from hippomat_logs.reader import mapped
from hippomat_logs.sink import ACTIVE
from hippomat_logs.walk import (
    FOOTER_BYTES,
    MAX_CHUNK_BYTES,
    forget,
    metadata_of,
    pairs_of,
    records,
    string_of,
    zstd_frame,
)

_MESSAGE = struct.Struct("<BQHIQQ")
ALWAYS = (0, 1 << 63)


class Channel(NamedTuple):
    topic: str
    encoding: str  # of the messages: cdr, ros1, json ...
    type_name: str
    schema_encoding: str  # ros2msg, ros2idl, ros1msg, jsonschema ...
    schema: bytes
    metadata: dict[str, str]


class RawRow(NamedTuple):
    """One message. sequence: the record number, in our files. own_ns: its publish time; in a file that was
    fused from several, the time in its own log."""

    channel: int
    sequence: int
    log_time_ns: int
    data: bytes
    own_ns: int = 0


class _Chunk(NamedTuple):
    start_ns: int
    end_ns: int
    offset: int
    length: int
    channels: frozenset[int]  # empty: its writer did not say


@dataclass(slots=True)
class McapFile:
    """Opened by open_mcap(); a value, no open file."""

    path: Path
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] | None = None  # messages by channel; None: the file does not say
    start_ns: int = 0
    end_ns: int = 0
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, tuple[int, int]] = field(default_factory=dict)  # name -> where its record is
    chunks: list[_Chunk] = field(default_factory=list)

    def rows(
        self, channels: Collection[int] | None = None, start_ns: int = 0, end_ns: int = 1 << 63
    ) -> Iterator[RawRow]:
        """Messages in file order, start_ns <= log time < end_ns; LogError where a checksum is wrong."""
        wanted = frozenset(self.channels if channels is None else channels)
        with mapped(self.path) as data:
            if not self.chunks:
                yield from _rows_in(data, len(MAGIC), len(data), wanted, start_ns, end_ns, self.path)
            for chunk in self.chunks:
                outside = chunk.end_ns < start_ns or chunk.start_ns >= end_ns
                if outside or (chunk.channels and not chunk.channels & wanted):
                    continue
                inside = memoryview(self._inflated(data, chunk))
                forget(data, chunk.offset, chunk.offset + chunk.length)
                yield from _rows_in(inside, 0, len(inside), wanted, start_ns, end_ns, self.path)

    def attachment(self, name: str) -> bytes:
        """Its data; LogError where the checksum is wrong."""
        offset, length = self.attachments[name]
        with mapped(self.path) as data:
            body = data[offset + 9 : offset + length]
            if zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little"):
                raise LogError(f"{self.path}: attachment {name} has a wrong checksum")
            try:
                _, at = string_of(body, 16)
                _, at = string_of(body, at)
            except LogError as error:
                raise LogError(f"{self.path}: attachment {name}: {error}") from None
            return bytes(body[at + 8 : -4])

    def _inflated(self, data: memoryview, chunk: _Chunk) -> bytes:
        where = f"{self.path}: chunk at byte {chunk.offset}"
        body = data[chunk.offset + 9 : chunk.offset + chunk.length]
        try:
            size, crc = struct.unpack_from("<QI", body, 16)
            compression, at = string_of(body, 28)
            (stored,) = struct.unpack_from("<Q", body, at)
            if data[chunk.offset] != CHUNK or stored != len(body) - at - 8 or size > MAX_CHUNK_BYTES * 16:
                raise LogError("impossible sizes")
            inside = decompress(compression, bytes(body[at + 8 :]), size)
        except (LogError, struct.error, IndexError, zstandard.ZstdError, RuntimeError, ValueError) as error:
            raise LogError(f"{where} cannot be read: {error}") from None
        if len(inside) != size or (crc and zlib.crc32(inside) != crc):
            raise LogError(f"{where} has a wrong checksum: at least one bit has changed")
        return inside


def decompress(compression: str, data: bytes, size: int) -> bytes:
    """At most size + 1 bytes. Raises ValueError for a compression that MCAP does not know."""
    if compression == "zstd":
        return zstd_frame(data, size)
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    if compression:
        raise ValueError(f"compression {compression!r} is not known")
    return data


def open_mcap(path: Path) -> McapFile:
    """Read the summary; a file without one is walked once. LogError: damaged or unfinished."""
    if path.name.endswith(ACTIVE):
        raise LogError(f"{path}: still being recorded, or its daemon died: `hippomat-logs recover {path}`")
    with mapped(path) as data:
        summary, end = _summary(data, path)
        file = McapFile(path)
        try:
            _read_summary(file, data, summary, end)
            if not file.chunks:
                _scan(file, data)
        except (LogError, struct.error, IndexError) as error:
            if str(path) in str(error):
                raise
            raise LogError(f"{path}: its index is damaged ({error}); try `hippomat-logs recover`") from None
    return file


def _summary(data: memoryview, path: Path) -> tuple[int, int]:
    """Where the summary begins (0: there is none) and ends."""
    if data[: len(MAGIC)] != MAGIC:
        raise LogError(
            f"{path}: does not begin with MCAP's magic bytes, its head is damaged: "
            f"`hippomat-logs recover {path}` saves what can be read of ours"
        )
    footer = len(data) - len(MAGIC) - FOOTER_BYTES
    whole = footer >= len(MAGIC) and data[-len(MAGIC) :] == MAGIC and data[footer] == FOOTER
    if not whole:
        raise LogError(
            f"{path}: is cut short or damaged: `hippomat-logs recover {path}` saves what can be read of ours"
        )
    summary, _, crc = struct.unpack_from("<QQI", data, footer + 9)
    if summary and (summary > footer or (crc and zlib.crc32(data[summary : footer + 25]) != crc)):
        raise LogError(f"{path}: the checksum of its index is wrong: `hippomat-logs recover {path}`")
    return summary, footer


def _read_summary(file: McapFile, data: memoryview, start: int, end: int) -> None:
    schemas: dict[int, tuple[str, str, bytes]] = {}
    for opcode, body, _ in records(data, start, end) if start else ():
        if opcode == SCHEMA:
            number, name, encoding, text = _schema(body)
            schemas[number] = name, encoding, text
        elif opcode == CHANNEL:
            _add_channel(file, body, schemas)
        elif opcode == STATISTICS:
            file.start_ns, file.end_ns = struct.unpack_from("<QQ", body, 26)
            (length,) = struct.unpack_from("<I", body, 42)
            file.counts = dict(struct.iter_unpack("<HQ", body[46 : 46 + length]))
        elif opcode == CHUNK_INDEX:
            start_ns, end_ns, offset, length = struct.unpack_from("<QQQQ", body)
            place = start_ns, end_ns, offset, length
            (length,) = struct.unpack_from("<I", body, 32)
            channels = frozenset(number for number, _ in struct.iter_unpack("<HQ", body[36 : 36 + length]))
            file.chunks.append(_Chunk(*place, channels))
        elif opcode == ATTACHMENT_INDEX:
            file.attachments[string_of(body, 40)[0]] = struct.unpack_from("<QQ", body)
        elif opcode == METADATA_INDEX:
            offset, length = struct.unpack_from("<QQ", body)
            name, pairs = metadata_of(data[offset + 9 : offset + length], offset)
            file.metadata[name] = pairs
    if file.counts is None and file.chunks:
        file.counts = _counted(file, data)
        file.start_ns = min(chunk.start_ns for chunk in file.chunks)
        file.end_ns = max(chunk.end_ns for chunk in file.chunks)


def _counted(file: McapFile, data: memoryview) -> dict[int, int] | None:
    """Messages by channel from the message indexes behind the chunks; None where a chunk has none."""
    counts = dict.fromkeys(file.channels, 0)
    for chunk in file.chunks:
        if not chunk.channels:
            return None
        for opcode, body, _ in records(data, chunk.offset + chunk.length, len(data)):
            if opcode != MESSAGE_INDEX:
                break
            channel, length = struct.unpack_from("<HI", body)
            counts[channel] = counts.get(channel, 0) + length // 16
    return counts


def _scan(file: McapFile, data: memoryview) -> None:
    """Index a file that has no index: chunks as they come, channels inside of them."""
    schemas: dict[int, tuple[str, str, bytes]] = {}
    at = len(MAGIC)
    for opcode, body, behind in records(data, at, len(data) - len(MAGIC)):
        if opcode == DATA_END:
            break
        if opcode == CHUNK:
            start_ns, end_ns = struct.unpack_from("<QQ", body)
            file.chunks.append(_Chunk(start_ns, end_ns, at, behind - at, frozenset()))
            inside = memoryview(file._inflated(data, file.chunks[-1]))
            for inner, held, _ in records(inside, 0, len(inside)):
                _described(file, inner, held, schemas)
        else:
            _described(file, opcode, body, schemas)
        at = behind


def _described(
    file: McapFile, opcode: int, body: memoryview, schemas: dict[int, tuple[str, str, bytes]]
) -> None:
    if opcode == SCHEMA:
        number, name, encoding, text = _schema(body)
        schemas[number] = name, encoding, text
    elif opcode == CHANNEL:
        _add_channel(file, body, schemas)
    elif opcode == MESSAGE:
        channel, _, log_time_ns, _ = struct.unpack_from("<HIQQ", body)
        file.counts = file.counts or {}
        file.counts[channel] = file.counts.get(channel, 0) + 1
        file.start_ns = min(file.start_ns or log_time_ns, log_time_ns)
        file.end_ns = max(file.end_ns, log_time_ns)


def _rows_in(
    data: memoryview, start: int, end: int, wanted: frozenset[int], start_ns: int, end_ns: int, path: Path
) -> Iterator[RawRow]:
    """Messages among the records of data[start:end], a chunk's inside or a whole data section."""
    at, unpack = start, _MESSAGE.unpack_from
    last = end - _MESSAGE.size
    while at <= last:
        opcode, length, channel, sequence, log_time_ns, own_ns = unpack(data, at)
        behind = at + 9 + length
        if behind > end:
            raise LogError(f"{path}: record at byte {at} is cut short")
        if opcode == MESSAGE and channel in wanted and start_ns <= log_time_ns < end_ns:
            yield RawRow(channel, sequence, log_time_ns, bytes(data[at + 31 : behind]), own_ns)
        elif opcode == DATA_END:
            return
        at = behind


def _schema(body: memoryview) -> tuple[int, str, str, bytes]:
    (number,) = struct.unpack_from("<H", body)
    name, at = string_of(body, 2)
    encoding, at = string_of(body, at)
    return number, name, encoding, bytes(body[at + 4 :])


def _add_channel(file: McapFile, body: memoryview, schemas: dict[int, tuple[str, str, bytes]]) -> None:
    number, schema = struct.unpack_from("<HH", body)
    topic, at = string_of(body, 4)
    encoding, at = string_of(body, at)
    name, schema_encoding, text = schemas.get(schema, ("", "", b""))
    file.channels[number] = Channel(topic, encoding, name, schema_encoding, text, pairs_of(body, at))
