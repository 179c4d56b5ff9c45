"""Logs whose every checksum is right and whose contents are not: what only a check of meaning can find.

Takes one of our own finished logs apart, changes a few bytes or facts inside, and puts it together again.
"""

from __future__ import annotations

import random
import struct
import zlib

import zstandard

from hippomat_logs.mcap_writer import CHUNK, DATA_END, FOOTER, MAGIC, MESSAGE, METADATA
from hippomat_logs.part import facts_crc32
from hippomat_logs.walk import FOOTER_BYTES, pairs_of, records, string_of

Parts = list[tuple[int, bytes]]  # (opcode, body) of records in file order
_CHUNK_HEAD = 16 + 8 + 4 + 4 + len("zstd")  # times, size, checksum, compression
_VALUES = ("", "-1", "x", "9" * 30, "no", "{}", "[]", "0", "1e9", "\u0663")
_ADDED = ("recovered", "clip", "selection", "compared_from", "part", "first_record")


class Crafter:
    """A log's records; each seed gives another log of them."""

    def __init__(self, log: bytes) -> None:
        footer = len(log) - len(MAGIC) - FOOTER_BYTES
        (summary,) = struct.unpack_from("<Q", log, footer + 9)
        self.data = _parts(log, len(MAGIC), summary - 9 - 4)
        self.summary = _parts(log, summary, footer)

    def crafted(self, seed: int) -> bytes:
        rng, data, summary = random.Random(seed), list(self.data), list(self.summary)
        if rng.random() < 0.1:
            at = rng.randrange(len(summary))
            summary[at] = summary[at][0], changed(summary[at][1], rng)
        else:
            at = rng.randrange(len(data))
            opcode, body = data[at]
            crafty = {CHUNK: _changed_chunk, METADATA: _changed_facts}.get(opcode, changed)
            new = opcode, (crafty if rng.random() < 0.8 else changed)(body, rng)
            alike = rng.random() < 0.7  # both copies of the manifest
            data = [new if k == at or (alike and one == data[at]) else one for k, one in enumerate(data)]
        return whole(data, summary)


def whole(data: Parts, summary: Parts) -> bytes:
    """A file of these records, with all its checksums."""
    front = MAGIC + _joined(data)
    front += _joined([(DATA_END, struct.pack("<I", zlib.crc32(front)))])
    back = _joined(summary)
    footer = struct.pack("<BQQQ", FOOTER, 20, len(front), len(front) + len(back))
    return front + back + footer + struct.pack("<I", zlib.crc32(back + footer)) + MAGIC


def chunk_of(body: bytes, inside: bytes, frame: bytes | None = None) -> bytes:
    """The chunk `body` with other contents; frame: what stands in the file for them."""
    frame = zstandard.ZstdCompressor().compress(inside) if frame is None else frame
    sizes = struct.pack("<QI", len(inside), zlib.crc32(inside))
    return body[:16] + sizes + body[28:_CHUNK_HEAD] + struct.pack("<Q", len(frame)) + frame


def inside_of(body: bytes) -> bytes:
    return zstandard.ZstdDecompressor().decompress(body[_CHUNK_HEAD + 8 :])


def changed(body: bytes, rng: random.Random) -> bytes:
    """Bytes overwritten, taken out or put in, mostly near the head."""
    new = bytearray(body)
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        if not new:
            break
        way, at = rng.random(), rng.randrange(min(len(new), rng.choice([40, 200, len(new)])))
        if way < 0.5:
            new[at] = rng.choice([0, 1, 0xFF, 0x7F, 0x80, rng.randrange(256)])
        elif way < 0.7:
            new[at : at + 4] = struct.pack("<I", rng.choice([0, 1, 0xFFFFFFFF, 0x7FFFFFFF]))
        elif way < 0.85:
            del new[at : at + rng.randrange(1, 20)]
        else:
            new[at:at] = rng.randbytes(rng.randrange(1, 9))
    return bytes(new)


def _changed_chunk(body: bytes, rng: random.Random) -> bytes:
    inside = inside_of(body)
    held = _parts(inside, 0, len(inside))
    at = rng.randrange(len(held))
    if rng.random() < 0.5:
        at = rng.choice([k for k, (opcode, _) in enumerate(held) if opcode == MESSAGE])
    opcode, record = held[at]
    way = rng.random()
    if way < 0.1:
        held[at] = rng.randrange(20), record
    elif way < 0.2:
        del held[at]
    elif way < 0.3:
        held.insert(rng.randrange(len(held)), held[at])
    else:
        held[at] = opcode, changed(record, rng)
    return chunk_of(body, _joined(held))


def _changed_facts(body: bytes, rng: random.Random) -> bytes:
    name, at = string_of(memoryview(body), 0)
    facts = pairs_of(memoryview(body), at)
    del facts["crc32"]
    key, way = rng.choice(list(facts)), rng.random()
    if way < 0.3:
        del facts[key]
    elif way < 0.9:
        facts[key] = rng.choice(_VALUES)
    else:
        facts[rng.choice(_ADDED)] = rng.choice(["yes", "7", "x"])
    facts["crc32"] = facts_crc32(facts)
    pairs = b"".join(_text(key) + _text(value) for key, value in facts.items())
    return _text(name) + struct.pack("<I", len(pairs)) + pairs


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def _parts(data: bytes, start: int, end: int) -> Parts:
    return [(opcode, bytes(body)) for opcode, body, _ in records(memoryview(data), start, end)]


def _joined(parts: Parts) -> bytes:
    return b"".join(struct.pack("<BQ", opcode, len(body)) + body for opcode, body in parts)
