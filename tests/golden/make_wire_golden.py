"""Writes wire.json beside this file: examples of every air frame and USB message with their bytes.

It also lists frames that must be refused. Run `python tests/golden/make_wire_golden.py` after a deliberate
change of the wire, which also bumps PROTOCOL_VERSION or LINK_VERSION; the diff shows what changed.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np

from hippomat_core.wire import cobs, codec, link
from hippomat_core.wire import frames as air

PATH = Path(__file__).with_name("wire.json")
U8 = np.uint8


def header(kind: int, sequence: int = 0x010203) -> air.Header:
    return air.Header(kind, 1, 3, 0x0A0B0C0D, sequence, 0x060504030201)


def small_state() -> air.StateFrame:
    one, none = np.array([7], U8), np.zeros(0, U8)
    return air.StateFrame(0, 2, 0, 0, 0, 0, 0, air.NO_CLAIM, one, one & 1, 0, 0, 0, none, 0, one & 0, 0, 0, 0)


def usual_state() -> air.StateFrame:
    """Five robots, twelve tasks, a confirmed claim."""
    claim = air.AirClaim(11, 300, 40, 1000, True, 2, -250, 175, 0, 123)
    costs = np.array([0, 1, 40, 80, 120, 160, 200, 240, 253, 254, 255, 40], U8)
    states = np.arange(12, dtype=U8) % 4
    steps = np.array([13, 14, 22, 0, 26], U8)
    endorsed = np.array([0, 1, 2, 3, 0], U8)
    return air.StateFrame(
        *(1, 6, 120, -340, 5, 64, 10, claim, costs, states, 513, 66, 1, steps),
        *(0b10110, endorsed, 0xDEADBEEF, 0x01020304, 9),
    )


def largest_state() -> air.StateFrame:
    claim = air.AirClaim(79, 65535, 255, 65535, True, 3, -32768, 32767, -1, 65535)
    return air.StateFrame(
        *(5, 31, -32768, 32767, -1, 255, 255, claim, np.full(80, 255, U8), np.full(80, 3, U8)),
        *(65535, 65535, 255, np.full(12, 26, U8), 2**64 - 1, np.full(64, 3, U8), 2**32 - 1, 2**32 - 1, 65535),
    )


def relay() -> air.RelayFrame:
    """Five rows at M = 30: 250 bytes with the tag."""
    rows = [
        air.RelayRow(k, k * 60, k, 25 + k, 9, 8 * k, k % 2 == 0, k % 3 + 1, k, -k, 0, 200, 77, _costs(k))
        for k in range(4)
    ]
    idle = air.RelayRow(63, 255, 5, air.NO_SLOT, 0, 0, False, 0, 1, 2, 3, 0, 4, _costs(63))
    return air.RelayFrame((*rows, idle))


def _costs(k: int) -> np.ndarray:
    return (np.arange(30) * 8 + k).astype(U8)


def frames() -> dict[str, tuple[air.Header, codec.Frame]]:
    slots = (air.TaskSlot(0, 1, 0, 0, 0, 0), air.TaskSlot(79, 65535, 3, -32768, 32767, -1))
    many = tuple(air.TaskSlot(k, 100 + k, k % 4, 10 * k, -10 * k, k) for k in range(22))
    return {
        "state, smallest": (header(air.STATE, 0), small_state()),
        "state, usual": (header(air.STATE), usual_state()),
        "state, largest": (header(air.STATE, 2**24 - 1), largest_state()),
        "relay, five rows of thirty": (header(air.RELAY), relay()),
        "tasks, two": (header(air.TASKS), air.TasksFrame(slots)),
        "tasks, most": (header(air.TASKS), air.TasksFrame(many)),
        "stop by the operator": (header(air.STOP), air.StopFrame(0x0102, 255, 1)),
        "resume": (header(air.RESUME), air.StopFrame(65535, 63, 0)),
    }


def messages() -> dict[str, link.LinkMessage]:
    stop = codec.encode_frame(*frames()["stop by the operator"])
    reply = link.HelloReply(
        *(1, 1, 0xC0FFEE00, 12, 1, bytes([0, 1, 2, 0, 254, 255]), 3, 1, 6, "hippomat 0.1.0", "0d8861ca")
    )
    return {
        "hello": link.Hello(1, 3, 1, 6),
        "hello of a listener": link.Hello(1, 255, 0, 1),
        "send a stop": link.SendBody(air.STOP, stop[16:]),
        "send the largest state": link.SendBody(air.STATE, codec.encode_body(largest_state())),
        "reply to hello": reply,
        "status": link.Status(0xC0FFEE00, 12, 3, 2**40 + 5, 255, 1, 6, 3, *range(1, 9)),
        "heard": link.Heard(2**33 + 1, -71, stop),
        "sent": link.Sent(1234567, air.STATE, 0x010203, True),
        "given up": link.Sent(1234567, air.TASKS, 2**24 - 1, False),
    }


def refused() -> dict[str, bytes]:
    """Frames that differ from a good one in one thing that no encoder writes."""
    usual = codec.encode_frame(*frames()["state, usual"])
    row = codec.encode_frame(*frames()["relay, five rows of thirty"])

    def changed(data: bytes, at: int, value: int) -> bytes:
        return data[:at] + bytes([value]) + data[at + 1 :]

    return {
        "other version": changed(usual, 0, 0x21),
        "unknown kind": changed(usual, 0, 0x16),
        "sender 64": changed(usual, 2, 64),
        "one byte short": usual[:-1],
        "one byte long": usual + b"\0",
        "header alone": usual[:16],
        "status 6": changed(usual, 16, 6),
        "unknown flag": changed(usual, 17, 32),
        "claim beyond M": changed(usual, 26, 12),
        "no claim, but a generation": changed(usual, 26, 255),
        "claim without a tag": changed(usual, 32, 1),
        "unused claim bit": changed(usual, 32, 0x0D),
        "no robots": changed(usual, 41, 0),
        "no tasks": changed(usual, 42, 0),
        "move 27": changed(usual, 63, 27),
        "thirteen steps": changed(usual, 70, 0xD0),
        "a step beyond the count": changed(usual, 69, 1),
        "heard beyond N": changed(usual, 71, 0x20),
        "endorsed beyond N": changed(usual, 73, 4),
        "relay of robot 64": changed(row, 17, 64),
        "relay with a part of a row": row[:-1],
        "empty relay": row[:17],
        "empty tasks": codec.encode_frame(*frames()["tasks, two"])[:16],
        "task state 4": changed(codec.encode_frame(*frames()["tasks, two"]), 19, 4),
        "stop of three bytes": codec.encode_frame(*frames()["resume"])[:-1],
    }


def plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    if dataclasses.is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    return value


def document() -> dict[str, Any]:
    return {
        "protocol_version": air.PROTOCOL_VERSION,
        "link_version": link.LINK_VERSION,
        "frames": {
            name: {
                "header": plain(head),
                "frame": plain(frame),
                "bytes": codec.encode_frame(head, frame).hex(),
            }
            for name, (head, frame) in frames().items()
        },
        "messages": {
            name: {
                "type": type(message).__name__,
                "message": plain(message),
                "payload": link.encode_payload(message).hex(),
                "framed": link.encode_message(message).hex(),
            }
            for name, message in messages().items()
        },
        "cobs": {data.hex(): cobs.stuff(data).hex() for data in COBS},
        "refused": {name: data.hex() for name, data in refused().items()},
    }


COBS = (
    *(b"\0", b"\0\0", b"\x11\x22\0\x33", b"\x11\0\0\0", bytes(range(1, 255)), bytes(range(255))),
    *(bytes(range(1, 256)), bytes([*range(2, 256), 0]), bytes([*range(3, 256), 0, 1])),
)


def text() -> str:
    """One line a leaf, so that a diff shows which field or bytes changed."""
    return json.dumps(document(), indent=1, sort_keys=False) + "\n"


if __name__ == "__main__":
    PATH.write_text(text())
    print(f"wrote {PATH}")
