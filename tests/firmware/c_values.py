"""Air frames between Python values and the structs of frame.h, field by field."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from hippomat_core.wire import frames as air
from hippomat_sim.radio import load_library

RADIO = load_library()
ffi, lib = RADIO.ffi, RADIO.lib


def exactly(data: bytes) -> Any:
    """A C buffer of exactly these bytes, so that a sanitizer sees one read too many."""
    return ffi.new("uint8_t[]", list(data))


def call(function: Any, value: Any) -> bytes | None:
    """What an encoder of frame.h writes for a struct; None when it refuses."""
    out = ffi.new("uint8_t[]", lib.RC_MAX_BODY)
    size = function(value, out)
    return bytes(ffi.buffer(out, size)) if size else None


def c_header(header: air.Header) -> Any:
    return ffi.new("rc_header *", dataclasses.asdict(header))


def c_body(frame: Any) -> tuple[Any, Any]:
    """The struct for a frame, and the encoder that takes it."""
    if isinstance(frame, air.StateFrame):
        return ffi.new("rc_state *", _state(frame)), lib.rc_state_encode
    if isinstance(frame, air.RelayFrame):
        m = len(frame.rows[0].costs) if frame.rows else 0
        rows = [_scalars(row) | {"costs": row.costs.tolist()} for row in frame.rows]
        relay = {"n": frame.n, "m": m, "count": len(rows), "held": frame.held, "rows": rows}
        return ffi.new("rc_relay *", relay), lib.rc_relay_encode
    if isinstance(frame, air.TasksFrame):
        slots = [_scalars(slot) for slot in frame.slots]
        return ffi.new("rc_tasks *", {"count": len(slots), "slots": slots}), lib.rc_tasks_encode
    return ffi.new("rc_stop *", _scalars(frame)), lib.rc_stop_encode


def c_encode(header: air.Header, frame: Any) -> bytes | None:
    """The whole frame as the C encoders write it; None when one refuses."""
    struct, encode = c_body(frame)
    head, body = call(lib.rc_header_encode, c_header(header)), call(encode, struct)
    return None if head is None or body is None else head + body


def c_decode(data: bytes) -> tuple[air.Header, Any] | None:
    """The whole frame as the C decoders read it; None when one refuses."""
    raw = exactly(data)
    header = ffi.new("rc_header *")
    if not lib.rc_header_decode(raw, len(data), header):
        return None
    # A copy of its own: reading behind or before the body must not go unseen.
    body = data[lib.RC_HEADER_BYTES :]
    frame = _c_decode_body(header.kind, exactly(body), len(body))
    return None if frame is None else (_value(air.Header, header), frame)


def _c_decode_body(kind: int, raw: Any, size: int) -> Any:
    if kind == air.STATE:
        state = ffi.new("rc_state *")
        return _state_value(state) if lib.rc_state_decode(raw, size, state) else None
    if kind == air.RELAY:
        relay = ffi.new("rc_relay *")
        if not lib.rc_relay_decode(raw, size, relay):
            return None
        rows = tuple(_value(air.RelayRow, row, costs=relay.m) for row in relay.rows[0 : relay.count])
        return air.RelayFrame(relay.n, relay.held, rows)
    if kind == air.TASKS:
        tasks = ffi.new("rc_tasks *")
        if not lib.rc_tasks_decode(raw, size, tasks):
            return None
        return air.TasksFrame(tuple(_value(air.TaskSlot, slot) for slot in tasks.slots[0 : tasks.count]))
    stop = ffi.new("rc_stop *")
    return _value(air.StopFrame, stop) if lib.rc_stop_decode(raw, size, stop) else None


def _scalars(value: Any) -> dict[str, Any]:
    names = (field.name for field in dataclasses.fields(value))
    return {name: getattr(value, name) for name in names if name != "costs"}


def _state(frame: air.StateFrame) -> dict[str, Any]:
    fields = {field.name: getattr(frame, field.name) for field in dataclasses.fields(frame)}
    for name in ("costs", "task_states", "intent_steps", "endorsed"):
        fields[name] = fields[name].tolist()
    fields["claim"] = dataclasses.asdict(frame.claim)
    sizes = {"n": len(frame.endorsed), "m": len(frame.costs), "intent_count": len(frame.intent_steps)}
    return fields | sizes


def _state_value(state: Any) -> air.StateFrame:
    sizes = {"costs": state.m, "task_states": state.m, "endorsed": state.n}
    sizes["intent_steps"] = state.intent_count
    return _value(air.StateFrame, state, **sizes)


def _value(kind: Any, struct: Any, **sizes: int) -> Any:
    """A Python value from the struct's fields of the same names; sizes: how long its arrays are."""
    values: dict[str, Any] = {}
    for field in dataclasses.fields(kind):
        raw = getattr(struct, field.name)
        if field.name in sizes:
            raw = np.array(list(raw[0 : sizes[field.name]]), np.uint8)
        elif field.name == "claim":
            raw = _value(air.AirClaim, raw)
        elif field.type == "bool":
            raw = bool(raw)
        values[field.name] = raw
    return kind(**values)
