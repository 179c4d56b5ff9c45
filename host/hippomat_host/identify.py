"""What is behind a serial port? Listen first, then ask, each in the device's own protocol.

Pure: bytes and stamps in, bytes to write out; a shell (ports.py, links.py) reads and writes the port. A base
speaks by itself, a radio answers Hello, a lidar answers GET_INFO. Nothing is written while listening, and
what follows the identifying bytes belongs to the running phase. A base and a lidar speak 115200 baud, a radio
behind a UART bridge 921600; the shell sets the speed that is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

from hippomat_core.errors import WireError
from hippomat_core.messages import BASE, LIDAR, PORT_NAMES, RADIO
from hippomat_core.wire import jetbot_base, rplidar
from hippomat_core.wire.cobs import FrameDecoder
from hippomat_core.wire.frames import PROTOCOL_VERSION
from hippomat_core.wire.link import (
    HELLO_REPLY,
    LINK_VERSION,
    NO_ROBOT,
    STATUS,
    Hello,
    HelloReply,
    decode_message,
    encode_message,
)
from hippomat_host.radio_words import firmware, who
from hippomat_host.serial_port import BAUD, RADIO_BAUD

LISTEN_NS = 400_000_000
ANSWER_NS = 250_000_000
HELLO_TRIES = 3
INFO_TRIES = 2
BASE_NS = 150_000_000  # a base speaks every 20 ms
STOP_NS = 20_000_000  # a lidar needs a moment between STOP and the next request
UNKNOWN = 255

# Asks who a radio is and sets nothing: a radio answers a Hello of any link version, and obeys its own only.
ASK = Hello(0, NO_ROBOT, 0, 1, 100, 1)

_INFO_BYTES = len(rplidar.INFO_DESCRIPTOR) + rplidar.INFO_SIZE


@dataclass(frozen=True, slots=True)
class Identity:
    """What was found: messages.RADIO, BASE, LIDAR, or UNKNOWN; `text` is what it said of itself."""

    port: int
    text: str
    reply: HelloReply | None = None  # of a radio that speaks our link version
    mismatch: str = ""  # of a radio that does not: what it speaks

    @property
    def name(self) -> str:
        return "unknown" if self.port == UNKNOWN else PORT_NAMES[self.port]


class Identifier:
    """One attempt to identify. Call poll() when due_ns is reached and feed() with what was read.

    `baud` is the speed that the port has to have, from the start and before what poll() returns is written.
    """

    def __init__(self, now_ns: int, hello: Hello, expected: int, listen_ns: int = LISTEN_NS) -> None:
        """expected: the port asked for, or UNKNOWN; what should be there is asked first, in its own speed."""
        self.identity: Identity | None = None
        self.leftover = b""  # bytes read behind the identifying ones
        self.due_ns = now_ns + listen_ns
        self.baud = RADIO_BAUD if expected == RADIO else BAUD
        self._script = _script(hello, expected)
        self._heard = 0
        self._base = jetbot_base.Decoder()
        self._frames = FrameDecoder()
        self._tail = b""

    def poll(self, now_ns: int) -> bytes:
        """What to write now; sets `identity` to UNKNOWN when nothing is left to try."""
        if self.identity is not None or now_ns < self.due_ns:
            return b""
        if not self._script:
            text = f"{self._heard} bytes that no radio, base or lidar sends" if self._heard else "silent"
            self.identity = Identity(UNKNOWN, text)
            return b""
        self.baud, data, wait_ns = self._script.pop(0)
        self.due_ns = now_ns + wait_ns
        return data

    def feed(self, chunk: bytes) -> int:
        """Bytes from the device; returns how many of them belong to the identification."""
        for at in range(len(chunk)):
            self._feed_byte(chunk[at : at + 1])
            if self.identity is not None:
                self.leftover = chunk[at + 1 :]
                return at + 1
        return len(chunk)

    def _feed_byte(self, byte: bytes) -> None:
        self._heard += 1
        for frame in self._base.feed(byte):
            if frame.type == jetbot_base.FEEDBACK:
                self.identity = Identity(BASE, "JetBot ROS AI kit")
        for payload in self._frames.feed(byte):
            self.identity = _radio_identity(payload) or self.identity
        self._tail = (self._tail + byte)[-_INFO_BYTES:]
        if self._tail.startswith(rplidar.INFO_DESCRIPTOR):
            info = rplidar.find_info(self._tail)
            self.identity = Identity(LIDAR, str(info)) if info is not None else self.identity


def _script(hello: Hello, expected: int) -> list[tuple[int, bytes, int]]:
    """Speed, what is written, and how long an answer may take."""
    asked = b"\0" + encode_message(hello)  # 0x00 ends whatever came before
    radio = [(BAUD, asked, ANSWER_NS)] * HELLO_TRIES
    fast = [(RADIO_BAUD, asked, ANSWER_NS)] * HELLO_TRIES
    info = [(BAUD, rplidar.request(rplidar.GET_INFO), ANSWER_NS)] * INFO_TRIES
    lidar = [(BAUD, rplidar.request(rplidar.STOP), STOP_NS), *info]
    if expected == RADIO:
        return [*fast, (BAUD, b"", BASE_NS), *lidar]
    return [*lidar, *radio, *fast] if expected == LIDAR else [*radio, *lidar, *fast]


def _radio_identity(payload: bytes) -> Identity | None:
    if payload[:1] == bytes([STATUS]):
        return _older_radio(payload)
    if len(payload) < 3 or payload[0] != HELLO_REPLY:
        return None
    link_version, protocol = payload[1], payload[2]
    if (link_version, protocol) != (LINK_VERSION, PROTOCOL_VERSION):
        spoken = f"protocol {protocol} (link {link_version})"
        return Identity(RADIO, f"radio with {spoken}", mismatch=spoken)
    try:
        reply = decode_message(payload)
    except WireError:
        return None
    if not isinstance(reply, HelloReply):
        return None
    return Identity(RADIO, f"{firmware(reply)}, {who(reply)}, MAC {reply.mac.hex(':')}", reply)


def _older_radio(status: bytes) -> Identity | None:
    """A radio of link version 1 does not understand our Hello, but tells its status."""
    try:
        decode_message(status)
    except WireError:
        spoken = "another link version"
        return Identity(RADIO, f"radio with {spoken}", mismatch=spoken)
    return None
