"""The bodies of RELAY, TASKS, STOP and RESUME: bytes and back.

Byte tables: esp32_firmware/lib/radio_core/README.md; the same rules in C: body_relay.c, body_tasks.c and
body_stop.c there.
"""

from __future__ import annotations

import struct

import numpy as np

from hippomat_core.config import MAX_ROBOTS, MAX_TASK_SLOTS
from hippomat_core.wire import frames as air
from hippomat_core.wire.frames import RelayFrame, RelayRow, StopFrame, TasksFrame, TaskSlot
from hippomat_core.wire.packing import byte_array, pack, require, whole_number

RELAY_ROW_BYTES = 14  # without the costs
TASK_ROW_BYTES = 10
MAX_TASK_ROWS = air.MAX_BODY // TASK_ROW_BYTES

_RELAY_ROW = struct.Struct("<BBBHBBhhhB")
_TASK_ROW = struct.Struct("<BHBhhh")
_STOP = struct.Struct("<HBB")


def relay_room(n: int, m: int) -> int:
    """The most rows that one RELAY of a fleet of n robots and m task slots holds."""
    return (air.MAX_BODY - _rows_at(n)) // (RELAY_ROW_BYTES + m)


def encode_relay(frame: RelayFrame) -> bytes:
    require(len(frame.rows) > 0, "RELAY.rows", frame.rows, "is empty: send no frame instead")
    m = whole_number("RELAY.m", np.size(frame.rows[0].costs), 1, MAX_TASK_SLOTS)
    n = whole_number("RELAY.n", frame.n, 1, MAX_ROBOTS)
    held = whole_number("RELAY.held", frame.held, 0, 2**n - 1)
    rows_at = _rows_at(n)
    body = bytes([m, n]) + held.to_bytes(rows_at - 2, "little")
    body += b"".join(_encode_row(row, n, m) for row in frame.rows)
    room = relay_room(n, m)
    rule = f"are more than {room}, the most at N = {n}, M = {m}"
    require(len(frame.rows) <= room, "RELAY rows", len(frame.rows), rule)
    return body


def _rows_at(n: int) -> int:
    return 2 + -(-n // 8)


def _encode_row(row: RelayRow, n: int, m: int) -> bytes:
    _check_row(row, n, m)
    costs = byte_array("RELAY.costs", row.costs, (m, m), 255)
    bits = int(row.confirmed) | row.tag << 1 | row.status << 3
    head = pack(
        _RELAY_ROW,
        "RELAY",
        robot=row.robot,
        age=row.age,
        slot=row.slot,
        generation=row.generation,
        cost=row.cost,
        bits=bits | int(row.localized) << 6 | int(row.stopped) << 7,
        x_cm=row.x_cm,
        y_cm=row.y_cm,
        z_cm=row.z_cm,
        eta_s=row.eta_s,
    )
    return head + costs.tobytes()


def decode_relay(body: bytes) -> RelayFrame:
    require(2 <= len(body) <= air.MAX_BODY, "RELAY length", len(body), f"is outside 2 .. {air.MAX_BODY}")
    m = whole_number("RELAY.m", body[0], 1, MAX_TASK_SLOTS)
    n = whole_number("RELAY.n", body[1], 1, MAX_ROBOTS)
    rows_at, size = _rows_at(n), RELAY_ROW_BYTES + m
    count, rest = divmod(len(body) - rows_at, size)
    require(count > 0 and rest == 0, "RELAY length", len(body), f"is not {rows_at} + rows of {size}")
    held = int.from_bytes(body[2:rows_at], "little")
    require(held < 1 << n, "RELAY.held", held, f"names robots beyond N = {n}")
    return RelayFrame(n, held, tuple(_decode_row(body, at, n, m) for at in range(rows_at, len(body), size)))


def _decode_row(body: bytes, at: int, n: int, m: int) -> RelayRow:
    robot, age, slot, generation, cost, bits, x, y, z, eta = _RELAY_ROW.unpack_from(body, at)
    costs = np.frombuffer(body, np.uint8, m, at + RELAY_ROW_BYTES)
    status, localized, stopped = bits >> 3 & 7, bool(bits >> 6 & 1), bool(bits >> 7)
    claim = (slot, generation, cost, bool(bits & 1), bits >> 1 & 3)
    row = RelayRow(robot, age, status, *claim, localized, stopped, x, y, z, eta, costs)
    _check_row(row, n, m)
    return row


def _check_row(row: RelayRow, n: int, m: int) -> None:
    whole_number("RELAY.robot", row.robot, 0, n - 1)
    whole_number("RELAY.status", row.status, air.IDLE, air.LOST)
    for name in ("confirmed", "localized", "stopped"):
        require(getattr(row, name) in (False, True), f"RELAY.{name}", getattr(row, name), "is not a bool")
    if row.slot == air.NO_SLOT:
        claim = (row.generation, row.cost, row.confirmed, row.tag, row.x_cm, row.y_cm, row.z_cm, row.eta_s)
        require(not any(claim), "RELAY claim", claim, "has no slot: its other fields must be 0")
    else:
        whole_number("RELAY.slot", row.slot, 0, m - 1)
        whole_number("RELAY.tag", row.tag, 1, 3)


def encode_tasks(frame: TasksFrame) -> bytes:
    count = len(frame.slots)
    require(1 <= count <= MAX_TASK_ROWS, "TASKS slots", count, f"are outside 1 .. {MAX_TASK_ROWS}")
    return b"".join(_encode_slot(slot) for slot in frame.slots)


def _encode_slot(slot: TaskSlot) -> bytes:
    _check_slot(slot)
    return pack(
        _TASK_ROW,
        "TASKS",
        slot=slot.slot,
        generation=slot.generation,
        state=slot.state,
        x_cm=slot.x_cm,
        y_cm=slot.y_cm,
        z_cm=slot.z_cm,
    )


def decode_tasks(body: bytes) -> TasksFrame:
    count, rest = divmod(len(body), TASK_ROW_BYTES)
    fits = 1 <= count <= MAX_TASK_ROWS and rest == 0
    require(fits, "TASKS length", len(body), f"is not 1 .. {MAX_TASK_ROWS} rows of {TASK_ROW_BYTES}")
    slots = tuple(TaskSlot(*row) for row in _TASK_ROW.iter_unpack(body))
    for slot in slots:
        _check_slot(slot)
    return TasksFrame(slots)


def _check_slot(slot: TaskSlot) -> None:
    whole_number("TASKS.slot", slot.slot, 0, MAX_TASK_SLOTS - 1)
    whole_number("TASKS.state", slot.state, air.INACTIVE, air.DONE)


def encode_stop(frame: StopFrame) -> bytes:
    return pack(_STOP, "STOP", counter=frame.counter, origin=frame.origin, reason=frame.reason)


def decode_stop(body: bytes) -> StopFrame:
    require(len(body) == _STOP.size, "STOP length", len(body), f"is not {_STOP.size}")
    return StopFrame(*_STOP.unpack(body))
