"""Radios on a desk, driven by hand: hosts, frames and time as the tests want them."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from hippomat_core.wire import cobs, codec, link
from hippomat_core.wire import frames as air
from hippomat_sim.radio import Memory, Radio

MAC = bytes([0x10, 0x20, 0x30, 0x40, 0x50, 0x60])
LISTENED_US = 300_000  # three rounds of 100 ms
LOOK_US = 100  # how finely `until_sent` looks


def mac_of(robot: int) -> bytes:
    return bytes([0x02, 0, 0, 0, 0, robot])


def a_radio(robot: int = 3, *, boot_kept: bool = True, sequence: int = 0, **memory: Any) -> Radio:
    kept = Memory(robot=robot, boot_counter=memory.pop("boot_counter", 7), **memory)
    return Radio(MAC, 0xC0FFEE, kept, boot_kept=boot_kept, sequence=sequence)


def a_state(
    x_cm: int = 0,
    *,
    n: int = 5,
    m: int = 4,
    stop: tuple[bool, int] = (False, 0),
    heard: int = 0,
    digest: int = 0xF1EE7,
) -> Any:
    flags = air.FLAG_LOCALIZED | (air.FLAG_STOPPED if stop[0] else 0)
    costs = (np.arange(m) + x_cm % 100).astype(np.uint8)
    nothing = np.zeros(0, np.uint8)
    return air.StateFrame(
        *(air.IDLE, flags, x_cm, 0, 0, 0, 0, air.NO_CLAIM, costs, np.ones(m, np.uint8), 0, 0, 0, nothing),
        *(heard, np.zeros(n, np.uint8), digest, 2, stop[1]),
    )


def frame_of(
    sender: int, sequence: int, body: Any, *, kind: int = 0, boot: int = 1, fleet: int = 1, time_us: int = 0
) -> bytes:
    header = air.Header(kind or codec.kind_of(body), False, fleet, sender, boot, sequence, time_us)
    return codec.encode_frame(header, body)


def stop_frame(
    sender: int, boot: int, sequence: int, *, counter: int = 1, fleet: int = 1, resume: bool = False
) -> bytes:
    kind = air.RESUME if resume else air.STOP
    return frame_of(sender, sequence, air.StopFrame(counter, 255, 0), kind=kind, boot=boot, fleet=fleet)


def hear(radio: Radio, now_us: int, frame: bytes, mac: bytes | None = None) -> None:
    """The frame, from the MAC that belongs to its sender or from another."""
    radio.air_rx(now_us, -50, mac_of(frame[2]) if mac is None else mac, frame)


def send(radio: Radio, body: Any, now_us: int = LISTENED_US) -> None:
    message = link.SendBody(codec.kind_of(body), codec.encode_body(body))
    radio.usb_rx(now_us, link.encode_message(message))


def messages(radio: Radio, *kinds: type) -> list[Any]:
    """All that waits for the host, or those of some types."""
    decoder = cobs.FrameDecoder()
    found = [link.decode_message(payload) for payload in decoder.feed(radio.usb_tx())]
    assert decoder.skipped_bytes == 0
    return [message for message in found if not kinds or isinstance(message, kinds)]


@dataclasses.dataclass(slots=True)
class Sent:
    at_us: int
    header: air.Header
    body: Any


def sent_until(radio: Radio, from_us: int, until_us: int, *, done: bool = True) -> list[Sent]:
    """What the radio puts on the air, looked at as its own wake-ups say."""
    found = []
    now_us = from_us
    while now_us <= until_us:
        radio.tick(now_us)
        frame = radio.air_tx(now_us)
        if frame is not None:
            found.append(Sent(now_us, *codec.decode_frame(frame)))
            if done:
                radio.air_done(now_us, True)
        now_us = max(radio.next_us(now_us), now_us + 1)
    return found
