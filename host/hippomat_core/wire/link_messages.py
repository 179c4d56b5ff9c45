"""Messages on the USB link between a host and its radio, as values. Byte table:
esp32_firmware/lib/radio_core/README.md.

A message's fields are its bytes in this order, each as wide as its annotation says. Knows no bytes;
wire/link.py encodes and decodes them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

from hippomat_core.fields import I8, U8, U16, U32, U64

LINK_VERSION = 2
NO_ROBOT = 255  # an identity that listens; sends only what an operator may: TASKS, STOP, RESUME
MAX_CHANNEL = 14  # 2.4 GHz
RATES_MBPS = (6, 12, 24)  # OFDM
MAC_BYTES, KEY_BYTES, FIRMWARE_BYTES, GIT_HASH_BYTES = 6, 16, 16, 8
OPEN_KEY = b""  # no fleet key: frames are neither encrypted nor authenticated

# Status.flags and HelloReply.flags
FLAG_OPEN = 1  # no fleet key
FLAG_AGREED = 2  # fleet time is agreed with somebody
FLAG_PASSIVE = 4  # another radio sends under our id: sends nothing but STOP and RESUME
FLAG_STOPPED = 8  # a STOP is latched
FLAG_UNSAFE = 16  # the boot counter could not be stored: a radio with a key stays silent
FLAG_PROVISIONED = 32  # identity was provisioned or adopted and is stored

# PeerReport.flags
PEER_ALIVE, PEER_BABBLING, PEER_DUPLICATE = 1, 2, 4


@dataclass(frozen=True, slots=True)
class Hello:
    """Host -> radio: who the host takes itself for (robot 255: it only listens) and its fleet's rounds."""

    link_version: U8
    robot: U8
    fleet: U8
    channel: U8
    round_ms: U16
    slots: U8  # roster size


@dataclass(frozen=True, slots=True)
class SendBody:
    """Host -> radio: put this body on the air; STATE or TASKS. The radio writes the header."""

    kind: U8
    body: bytes


@dataclass(frozen=True, slots=True)
class Provision:
    """Host -> radio, at a desk: what it shall be. The radio stores it, answers Provisioned, and restarts.

    key: 16 bytes, or OPEN_KEY. unix_s: now; seeds the boot counter.
    """

    link_version: U8
    robot: U8
    fleet: U8
    channel: U8
    rate_mbps: U8
    key: bytes = field(repr=False)
    unix_s: U32


@dataclass(frozen=True, slots=True)
class Command:
    """Host -> radio. STOP: raise one, counter 0 (the radio chooses it). RESUME: lift that STOP."""

    kind: U8
    counter: U16
    reason: U8


@dataclass(frozen=True, slots=True)
class AskPeers:
    """Host -> radio: answer with one PeerReport for each sender heard since boot."""


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
    rate_mbps: U8
    flags: U16
    round_ms: U16
    slots: U8
    firmware: str  # at most 16 printable ASCII characters
    git_hash: str  # at most 8


@dataclass(frozen=True, slots=True)
class Status:
    """Radio -> host, 1 Hz; the fields of messages.RadioStatus without the stamp, explained there."""

    boot_id: U32
    boot_counter: U32
    reset_reason: U8
    uptime_us: U64
    robot: U8
    fleet: U8
    channel: U8
    rate_mbps: U8
    flags: U16
    round_ms: U16
    slots: U8
    fleet_time_us: U64
    stop_counter: U16
    stop_resumed: U16
    alive: U64
    rebooted: U64
    babbling: U64
    duplicate: U64
    sent: U32
    received: U32
    relays: U32
    replaced: U32
    send_failed: U32
    dropped_foreign: U32
    dropped_malformed: U32
    dropped_seal: U32
    dropped_forged: U32
    dropped_replayed: U32
    dropped_impostor: U32
    dropped_babble: U32
    dropped_usb: U32
    firmware: str
    git_hash: str


@dataclass(frozen=True, slots=True)
class Heard:
    """Radio -> host: a frame from the air, header and plain body, when and how loud it was heard."""

    radio_time_us: U64
    fleet_time_us: U64  # the receiver's fleet clock
    rssi_dbm: I8
    frame: bytes


@dataclass(frozen=True, slots=True)
class Sent:
    """Radio -> host: one of our frames left (sent) or was given up (not sent)."""

    radio_time_us: U64
    kind: U8
    sequence: U32
    sent: bool


@dataclass(frozen=True, slots=True)
class Provisioned:
    """Radio -> host: whether the provisioning is stored; boot_counter: of the boot that follows."""

    stored: bool
    boot_counter: U32


@dataclass(frozen=True, slots=True)
class PeerReport:
    """Radio -> host, one for each sender heard since boot. robot 255: an operator's."""

    robot: U8
    mac: bytes  # 6 B
    boot: U32
    sequence: U32
    rssi_dbm: I8
    age_ms: U32
    received: U32
    loss: U8  # of the link from it to us, 1/255
    flags: U8


@dataclass(frozen=True, slots=True)
class Round:
    """Radio -> host: the last slot of a round is over, what was heard in it was handed on. Decide now."""

    round: U32
    fleet_time_us: U64
    radio_time_us: U64
    held: U64  # bit k: row k of this round was heard, relayed ones and our own included
    agreed: bool  # fleet time is


LinkMessage: TypeAlias = (
    Hello
    | SendBody
    | Provision
    | Command
    | AskPeers
    | HelloReply
    | Status
    | Heard
    | Sent
    | Provisioned
    | PeerReport
    | Round
)
