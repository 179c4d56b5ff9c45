"""The body of STATE: bytes and back. Byte table: esp32_firmware/lib/radio_core/README.md.

Decides what a STATE may say; the same rules in C: esp32_firmware/lib/radio_core/body_state.c.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import MAX_ROBOTS, MAX_TASK_SLOTS
from hippomat_core.wire import frames as air
from hippomat_core.wire.frames import AirClaim, StateFrame
from hippomat_core.wire.packing import (
    byte_array,
    frozen,
    pack,
    pack_crumbs,
    require,
    unpack_crumbs,
    whole_number,
)

MAX_MOVE = 26

_ALL_FLAGS = (
    air.FLAG_STOPPED | air.FLAG_LOCALIZED | air.FLAG_GUARD | air.FLAG_BATTERY_LOW | air.FLAG_SATURATED
)
_HEAD = struct.Struct("<BBhhhBB")
_CLAIM = struct.Struct("<BHBHBhhhH")
_SIZES = struct.Struct("<BB")
_INTENT = struct.Struct("<HHBQ")
_END = struct.Struct("<IIH")
_FIXED = _HEAD.size + _CLAIM.size + _SIZES.size + _INTENT.size + _END.size


def encode_state(frame: StateFrame) -> bytes:
    costs = byte_array("STATE.costs", frame.costs, (1, MAX_TASK_SLOTS), 255)
    m = costs.size
    states = byte_array("STATE.task_states", frame.task_states, (m, m), 3)
    steps = byte_array("STATE.intent_steps", frame.intent_steps, (0, air.MAX_INTENT_STEPS), MAX_MOVE)
    endorsed = byte_array("STATE.endorsed", frame.endorsed, (1, MAX_ROBOTS), 3)
    n = endorsed.size
    heard = whole_number("STATE.heard", frame.heard, 0, 2**n - 1)
    whole_number("STATE.status", frame.status, air.IDLE, air.LOST)
    whole_number("STATE.flags", frame.flags, 0, _ALL_FLAGS)
    packed_steps = steps.size << 60
    for index, step in enumerate(steps.tolist()):
        packed_steps |= step << 5 * index
    return b"".join(
        (
            pack(
                _HEAD,
                "STATE",
                status=frame.status,
                flags=frame.flags,
                x_cm=frame.x_cm,
                y_cm=frame.y_cm,
                z_cm=frame.z_cm,
                yaw_256=frame.yaw_256,
                speed_2cmps=frame.speed_2cmps,
            ),
            _encode_claim(frame.claim, m),
            _SIZES.pack(n, m),
            costs.tobytes(),
            pack_crumbs(states),
            pack(
                _INTENT,
                "STATE",
                intent_ix=frame.intent_ix,
                intent_iy=frame.intent_iy,
                intent_iz=frame.intent_iz,
                intent_steps=packed_steps,
            ),
            heard.to_bytes(_bytes_for(n), "little"),
            pack_crumbs(endorsed),
            pack(
                _END,
                "STATE",
                fleet_digest=frame.fleet_digest,
                generations_digest=frame.generations_digest,
                stop_counter=frame.stop_counter,
            ),
        )
    )


def decode_state(body: bytes) -> StateFrame:
    sizes_at = _HEAD.size + _CLAIM.size
    require(len(body) >= _FIXED, "STATE length", len(body), f"is less than {_FIXED}")
    n, m = _SIZES.unpack_from(body, sizes_at)
    whole_number("STATE.n", n, 1, MAX_ROBOTS)
    whole_number("STATE.m", m, 1, MAX_TASK_SLOTS)
    expected = _FIXED + m + _bytes_for(2 * m) + _bytes_for(n) + _bytes_for(2 * n)
    require(len(body) == expected, "STATE length", len(body), f"is not {expected} as for N = {n}, M = {m}")
    status, flags, x, y, z, yaw, speed = _HEAD.unpack_from(body)
    whole_number("STATE.status", status, air.IDLE, air.LOST)
    whole_number("STATE.flags", flags, 0, _ALL_FLAGS)
    costs_at = sizes_at + _SIZES.size
    states_at = costs_at + m
    intent_at = states_at + _bytes_for(2 * m)
    heard_at = intent_at + _INTENT.size
    endorsed_at = heard_at + _bytes_for(n)
    end_at = endorsed_at + _bytes_for(2 * n)
    ix, iy, iz, packed_steps = _INTENT.unpack_from(body, intent_at)
    heard = int.from_bytes(body[heard_at:endorsed_at], "little")
    require(heard < 1 << n, "STATE.heard", heard, f"names robots beyond N = {n}")
    return StateFrame(
        status,
        flags,
        x,
        y,
        z,
        yaw,
        speed,
        _decode_claim(body[_HEAD.size : sizes_at], m),
        np.frombuffer(body, np.uint8, m, costs_at),
        unpack_crumbs("STATE.task_states", body[states_at:intent_at], m),
        ix,
        iy,
        iz,
        _decode_steps(packed_steps),
        heard,
        unpack_crumbs("STATE.endorsed", body[endorsed_at:end_at], n),
        *_END.unpack_from(body, end_at),
    )


def _encode_claim(claim: AirClaim, m: int) -> bytes:
    _check_claim(claim, m)
    return pack(
        _CLAIM,
        "STATE.claim",
        slot=claim.slot,
        generation=claim.generation,
        cost=claim.cost,
        round=claim.round,
        tag=int(claim.confirmed) | claim.tag << 1,
        x_cm=claim.x_cm,
        y_cm=claim.y_cm,
        z_cm=claim.z_cm,
        eta_ds=claim.eta_ds,
    )


def _decode_claim(data: bytes, m: int) -> AirClaim:
    slot, generation, cost, round_, tag, x, y, z, eta = _CLAIM.unpack(data)
    claim = AirClaim(slot, generation, cost, round_, bool(tag & 1), tag >> 1, x, y, z, eta)
    _check_claim(claim, m)
    return claim


def _check_claim(claim: AirClaim, m: int) -> None:
    require(claim.confirmed in (False, True), "STATE.claim.confirmed", claim.confirmed, "is not a bool")
    if claim.slot == air.NO_SLOT:
        require(claim == air.NO_CLAIM, "STATE.claim", claim, "has no slot: its other fields must be 0")
    else:
        whole_number("STATE.claim.slot", claim.slot, 0, m - 1)
        whole_number("STATE.claim.tag", claim.tag, 1, 3)


def _decode_steps(packed: int) -> NDArray[np.uint8]:
    count = packed >> 60
    whole_number("STATE.intent_steps count", count, 0, air.MAX_INTENT_STEPS)
    steps = packed & (1 << 60) - 1
    require(steps < 1 << 5 * count, "STATE.intent_steps", hex(packed), "has unused bits set")
    values = [steps >> 5 * index & 31 for index in range(count)]
    return frozen(byte_array("STATE.intent_steps", values, (count, count), MAX_MOVE))


def _bytes_for(bits: int) -> int:
    return -(-bits // 8)
