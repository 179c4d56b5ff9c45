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

HEADER_BYTES = 16
MAX_BODY = air.MAX_FRAME - HEADER_BYTES - air.TAG_BYTES
RELAY_ROW_BYTES = 15  # without the costs
TASK_ROW_BYTES = 10
MAX_TASK_ROWS = MAX_BODY // TASK_ROW_BYTES

_RELAY_ROW = struct.Struct("<BBBHBBhhhBB")
_TASK_ROW = struct.Struct("<BHBhhh")
_STOP = struct.Struct("<HBB")


def encode_relay(frame: RelayFrame) -> bytes:
    require(len(frame.rows) > 0, "RELAY.rows", frame.rows, "is empty: send no frame instead")
    m = np.size(frame.rows[0].costs)
    body = bytes([whole_number("RELAY.m", m, 1, MAX_TASK_SLOTS)])
    body += b"".join(_encode_row(row, m) for row in frame.rows)
    room = (MAX_BODY - 1) // (RELAY_ROW_BYTES + m)
    require(
        len(body) <= MAX_BODY, "RELAY rows", len(frame.rows), f"are more than {room}, the most at M = {m}"
    )
    return body


def _encode_row(row: RelayRow, m: int) -> bytes:
    _check_row(row, m)
    costs = byte_array("RELAY.costs", row.costs, (m, m), 255)
    head = pack(
        _RELAY_ROW,
        "RELAY",
        robot=row.robot,
        age=row.age,
        slot=row.slot,
        generation=row.generation,
        cost=row.cost,
        tag=int(row.confirmed) | row.tag << 1 | row.status << 3,
        x_cm=row.x_cm,
        y_cm=row.y_cm,
        z_cm=row.z_cm,
        eta_s=row.eta_s,
        round_low=row.round_low,
    )
    return head + costs.tobytes()


def decode_relay(body: bytes) -> RelayFrame:
    require(1 <= len(body) <= MAX_BODY, "RELAY length", len(body), f"is outside 1 .. {MAX_BODY}")
    m = whole_number("RELAY.m", body[0], 1, MAX_TASK_SLOTS)
    size = RELAY_ROW_BYTES + m
    count, rest = divmod(len(body) - 1, size)
    require(count > 0 and rest == 0, "RELAY length", len(body), f"is not 1 + rows of {size}")
    rows = []
    for at in range(1, len(body), size):
        robot, age, slot, generation, cost, tag, x, y, z, eta, low = _RELAY_ROW.unpack_from(body, at)
        costs = np.frombuffer(body, np.uint8, m, at + RELAY_ROW_BYTES)
        confirmed, claim_tag, status = bool(tag & 1), tag >> 1 & 3, tag >> 3
        claim = (slot, generation, cost, confirmed, claim_tag)
        row = RelayRow(robot, age, status, *claim, x, y, z, eta, low, costs)
        _check_row(row, m)
        rows.append(row)
    return RelayFrame(tuple(rows))


def _check_row(row: RelayRow, m: int) -> None:
    whole_number("RELAY.robot", row.robot, 0, MAX_ROBOTS - 1)
    whole_number("RELAY.status", row.status, air.IDLE, air.LOST)
    require(row.confirmed in (False, True), "RELAY.confirmed", row.confirmed, "is not a bool")
    if row.slot == air.NO_SLOT:
        claim = (row.generation, row.cost, int(row.confirmed), row.tag)
        require(claim == (0, 0, 0, 0), "RELAY claim", claim, "has no slot: its other fields must be 0")
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
