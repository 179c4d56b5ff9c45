"""Air frames to bytes and back. Byte tables: esp32_firmware/lib/radio_core/README.md.

Strict in both directions: what a frame cannot mean is refused with WireError, and every byte string that
decodes encodes to itself. Accepts exactly what rc_frame_valid() in radio_core accepts. Bodies are plain,
also in a frame whose header says sealed: the radio has opened it and taken its tag off. Knows no link, no
clock, no key and no fleet.
"""

from __future__ import annotations

import struct
from typing import TypeAlias

from hippomat_core.config import MAX_ROBOTS
from hippomat_core.errors import WireError
from hippomat_core.wire import frames as air
from hippomat_core.wire.frames import (
    HEADER_BYTES,
    OPERATOR,
    Header,
    RelayFrame,
    StateFrame,
    StopFrame,
    TasksFrame,
)
from hippomat_core.wire.other_bodies import (
    decode_relay,
    decode_stop,
    decode_tasks,
    encode_relay,
    encode_stop,
    encode_tasks,
)
from hippomat_core.wire.packing import pack, require, whole_number
from hippomat_core.wire.state_body import decode_state, encode_state

Frame: TypeAlias = StateFrame | RelayFrame | TasksFrame | StopFrame

_HEADER = struct.Struct("<BBBI")
_SEALED = 8  # bit of byte 0
_KINDS: dict[type, int] = {
    StateFrame: air.STATE,
    RelayFrame: air.RELAY,
    TasksFrame: air.TASKS,
    StopFrame: air.STOP,
}


def kind_of(frame: Frame) -> int:
    """The kind a frame travels as; StopFrame is STOP unless a header says RESUME."""
    if type(frame) not in _KINDS:
        raise WireError(f"{frame!r} is no air frame")
    return _KINDS[type(frame)]


def encode_frame(header: Header, frame: Frame) -> bytes:
    """Header and plain body: a whole frame in an OPEN fleet; in a sealed one the radio encrypts the body."""
    kind = kind_of(frame)
    fits = header.kind == kind or (kind == air.STOP and header.kind == air.RESUME)
    require(fits, "Header.kind", header.kind, f"does not go with a {type(frame).__name__}")
    return encode_header(header) + encode_body(frame)


def decode_frame(data: bytes) -> tuple[Header, Frame]:
    """The inverse of encode_frame."""
    header = decode_header(data)
    return header, decode_body(header.kind, data[HEADER_BYTES:])


def encode_header(header: Header) -> bytes:
    _check_sender(header.kind, header.sender)
    require(header.sealed in (False, True), "Header.sealed", header.sealed, "is not a bool")
    sequence = whole_number("Header.sequence", header.sequence, 0, 2**24 - 1)
    fleet_time = whole_number("Header.fleet_time_us", header.fleet_time_us, 0, 2**48 - 1)
    first = air.PROTOCOL_VERSION << 4 | header.kind | (_SEALED if header.sealed else 0)
    start = pack(_HEADER, "Header", first=first, fleet=header.fleet, sender=header.sender, boot=header.boot)
    return start + sequence.to_bytes(3, "little") + fleet_time.to_bytes(6, "little")


def decode_header(data: bytes) -> Header:
    """The first 16 bytes of a frame."""
    if len(data) < HEADER_BYTES:
        raise WireError(f"frame of {len(data)} bytes: a header alone has {HEADER_BYTES}")
    first, fleet, sender, boot = _HEADER.unpack_from(data)
    version, sealed, kind = first >> 4, bool(first & _SEALED), first & 7
    require(version == air.PROTOCOL_VERSION, "version", version, f"is not {air.PROTOCOL_VERSION}")
    _check_sender(kind, sender)
    sequence = int.from_bytes(data[7:10], "little")
    return Header(kind, sealed, fleet, sender, boot, sequence, int.from_bytes(data[10:16], "little"))


def _check_sender(kind: int, sender: int) -> None:
    whole_number("Header.kind", kind, air.STATE, air.RESUME)
    if sender == OPERATOR:
        sends = kind in (air.TASKS, air.STOP, air.RESUME)
        require(sends, "Header.kind", kind, "is not sent by an operator: TASKS, STOP and RESUME only")
    else:
        whole_number("Header.sender", sender, 0, MAX_ROBOTS - 1)


def encode_body(frame: Frame) -> bytes:
    """The bytes behind the header: what a host gives to its radio."""
    if isinstance(frame, StateFrame):
        return encode_state(frame)
    if isinstance(frame, RelayFrame):
        return encode_relay(frame)
    if isinstance(frame, TasksFrame):
        return encode_tasks(frame)
    return encode_stop(frame)


def decode_body(kind: int, body: bytes) -> Frame:
    """The inverse of encode_body; the kind is the header's."""
    if kind == air.STATE:
        return decode_state(body)
    if kind == air.RELAY:
        return decode_relay(body)
    if kind == air.TASKS:
        return decode_tasks(body)
    if kind in (air.STOP, air.RESUME):
        return decode_stop(body)
    raise WireError(f"kind = {kind} is no air frame (known: 1 .. 5)")
