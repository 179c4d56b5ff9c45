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


def header(kind: int, sequence: int = 0x010203, sealed: bool = False, sender: int = 3) -> air.Header:
    return air.Header(kind, sealed, 1, sender, 0x0A0B0C0D, sequence, 0x060504030201)


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
    """Five rows at N = 32, M = 30: 250 bytes with the tag."""
    rows = [
        air.RelayRow(
            *(7 * k, k * 60, k, 25 + k, 9, 8 * k, k % 2 == 0, k % 3 + 1, k > 0, k > 1),
            *(100 * k, -k, 0, 200, _costs(k)),
        )
        for k in range(4)
    ]
    idle = air.RelayRow(31, 255, 5, air.NO_SLOT, 0, 0, False, 0, True, True, 0, 0, 0, 0, _costs(31))
    return air.RelayFrame(32, 0x80402001, (*rows, idle))


def largest_relay() -> air.RelayFrame:
    """Two rows at N = 64, M = 80."""
    claim = (79, 65535, 255, True, 3, True, True, -32768, 32767, -1, 255)
    row = air.RelayRow(63, 255, 5, *claim, np.full(80, 255, U8))
    idle = (air.NO_SLOT, 0, 0, False, 0, False, False, 0, 0, 0, 0)
    return air.RelayFrame(64, 2**64 - 1, (row, air.RelayRow(0, 0, 0, *idle, np.zeros(80, U8))))


def smallest_relay() -> air.RelayFrame:
    idle = (air.NO_SLOT, 0, 0, False, 0, False, False, 0, 0, 0, 0)
    return air.RelayFrame(1, 0, (air.RelayRow(0, 1, 0, *idle, np.zeros(1, U8)),))


def _costs(k: int) -> np.ndarray:
    return (np.arange(30) * 8 + k).astype(U8)


def frames() -> dict[str, tuple[air.Header, codec.Frame]]:
    slots = (air.TaskSlot(0, 1, 0, 0, 0, 0), air.TaskSlot(79, 65535, 3, -32768, 32767, -1))
    many = tuple(air.TaskSlot(k, 100 + k, k % 4, 10 * k, -10 * k, k) for k in range(22))
    return {
        "state, smallest": (header(air.STATE, 0), small_state()),
        "state, usual": (header(air.STATE), usual_state()),
        "state, largest": (header(air.STATE, 2**24 - 1), largest_state()),
        "state, sealed": (header(air.STATE, sealed=True), usual_state()),
        "relay, five rows of thirty": (header(air.RELAY), relay()),
        "relay, two of the longest rows": (header(air.RELAY, sealed=True), largest_relay()),
        "relay, smallest": (header(air.RELAY), smallest_relay()),
        "tasks, two": (header(air.TASKS), air.TasksFrame(slots)),
        "tasks, most": (header(air.TASKS), air.TasksFrame(many)),
        "tasks of an operator": (header(air.TASKS, sender=air.OPERATOR), air.TasksFrame(slots)),
        "stop by an operator": (header(air.STOP, sender=air.OPERATOR), air.StopFrame(0x0102, 255, 1)),
        "stop by a robot's button": (header(air.STOP), air.StopFrame(0x0102, 3, 1)),
        "resume": (header(air.RESUME), air.StopFrame(65535, 63, 0)),
    }


def messages() -> dict[str, link.LinkMessage]:
    stop = codec.encode_frame(*frames()["stop by an operator"])
    longest = codec.encode_frame(*frames()["relay, five rows of thirty"])
    mac = bytes([0, 1, 2, 0, 254, 255])
    who, rounds = (3, 1, 6, 6), (100, 5)
    return {
        "hello": link.Hello(2, 3, 1, 6, *rounds),
        "hello of a listener": link.Hello(2, 255, 0, 1, 1000, 64),
        "send tasks": link.SendBody(air.TASKS, codec.encode_body(frames()["tasks, two"][1])),
        "send the largest state": link.SendBody(air.STATE, codec.encode_body(largest_state())),
        "provision with a key": link.Provision(2, *who, bytes(range(16)), 1_800_000_000),
        "provision, open": link.Provision(2, 255, 255, 14, 24, link.OPEN_KEY, 0),
        "raise a stop": link.Command(air.STOP, 0, 2),
        "resume": link.Command(air.RESUME, 0x0102, 0),
        "ask for peers": link.AskPeers(),
        "reply to hello": link.HelloReply(
            *(2, 2, 0xC0FFEE00, 12, 1, mac, *who, 33, *rounds, "hippomat 0.1.0", "0d8861ca")
        ),
        "status": link.Status(
            *(0xC0FFEE00, 12, 3, 2**40 + 5, 255, 1, 6, 12, 63, 200, 64, 2**41 + 6, 8, 7),
            *(2**63 + 1, 2, 4, 8, *range(1, 14), "hippomat 0.1.0", ""),
        ),
        "heard": link.Heard(2**33 + 1, 2**34 + 2, -71, stop),
        "heard, longest": link.Heard(2**64 - 1, 2**64 - 1, -128, longest),
        "sent": link.Sent(1234567, air.STATE, 0x010203, True),
        "given up": link.Sent(1234567, air.TASKS, 2**24 - 1, False),
        "provisioned": link.Provisioned(True, 0x0A0B0C0D),
        "not provisioned": link.Provisioned(False, 0),
        "peer": link.PeerReport(7, mac, 0x0A0B0C0D, 0x010203, -71, 40, 1234, 77, 1),
        "an operator's radio": link.PeerReport(255, mac, 1, 2**24 - 1, 127, 2**32 - 1, 1, 255, 7),
        "round": link.Round(77, 7_800_000, 2**33 + 1, 0b11111, True),
        "round heard alone": link.Round(2**32 - 1, 2**48, 0, 0, False),
    }


def refused() -> dict[str, bytes]:
    """Frames that differ from a good one in one thing that no encoder writes."""
    usual = codec.encode_frame(*frames()["state, usual"])
    row = codec.encode_frame(*frames()["relay, five rows of thirty"])

    def changed(data: bytes, at: int, value: int) -> bytes:
        return data[:at] + bytes([value]) + data[at + 1 :]

    return {
        "other version": changed(usual, 0, 0x11),
        "kind 0": changed(usual, 0, 0x20),
        "kind 6": changed(usual, 0, 0x26),
        "sealed, kind 7": changed(usual, 0, 0x2F),
        "state of an operator": changed(usual, 2, 255),
        "relay of an operator": changed(row, 2, 255),
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
        "relay without tasks": changed(row, 16, 0),
        "relay without robots": changed(row, 17, 0),
        "relay of 65 robots": changed(row, 17, 65),
        "relayed row of robot 32": changed(row, 22, 32),
        "relayed status 6": changed(row, 28, 0x31),
        "relayed claim beyond M": changed(row, 24, 30),
        "relayed claim without a tag": changed(row, 28, 1),
        "relayed row without a claim, but with an ETA": changed(row, 22 + 4 * 44 + 13, 1),
        "relayed row without a claim, but confirmed": changed(row, 22 + 4 * 44 + 6, 0xE9),
        "held beyond N": changed(codec.encode_frame(*frames()["relay, smallest"]), 18, 2),
        "relay with a part of a row": row[:-1],
        "relay one byte long": row + b"\0",
        "relay without rows": row[:22],
        "relay cut within held": row[:20],
        "empty relay": row[:16],
        "empty tasks": codec.encode_frame(*frames()["tasks, two"])[:16],
        "task state 4": changed(codec.encode_frame(*frames()["tasks, two"]), 19, 4),
        "stop of three bytes": codec.encode_frame(*frames()["resume"])[:-1],
    }


def refused_messages() -> dict[str, bytes]:
    """Payloads from a host that differ from a good one in one thing."""
    good = {name: link.encode_payload(message) for name, message in messages().items()}
    hello, keyed, opened = good["hello"], good["provision with a key"], good["provision, open"]
    stop = good["raise a stop"]

    def changed(data: bytes, at: int, value: int) -> bytes:
        return data[:at] + bytes([value]) + data[at + 1 :]

    return {
        "unknown type": b"\x06",
        "hello of link version 1": hello[:5],
        "hello of robot 64": changed(hello, 2, 64),
        "hello on channel 0": changed(hello, 4, 0),
        "hello on channel 15": changed(hello, 4, 15),
        "hello without slots": changed(hello, 7, 0),
        "hello with more slots than fit": changed(hello, 7, 33),
        "hello with rounds of 49 ms": changed(hello, 5, 49),
        "send a stop": changed(good["send tasks"], 1, air.STOP),
        "send a relay": changed(good["send tasks"], 1, air.RELAY),
        "send an empty body": good["send tasks"][:2],
        "send too long a body": good["send tasks"][:2] + bytes(227),
        "provision at 11 Mbit/s": changed(keyed, 5, 11),
        "provision with keyed = 2": changed(keyed, 6, 2),
        "provision open, but with a key": changed(keyed, 6, 0),
        "provision with a key of zeros": changed(opened, 6, 1),
        "provision one byte short": keyed[:-1],
        "stop with a counter": changed(stop, 2, 1),
        "command to send a state": changed(stop, 1, air.STATE),
        "ask for peers, and more": b"\x05\0",
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
        "refused_messages": {name: data.hex() for name, data in refused_messages().items()},
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
