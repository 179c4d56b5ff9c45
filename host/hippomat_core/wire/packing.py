"""Checked packing of integers and small bit fields, little-endian, lowest bits first.

Every value that does not fit raises WireError with the field's name, the value and the range. Knows no frame.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import WireError

RANGES = {
    "B": (0, 2**8 - 1),
    "b": (-(2**7), 2**7 - 1),
    "H": (0, 2**16 - 1),
    "h": (-(2**15), 2**15 - 1),
    "I": (0, 2**32 - 1),
    "Q": (0, 2**64 - 1),
}
_CRUMBS = np.array([0, 2, 4, 6], np.uint8)


def require(ok: bool, field: str, value: object, rule: str) -> None:
    """WireError "<field> = <value> <rule>" unless ok."""
    if not ok:
        raise WireError(f"{field} = {value!r} {rule}")


def pack(layout: struct.Struct, what: str, **fields: int) -> bytes:
    """layout.pack of the fields in order; `what` names the frame in errors."""
    try:
        return layout.pack(*fields.values())
    except (struct.error, TypeError):
        for code, (name, value) in zip(layout.format[1:], fields.items(), strict=True):
            whole_number(f"{what}.{name}", value, *RANGES[code])
        raise


def whole_number(field: str, value: Any, low: int, high: int) -> int:
    """The value as an int in low..high."""
    if not hasattr(value, "__index__"):
        raise WireError(f"{field} = {value!r} must be a whole number")
    number = int(value.__index__())
    require(low <= number <= high, field, number, f"is outside {low} .. {high}")
    return number


def byte_array(field: str, values: Any, count: tuple[int, int], high: int) -> NDArray[np.uint8]:
    """The values, each 0..high and count[0]..count[1] of them, as a uint8 array."""
    array = np.asarray(values)
    if array.ndim != 1 or not count[0] <= array.size <= count[1]:
        raise WireError(f"{field} has shape {array.shape}: it must hold {count[0]} .. {count[1]} values")
    if array.size == 0:
        return np.zeros(0, np.uint8)
    if array.dtype.kind not in "ui":
        raise WireError(f"{field} is of type {array.dtype}: it must hold whole numbers")
    wrong = np.flatnonzero((array < 0) | (array > high))
    if wrong.size:
        index = int(wrong[0])
        raise WireError(f"{field}[{index}] = {int(array[index])} is outside 0 .. {high}")
    return array.astype(np.uint8, copy=False)


def pack_crumbs(values: NDArray[np.uint8]) -> bytes:
    """Four 2-bit values a byte, the first in the lowest bits."""
    padded = np.zeros(-(-values.size // 4) * 4, np.uint8)
    padded[: values.size] = values
    packed = np.bitwise_or.reduce(padded.reshape(-1, 4) << _CRUMBS, axis=1)
    return bytes(np.asarray(packed, np.uint8))


def unpack_crumbs(field: str, data: bytes, count: int) -> NDArray[np.uint8]:
    """The inverse of pack_crumbs; unused bits must be zero."""
    raw = np.frombuffer(data, np.uint8)
    values = np.asarray((raw[:, None] >> _CRUMBS) & 3, np.uint8).reshape(-1)
    require(not values[count:].any(), field, data.hex(), "has unused bits set")
    return frozen(values[:count])


def frozen(array: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The array, read-only: a decoded frame is a value."""
    array.flags.writeable = False
    return array
