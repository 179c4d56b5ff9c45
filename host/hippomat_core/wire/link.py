"""Messages on the USB link between a host and its radio, as values; each travels in one frame of cobs.py.

Strict like codec.py: every payload that decodes encodes to itself. Byte table:
esp32_firmware/lib/radio_core/README.md; the same rules in C: link.c. Knows no air frame's inside.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TypeAlias

from hippomat_core.config import MAX_ROBOTS
from hippomat_core.errors import WireError
from hippomat_core.fields import I8, U8, U32, U64
from hippomat_core.wire import cobs
from hippomat_core.wire.frames import MAX_FRAME, RESUME, STATE
from hippomat_core.wire.other_bodies import HEADER_BYTES, MAX_BODY
from hippomat_core.wire.packing import pack, require, whole_number

LINK_VERSION = 1
NO_ROBOT = 255  # an identity that listens only
MAX_CHANNEL = 14  # 2.4 GHz

HELLO, SEND = 0x01, 0x02
HELLO_REPLY, STATUS, HEARD, SENT = 0x81, 0x82, 0x83, 0x84


@dataclass(frozen=True, slots=True)
class Hello:
    """Host -> radio: who the host takes itself for; robot 255: the host only listens."""

    link_version: U8
    robot: U8
    fleet: U8
    channel: U8


@dataclass(frozen=True, slots=True)
class SendBody:
    """Host -> radio: put this body on the air; the radio writes the header."""

    kind: U8
    body: bytes


@dataclass(frozen=True, slots=True)
class HelloReply:
    """Radio -> host: what the radio is. Its identity wins; the host checks."""

    link_version: U8
    protocol_version: U8
    boot_id: U32  # random, new at each boot
    boot_counter: U32  # kept over boots, travels in every header
    reset_reason: U8  # esp_reset_reason()
    mac: bytes  # 6 B
    robot: U8
    fleet: U8
    channel: U8
    firmware: str  # at most 16 printable ASCII characters
    git_hash: str  # at most 8


@dataclass(frozen=True, slots=True)
class Status:
    """Radio -> host, 1 Hz; the fields of messages.RadioStatus without the stamp."""

    boot_id: U32
    boot_counter: U32
    reset_reason: U8
    uptime_us: U64
    robot: U8
    fleet: U8
    channel: U8
    flags: U8
    sent: U32
    received: U32
    replaced: U32
    send_failed: U32
    dropped_foreign: U32
    dropped_malformed: U32
    dropped_duplicate: U32
    dropped_usb: U32


@dataclass(frozen=True, slots=True)
class Heard:
    """Radio -> host: a frame from the air, whole, when and how loud it was heard."""

    radio_time_us: U64
    rssi_dbm: I8
    frame: bytes


@dataclass(frozen=True, slots=True)
class Sent:
    """Radio -> host: one of our frames left (sent) or was given up (not sent)."""

    radio_time_us: U64
    kind: U8
    sequence: U32
    sent: bool


LinkMessage: TypeAlias = Hello | SendBody | HelloReply | Status | Heard | Sent

_HELLO = struct.Struct("<BBBB")
_REPLY_HEAD = struct.Struct("<BBIIB")
_REPLY_IDENTITY = struct.Struct("<BBB")
_STATUS = struct.Struct("<IIBQBBBBIIIIIIII")
_HEARD = struct.Struct("<Qb")
_SENT = struct.Struct("<QBIB")
_REPLY_BYTES = _REPLY_HEAD.size + 6 + _REPLY_IDENTITY.size + 16 + 8
_STATUS_FIELDS = tuple(Status.__dataclass_fields__)


def encode_message(message: LinkMessage) -> bytes:
    """The message as it goes over the wire: framed, closing 0x00 included."""
    return cobs.encode(encode_payload(message))


def encode_payload(message: LinkMessage) -> bytes:
    """The message before framing: type byte and fields."""
    if isinstance(message, Hello):
        check_identity(message.robot, message.channel)
        fields = (message.link_version, message.robot, message.fleet, message.channel)
        names = ("link_version", "robot", "fleet", "channel")
        return bytes([HELLO]) + pack(_HELLO, "Hello", **dict(zip(names, fields, strict=True)))
    if isinstance(message, SendBody):
        kind = whole_number("SendBody.kind", message.kind, STATE, RESUME)
        return bytes([SEND, kind]) + _bounded("SendBody.body", message.body, 1, MAX_BODY)
    if isinstance(message, HelloReply):
        return bytes([HELLO_REPLY]) + _encode_reply(message)
    if isinstance(message, Status):
        check_identity(message.robot, message.channel)
        values = {name: getattr(message, name) for name in _STATUS_FIELDS}
        return bytes([STATUS]) + pack(_STATUS, "Status", **values)
    if isinstance(message, Heard):
        head = pack(_HEARD, "Heard", radio_time_us=message.radio_time_us, rssi_dbm=message.rssi_dbm)
        return bytes([HEARD]) + head + _bounded("Heard.frame", message.frame, HEADER_BYTES, MAX_FRAME)
    _check_sent(message.kind, message.sequence, message.sent)
    fields_ = {"radio_time_us": message.radio_time_us, "kind": message.kind, "sequence": message.sequence}
    return bytes([SENT]) + pack(_SENT, "Sent", **fields_, sent=int(message.sent))


def decode_message(payload: bytes) -> LinkMessage:
    """The inverse of encode_payload, for payloads that FrameDecoder gave out."""
    if not payload:
        raise WireError("link payload of 0 bytes: a message begins with its type")
    kind, rest = payload[0], payload[1:]
    if kind == HELLO:
        link_version, robot, fleet, channel = _exact("Hello", _HELLO, rest)
        check_identity(robot, channel)
        return Hello(link_version, robot, fleet, channel)
    if kind == SEND:
        _bounded("SendBody body", rest[1:], 1, MAX_BODY)
        return SendBody(whole_number("SendBody.kind", rest[0], STATE, RESUME), rest[1:])
    if kind == HELLO_REPLY:
        return _decode_reply(rest)
    if kind == STATUS:
        status = Status(*_exact("Status", _STATUS, rest))
        check_identity(status.robot, status.channel)
        return status
    if kind == HEARD:
        frame = _bounded("Heard.frame", rest[_HEARD.size :], HEADER_BYTES, MAX_FRAME)
        radio_time_us, rssi_dbm = _HEARD.unpack_from(rest)
        return Heard(radio_time_us, rssi_dbm, frame)
    if kind == SENT:
        radio_time_us, frame_kind, sequence, sent = _exact("Sent", _SENT, rest)
        _check_sent(frame_kind, sequence, sent)
        return Sent(radio_time_us, frame_kind, sequence, bool(sent))
    raise WireError(f"link message type 0x{kind:02x} is unknown: host and radio speak different versions?")


def check_identity(robot: int, channel: int) -> None:
    """A robot id, or 255 for a listener, and a Wi-Fi channel."""
    valid = robot == NO_ROBOT or 0 <= robot < MAX_ROBOTS
    require(valid, "robot", robot, f"is neither 0 .. {MAX_ROBOTS - 1} nor {NO_ROBOT} (listens only)")
    whole_number("channel", channel, 1, MAX_CHANNEL)


def _check_sent(kind: int, sequence: int, sent: int) -> None:
    whole_number("Sent.kind", kind, STATE, RESUME)
    whole_number("Sent.sequence", sequence, 0, 2**24 - 1)
    require(sent in (0, 1), "Sent.sent", sent, "is not 0 or 1")


def _encode_reply(reply: HelloReply) -> bytes:
    check_identity(reply.robot, reply.channel)
    head = pack(
        _REPLY_HEAD,
        "HelloReply",
        link_version=reply.link_version,
        protocol_version=reply.protocol_version,
        boot_id=reply.boot_id,
        boot_counter=reply.boot_counter,
        reset_reason=reply.reset_reason,
    )
    identity = {"robot": reply.robot, "fleet": reply.fleet, "channel": reply.channel}
    return b"".join(
        (
            head,
            _bounded("HelloReply.mac", reply.mac, 6, 6),
            pack(_REPLY_IDENTITY, "HelloReply", **identity),
            _encode_text("HelloReply.firmware", reply.firmware, 16),
            _encode_text("HelloReply.git_hash", reply.git_hash, 8),
        )
    )


def _decode_reply(data: bytes) -> HelloReply:
    require(len(data) == _REPLY_BYTES, "HelloReply length", len(data), f"is not {_REPLY_BYTES}")
    mac_at = _REPLY_HEAD.size
    robot, fleet, channel = _REPLY_IDENTITY.unpack_from(data, mac_at + 6)
    check_identity(robot, channel)
    firmware = _decode_text("HelloReply.firmware", data[-24:-8])
    git_hash = _decode_text("HelloReply.git_hash", data[-8:])
    mac = data[mac_at : mac_at + 6]
    link, protocol, boot_id, boot_counter, reason = _REPLY_HEAD.unpack_from(data)
    return HelloReply(
        link, protocol, boot_id, boot_counter, reason, mac, robot, fleet, channel, firmware, git_hash
    )


def _encode_text(field: str, text: str, size: int) -> bytes:
    fits = len(text) <= size and all(" " <= character <= "~" for character in text)
    require(fits, field, text, f"is not at most {size} printable ASCII characters")
    return text.encode().ljust(size, b"\0")


def _decode_text(field: str, data: bytes) -> str:
    text = data.rstrip(b"\0")
    require(all(32 <= byte <= 126 for byte in text), field, data, "is not printable ASCII, zeros behind")
    return text.decode()


def _exact(what: str, layout: struct.Struct, data: bytes) -> tuple[int, ...]:
    require(len(data) == layout.size, f"{what} length", len(data), f"is not {layout.size}")
    return layout.unpack(data)


def _bounded(field: str, data: bytes, low: int, high: int) -> bytes:
    fits = low <= len(data) <= high
    require(fits, f"{field} length", len(data), f"is outside {low} .. {high}")
    return bytes(data)
