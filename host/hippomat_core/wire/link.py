"""Messages on the USB link to bytes and back; each travels in one frame of cobs.py.

Strict like codec.py: every payload that decodes encodes to itself. Byte table:
esp32_firmware/lib/radio_core/README.md; the same rules in C: link.c. Knows no air frame's inside.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from hippomat_core.config import MAX_ROBOTS
from hippomat_core.errors import WireError
from hippomat_core.wire import cobs
from hippomat_core.wire import frames as air
from hippomat_core.wire.link_messages import (
    FIRMWARE_BYTES,
    FLAG_AGREED,
    FLAG_OPEN,
    FLAG_PASSIVE,
    FLAG_PROVISIONED,
    FLAG_STOPPED,
    FLAG_UNSAFE,
    GIT_HASH_BYTES,
    KEY_BYTES,
    LINK_VERSION,
    MAC_BYTES,
    MAX_CHANNEL,
    NO_ROBOT,
    OPEN_KEY,
    PEER_ALIVE,
    PEER_BABBLING,
    PEER_DUPLICATE,
    RATES_MBPS,
    AskPeers,
    Command,
    Heard,
    Hello,
    HelloReply,
    LinkMessage,
    PeerReport,
    Provision,
    Provisioned,
    Round,
    SendBody,
    Sent,
    Status,
)
from hippomat_core.wire.packing import pack, require, whole_number
from hippomat_core.wire.record_layout import RecordLayout

__all__ = [
    "FLAG_AGREED",
    "FLAG_OPEN",
    "FLAG_PASSIVE",
    "FLAG_PROVISIONED",
    "FLAG_STOPPED",
    "FLAG_UNSAFE",
    "HELLO_REPLY",
    "KEY_BYTES",
    "LINK_VERSION",
    "NO_ROBOT",
    "OPEN_KEY",
    "PEER_ALIVE",
    "PEER_BABBLING",
    "PEER_DUPLICATE",
    "RATES_MBPS",
    "STATUS",
    "AskPeers",
    "Command",
    "Heard",
    "Hello",
    "HelloReply",
    "LinkMessage",
    "PeerReport",
    "Provision",
    "Provisioned",
    "Round",
    "SendBody",
    "Sent",
    "Status",
    "check_identity",
    "decode_message",
    "encode_message",
    "encode_payload",
]

HELLO, SEND, PROVISION, COMMAND, ASK_PEERS = range(0x01, 0x06)
HELLO_REPLY, STATUS, HEARD, SENT, PROVISIONED, PEER, ROUND = range(0x81, 0x88)
ROUND_MIN_MS, ROUND_MAX_MS = 50, 1000  # these and the next as in schedule.h
PHASES, SLOT_MIN_US = 3, 1040

_KINDS: dict[int, type[LinkMessage]] = {
    HELLO: Hello,
    SEND: SendBody,
    PROVISION: Provision,
    COMMAND: Command,
    ASK_PEERS: AskPeers,
    HELLO_REPLY: HelloReply,
    STATUS: Status,
    HEARD: Heard,
    SENT: Sent,
    PROVISIONED: Provisioned,
    PEER: PeerReport,
    ROUND: Round,
}
_TYPES = {kind: number for number, kind in _KINDS.items()}
_SIZES = {"mac": MAC_BYTES, "firmware": FIRMWARE_BYTES, "git_hash": GIT_HASH_BYTES}
_LAYOUTS: dict[type, RecordLayout[Any]] = {
    kind: RecordLayout(kind, _SIZES)
    for kind in (Hello, Command, AskPeers, HelloReply, Status, Sent, Provisioned, PeerReport, Round)
}
_HEARD = struct.Struct("<QQb")
_PROVISION = struct.Struct("<BBBBBB")
_UNIX_S = struct.Struct("<I")
_PROVISION_BYTES = _PROVISION.size + KEY_BYTES + _UNIX_S.size
_ALL_FLAGS = FLAG_OPEN | FLAG_AGREED | FLAG_PASSIVE | FLAG_STOPPED | FLAG_UNSAFE | FLAG_PROVISIONED
_PEER_FLAGS = PEER_ALIVE | PEER_BABBLING | PEER_DUPLICATE


def encode_message(message: LinkMessage) -> bytes:
    """The message as it goes over the wire: framed, closing 0x00 included."""
    return cobs.encode(encode_payload(message))


def encode_payload(message: LinkMessage) -> bytes:
    """The message before framing: type byte and fields."""
    _check(message)
    start = bytes([_TYPES[type(message)]])
    return start + _fields_to_bytes(message)


def _fields_to_bytes(message: LinkMessage) -> bytes:
    if isinstance(message, SendBody):
        return bytes([message.kind]) + message.body
    if isinstance(message, Heard):
        times = {"radio_time_us": message.radio_time_us, "fleet_time_us": message.fleet_time_us}
        return pack(_HEARD, "Heard", **times, rssi_dbm=message.rssi_dbm) + message.frame
    if isinstance(message, Provision):
        return _encode_provision(message)
    return _LAYOUTS[type(message)].encode(message)


def decode_message(payload: bytes) -> LinkMessage:
    """The inverse of encode_payload, for payloads that FrameDecoder gave out."""
    if not payload:
        raise WireError("link payload of 0 bytes: a message begins with its type")
    kind = _KINDS.get(payload[0])
    if kind is None:
        kind_text = f"0x{payload[0]:02x}"
        raise WireError(f"link message type {kind_text} is unknown: host and radio speak different versions?")
    message = _DECODERS[kind](bytes(payload[1:]))
    _check(message)
    return message


def _decode_heard(rest: bytes) -> Heard:
    require(len(rest) >= _HEARD.size, "Heard length", len(rest), f"is less than {_HEARD.size}")
    radio_time_us, fleet_time_us, rssi_dbm = _HEARD.unpack_from(rest)
    return Heard(radio_time_us, fleet_time_us, rssi_dbm, rest[_HEARD.size :])


def _decode_send(rest: bytes) -> SendBody:
    require(len(rest) >= 1, "SendBody length", len(rest), "is less than 1")
    return SendBody(rest[0], rest[1:])


def _encode_provision(message: Provision) -> bytes:
    start = pack(
        _PROVISION,
        "Provision",
        link_version=message.link_version,
        robot=message.robot,
        fleet=message.fleet,
        channel=message.channel,
        rate_mbps=message.rate_mbps,
        keyed=int(message.key != OPEN_KEY),
    )
    key = message.key or bytes(KEY_BYTES)
    return start + key + pack(_UNIX_S, "Provision", unix_s=message.unix_s)


def _decode_provision(rest: bytes) -> Provision:
    require(len(rest) == _PROVISION_BYTES, "Provision length", len(rest), f"is not {_PROVISION_BYTES}")
    link_version, robot, fleet, channel, rate_mbps, keyed = _PROVISION.unpack_from(rest)
    key = rest[_PROVISION.size : -_UNIX_S.size]
    whole_number("Provision.keyed", keyed, 0, 1)
    require(keyed == 1 or not any(key), "Provision.key", "of an OPEN fleet", "is not 16 zeros")
    (unix_s,) = _UNIX_S.unpack_from(rest, _PROVISION.size + KEY_BYTES)
    return Provision(link_version, robot, fleet, channel, rate_mbps, key if keyed else OPEN_KEY, unix_s)


_DECODERS: dict[type, Callable[[bytes], LinkMessage]] = {
    **{kind: layout.decode for kind, layout in _LAYOUTS.items()},
    Heard: _decode_heard,
    SendBody: _decode_send,
    Provision: _decode_provision,
}


def check_identity(robot: int, channel: int) -> None:
    """A robot id, or 255 for a listener, and a Wi-Fi channel."""
    valid = robot == NO_ROBOT or 0 <= robot < MAX_ROBOTS
    require(valid, "robot", robot, f"is neither 0 .. {MAX_ROBOTS - 1} nor {NO_ROBOT} (listens only)")
    whole_number("channel", channel, 1, MAX_CHANNEL)


def check_schedule(round_ms: int, slots: int) -> None:
    """A round that has room for three phases of the shortest slots."""
    whole_number("round_ms", round_ms, ROUND_MIN_MS, ROUND_MAX_MS)
    room = min(MAX_ROBOTS, round_ms * 1000 // (PHASES * SLOT_MIN_US))
    rule = f"are outside 1 .. {room}, what a round of {round_ms} ms has room for"
    require(1 <= whole_number("slots", slots, 0, 255) <= room, "slots", slots, rule)


def check_key(key: bytes) -> None:
    """OPEN_KEY, or 16 bytes that are not all zero: nobody's key is, but an empty file's may be."""
    require(len(key) in (0, KEY_BYTES), "key length", len(key), f"is not {KEY_BYTES} (0: OPEN)")
    require(key == OPEN_KEY or any(key), "key", "of 16 zeros", "protects nothing: OPEN is an empty key")


def _check(message: LinkMessage) -> None:
    """The ranges that are narrower than the fields."""
    if isinstance(message, Heard):
        high = air.MAX_FRAME - air.TAG_BYTES
        _check_length("Heard.frame", message.frame, air.HEADER_BYTES, high)
    elif isinstance(message, SendBody):
        require(
            message.kind in (air.STATE, air.TASKS), "SendBody.kind", message.kind, "is not STATE or TASKS"
        )
        _check_length("SendBody.body", message.body, 1, air.MAX_BODY)
    elif isinstance(message, Sent):
        whole_number("Sent.kind", message.kind, air.STATE, air.RESUME)
        whole_number("Sent.sequence", message.sequence, 0, 2**24 - 1)
    elif isinstance(message, Command):
        _check_command(message)
    elif isinstance(message, PeerReport):
        who = message.robot
        require(who == air.OPERATOR or who < MAX_ROBOTS, "PeerReport.robot", who, "is no sender")
        whole_number("PeerReport.sequence", message.sequence, 0, 2**24 - 1)
        whole_number("PeerReport.flags", message.flags, 0, _PEER_FLAGS)
    elif isinstance(message, Hello | Provision | HelloReply | Status):
        _check_radio(message)


def _check_command(message: Command) -> None:
    known = message.kind in (air.STOP, air.RESUME)
    require(known, "Command.kind", message.kind, "is not STOP or RESUME")
    free = message.kind == air.RESUME or message.counter == 0
    require(free, "Command.counter", message.counter, "is not 0: a STOP's counter is the radio's choice")


def _check_radio(message: Hello | Provision | HelloReply | Status) -> None:
    check_identity(message.robot, message.channel)
    if isinstance(message, Provision):
        check_key(message.key)
    else:
        check_schedule(message.round_ms, message.slots)
    if not isinstance(message, Hello):
        require(
            message.rate_mbps in RATES_MBPS, "rate_mbps", message.rate_mbps, f"is not one of {RATES_MBPS}"
        )
    if isinstance(message, HelloReply | Status):
        whole_number("flags", message.flags, 0, _ALL_FLAGS)


def _check_length(field: str, data: bytes, low: int, high: int) -> None:
    require(low <= len(data) <= high, f"{field} length", len(data), f"is outside {low} .. {high}")
