"""Write MCAP (https://mcap.dev/spec): chunks of zstd, every checksum, every index. Knows records, not topics.

Decides the bytes of a file. Ours because the mcap package's writer costs ten times as much per message, and a
robot writes hundreds a second beside its control loop; that package and rosbags read what comes out in tests.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Protocol

import zstandard

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = 1, 2, 3, 4, 5, 6, 7, 8
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET = 9, 10, 11, 12, 13, 14
DATA_END = 15
LEVEL = 1  # of zstd: a third faster than its usual 3, files a few per cent larger
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<BQHIQQ")
_INDEX = struct.Struct("<BQHI")
_MESSAGE_FIELDS = 22  # bytes between a message's length and its data


class Output(Protocol):
    def write(self, data: bytes, /) -> int: ...
    def tell(self) -> int: ...
    def flush(self) -> None: ...


class McapWriter:
    """flush() closes the chunk and hands everything on to the output; after an OSError abandon the writer."""

    def __init__(
        self, output: Output, profile: str, library: str, chunk_bytes: int, level: int = LEVEL
    ) -> None:
        self._output, self._chunk_bytes = output, chunk_bytes
        self._compressor = zstandard.ZstdCompressor(level=level)
        self._crc = 0
        self._descriptions: list[tuple[int, bytes]] = []  # schemas and channels, for the summary
        self._chunk: list[bytes] = []
        self._chunk_size = 0
        self._index: defaultdict[int, list[int]] = defaultdict(list)  # channel -> log time, offset, ...
        self._summary: defaultdict[int, list[bytes]] = defaultdict(list)
        self._counts: defaultdict[int, int] = defaultdict(int)
        self._times: tuple[int, int] | None = None
        self._put(MAGIC)
        self._put(_record(HEADER, _text(profile) + _text(library)))

    def add_metadata(self, name: str, facts: Mapping[str, str]) -> None:
        self._close_chunk()
        at, record = self._output.tell(), _record(METADATA, _text(name) + _pairs(facts))
        self._put(record)
        index = struct.pack("<QQ", at, len(record)) + _text(name)
        self._summary[METADATA_INDEX].append(_record(METADATA_INDEX, index))

    def add_attachment(self, time_ns: int, name: str, media_type: str, data: bytes) -> None:
        self._close_chunk()
        at = self._output.tell()
        body = struct.pack("<QQ", time_ns, time_ns) + _text(name) + _text(media_type)
        body += struct.pack("<Q", len(data)) + data
        record = _record(ATTACHMENT, body + struct.pack("<I", zlib.crc32(body)))
        self._put(record)
        index = struct.pack("<QQQQQ", at, len(record), time_ns, time_ns, len(data))
        self._summary[ATTACHMENT_INDEX].append(
            _record(ATTACHMENT_INDEX, index + _text(name) + _text(media_type))
        )

    def add_schema(self, name: str, encoding: str, text: bytes) -> int:
        """Its number."""
        number = 1 + sum(opcode == SCHEMA for opcode, _ in self._descriptions)
        body = struct.pack("<H", number) + _text(name) + _text(encoding) + struct.pack("<I", len(text)) + text
        self._describe(SCHEMA, body)
        return number

    def add_channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Its number."""
        number = 1 + sum(opcode == CHANNEL for opcode, _ in self._descriptions)
        body = struct.pack("<HH", number, schema) + _text(topic) + _text(encoding) + _pairs(metadata)
        self._describe(CHANNEL, body)
        return number

    def add_message(self, channel: int, sequence: int, log_time_ns: int, data: bytes) -> None:
        self.add_messages(((channel, sequence, log_time_ns, log_time_ns, data),))

    def add_messages(self, messages: Iterable[tuple[int, int, int, int, bytes]]) -> None:
        """Many at once cost half: (channel, sequence, log time, publish time, data) of each."""
        index, chunk, at, pack = self._index, self._chunk, self._chunk_size, _MESSAGE.pack
        for channel, sequence, log_time_ns, publish_ns, data in messages:
            size = _MESSAGE_FIELDS + len(data)
            index[channel] += (log_time_ns, at)
            chunk += (pack(MESSAGE, size, channel, sequence, log_time_ns, publish_ns), data)
            at += 9 + size
            if at >= self._chunk_bytes:
                self._close_chunk()
                chunk, at = self._chunk, 0
        self._chunk_size = at

    def flush(self) -> None:
        self._close_chunk()
        self._output.flush()

    def finish(self) -> None:
        """Everything that stands behind the data; what is left to the output is to keep it."""
        self._close_chunk()
        self._put(_record(DATA_END, struct.pack("<I", self._crc)))
        for opcode, record in self._descriptions:
            self._summary[opcode].append(record)
        self._summary[STATISTICS].append(_record(STATISTICS, self._statistics()))
        start = at = self._output.tell()
        summary, offsets = b"", b""
        for opcode in (SCHEMA, CHANNEL, STATISTICS, CHUNK_INDEX, ATTACHMENT_INDEX, METADATA_INDEX):
            if group := b"".join(self._summary[opcode]):
                offsets += _record(SUMMARY_OFFSET, struct.pack("<BQQ", opcode, at, len(group)))
                summary, at = summary + group, at + len(group)
        footer = _HEAD.pack(FOOTER, 20) + struct.pack("<QQ", start, at)
        crc = struct.pack("<I", zlib.crc32(summary + offsets + footer))
        self._output.write(summary + offsets + footer + crc + MAGIC)

    # ---- inside ----

    def _put(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._output.write(data)

    def _describe(self, opcode: int, body: bytes) -> None:
        record = _record(opcode, body)
        self._descriptions.append((opcode, record))
        self._chunk.append(record)
        self._chunk_size += len(record)

    def _close_chunk(self) -> None:
        if not self._index:  # descriptions alone make no chunk: they wait for the first message
            return
        inside, at = b"".join(self._chunk), self._output.tell()
        starts = [min(index[::2]) for index in self._index.values()]
        ends = [max(index[::2]) for index in self._index.values()]
        times = min(starts), max(ends)
        packed = self._compressor.compress(inside)
        sizes = struct.pack("<QQQI", *times, len(inside), zlib.crc32(inside)) + _text("zstd")
        chunk = _record(CHUNK, sizes + struct.pack("<Q", len(packed)) + packed)
        self._put(chunk)
        self._put_indexes(at, times, (len(packed), len(inside)), len(chunk))
        self._times = (
            times
            if self._times is None
            else (
                min(times[0], self._times[0]),
                max(times[1], self._times[1]),
            )
        )
        self._chunk, self._chunk_size = [], 0
        self._index.clear()

    def _put_indexes(self, at: int, times: tuple[int, int], sizes: tuple[int, int], length: int) -> None:
        """Message indexes behind the chunk at `at`, and its own entry in the summary."""
        records: list[bytes] = []
        where: list[int] = []  # channel, offset of its message index ...
        behind = at + length
        for channel, index in self._index.items():
            self._counts[channel] += len(index) // 2
            entries = array("Q", index).tobytes()
            size = len(entries)
            where += (channel, behind)
            records += (_INDEX.pack(MESSAGE_INDEX, 6 + size, channel, size), entries)
            behind += _INDEX.size + size
        self._put(b"".join(records))
        count = len(self._index)
        offsets = struct.pack("<I", 10 * count) + struct.pack("<" + count * "HQ", *where)
        entry = struct.pack("<QQQQ", *times, at, length) + offsets
        entry += struct.pack("<Q", behind - at - length) + _text("zstd") + struct.pack("<QQ", *sizes)
        self._summary[CHUNK_INDEX].append(_record(CHUNK_INDEX, entry))

    def _statistics(self) -> bytes:
        counts = b"".join(struct.pack("<HQ", *pair) for pair in sorted(self._counts.items()))
        first, last = self._times or (0, 0)
        return (
            struct.pack(
                "<QHIIIIQQI",
                sum(self._counts.values()),
                len(self._summary[SCHEMA]),
                len(self._summary[CHANNEL]),
                len(self._summary[ATTACHMENT_INDEX]),
                len(self._summary[METADATA_INDEX]),
                len(self._summary[CHUNK_INDEX]),
                first,
                last,
                len(counts),
            )
            + counts
        )


def _record(opcode: int, body: bytes) -> bytes:
    return _HEAD.pack(opcode, len(body)) + body


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def _pairs(pairs: Mapping[str, str]) -> bytes:
    data = b"".join(_text(key) + _text(value) for key, value in pairs.items())
    return struct.pack("<I", len(data)) + data
