"""Frames on the USB link: payload + CRC-32 (little-endian), COBS, 0x00 (Cheshire and Baker 1999).

Decides where a frame begins and ends and whether its bytes are intact; knows nothing of what they mean.
The same rules in C: esp32_firmware/lib/radio_core/cobs.c. Law: the bytes fed are the bytes of the frames
given out, plus skipped_bytes, plus the tail not yet ended by 0x00.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator

from hippomat_core.errors import WireError

MAX_PAYLOAD = 260  # the longest message: a heard air frame of 250 bytes with its radio time and RSSI
_MAX_PLAIN = MAX_PAYLOAD + 4
MAX_STUFFED = _MAX_PLAIN + 2  # one code byte per 254 bytes; without the closing 0x00


def encode(payload: bytes) -> bytes:
    """The payload as it goes over the wire, closing 0x00 included."""
    if len(payload) > MAX_PAYLOAD:
        raise WireError(f"payload of {len(payload)} bytes: a link frame holds at most {MAX_PAYLOAD}")
    return stuff(payload + zlib.crc32(payload).to_bytes(4, "little")) + b"\0"


def stuff(plain: bytes) -> bytes:
    """COBS of `plain`: the same bytes without any 0x00."""
    out = bytearray()
    pieces = plain.split(b"\0")
    for index, piece in enumerate(pieces):
        full = len(piece) // 254
        for start in range(0, full * 254, 254):
            out.append(255)
            out += piece[start : start + 254]
        rest = piece[full * 254 :]
        # A last piece that ends with a full block needs no empty block behind it.
        if rest or not full or index < len(pieces) - 1:
            out.append(len(rest) + 1)
            out += rest
    return bytes(out)


def unstuff(stuffed: bytes) -> bytes | None:
    """The inverse of stuff(); None for anything that stuff() does not produce."""
    out = bytearray()
    at, end, code = 0, len(stuffed), 0
    while at < end:
        previous, code = code, stuffed[at]
        if code == 0 or at + code > end:
            return None
        if previous not in (0, 255):
            out.append(0)
        block = stuffed[at + 1 : at + code]
        if 0 in block:
            return None
        out += block
        at += code
        if at == end and code == 1 and previous == 255:
            return None  # the empty block that stuff() leaves out
    return bytes(out) if end else None


class FrameDecoder:
    """Bytes in any chunks -> payloads. A fresh decoder is in sync: the first byte may begin a frame."""

    def __init__(self) -> None:
        self.skipped_bytes = 0  # noise, broken frames and lone delimiters
        self.bad_checksums = 0
        self._held = bytearray()
        self._overlong = False

    def feed(self, chunk: bytes) -> Iterator[bytes]:
        """The payloads completed by this chunk. All bytes are taken, consumed or not."""
        payloads: list[bytes] = []
        *ended, tail = bytes(chunk).split(b"\0")
        for piece in ended:
            self._hold(piece)
            payload = self._end()
            if payload is not None:
                payloads.append(payload)
        self._hold(tail)
        return iter(payloads)

    def _hold(self, piece: bytes) -> None:
        if self._overlong:
            self.skipped_bytes += len(piece)
            return
        self._held += piece
        if len(self._held) > MAX_STUFFED:
            self.skipped_bytes += len(self._held)
            self._held.clear()
            self._overlong = True

    def _end(self) -> bytes | None:
        stuffed, overlong = bytes(self._held), self._overlong
        self._held.clear()
        self._overlong = False
        plain = None if overlong else unstuff(stuffed)
        if plain is not None and 4 <= len(plain) <= _MAX_PLAIN:
            if zlib.crc32(plain[:-4]) == int.from_bytes(plain[-4:], "little"):
                return plain[:-4]
            self.bad_checksums += 1
        self.skipped_bytes += len(stuffed) + 1
        return None
