"""A fleet with a key on a desk: sealed frames of its senders, and what a receiver should count of a frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from radio_desk import mac_of

from hippomat_core.wire import codec
from hippomat_core.wire import frames as air
from hippomat_sim.radio.cipher import AesCcm

KEY = bytes.fromhex("0f1e2d3c4b5a69788796a5b4c3d2e1f0")
FLEET = 7
WINDOW = 64
CIPHER = AesCcm()


def sealed_frame(
    sender: int,
    boot: int,
    sequence: int,
    body: Any,
    *,
    mac: bytes | None = None,
    key: bytes = KEY,
    fleet: int = FLEET,
    time_us: int = 0,
    kind: int = 0,
) -> bytes:
    """As the radio of that MAC (the sender's own where none is named) puts it on the air."""
    header = air.Header(kind or codec.kind_of(body), True, fleet, sender, boot, sequence, time_us)
    head = codec.encode_header(header)
    nonce = (mac or mac_of(sender)) + boot.to_bytes(4, "little") + sequence.to_bytes(3, "little")
    return head + CIPHER.seal(key, nonce, head, codec.encode_body(body))


@dataclass(slots=True)
class Sender:
    """What a receiver has heard of one radio, in its present boot."""

    mac: bytes
    boot: int
    highest: int = 0
    heard: set[int] = field(default_factory=set)

    def hear(self, sequence: int) -> None:
        self.highest = max(self.highest, sequence)
        self.heard.add(sequence)

    def is_old(self, boot: int, sequence: int) -> bool:
        if boot != self.boot:
            return boot < self.boot
        return sequence in self.heard or sequence <= self.highest - WINDOW


@dataclass(slots=True)
class Receiver:
    """The rules of a receiver with a key, told in another way than in C: why a frame that is not genuine is
    dropped. senders: those alive, by id and MAC."""

    senders: dict[tuple[int, bytes], Sender]

    def cause(self, mac: bytes, frame: bytes) -> str:
        """The counter's name, for a frame that carries no right tag or was heard before."""
        if len(frame) >= 2 and (frame[0] >> 4 != air.PROTOCOL_VERSION or frame[1] != FLEET):
            return "dropped_foreign"
        if not 16 <= len(frame) <= air.MAX_FRAME or not _may_send(frame[0] & 7, frame[2]):
            return "dropped_malformed"
        if not frame[0] & 8:
            return "dropped_seal"
        sender = self.senders.get((frame[2], mac))
        boot, sequence = int.from_bytes(frame[3:7], "little"), int.from_bytes(frame[7:10], "little")
        if sender is not None and sender.is_old(boot, sequence):
            return "dropped_replayed"
        return "dropped_forged"


def _may_send(kind: int, sender: int) -> bool:
    if sender == air.OPERATOR:
        return kind in (air.TASKS, air.STOP, air.RESUME)
    return sender < 64 and air.STATE <= kind <= air.RESUME
