"""Where every value of a CDR message lies, so that all messages of one layout become columns without a loop.

Two messages whose strings and sequences have equal lengths have equal layouts. A batch is therefore split by
its lengths, and each field of a group is one strided view. Knows bytes and message definitions, not files.
CDR: OMG DDS-XTypes 1.3, 7.4.1 (XCDR1, plain); definitions as rosbags parses them.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Typesdict

from hippomat_core.errors import LogError

HEAD_BYTES = 4  # encapsulation: the second byte tells the byte order
DTYPES = {"bool": "?", "byte": "i1", "char": "u1", "octet": "u1"}  # as rosbags has them
_EMPTY = "structure_needs_at_least_one_member"  # what IDL makes of a message without fields
ONE, FIXED, COUNTED = -1, 0, 1  # a single value; an array of a known length; a sequence


@dataclass(frozen=True)
class Field:
    """A field of a message. Exactly one of dtype, text and fields says what it holds."""

    name: str
    many: int  # ONE, FIXED, COUNTED
    length: int  # of a FIXED one
    dtype: str = ""
    text: bool = False
    fields: tuple[Field, ...] = ()


def fields_of_type(types: Typesdict, name: str) -> tuple[Field, ...]:
    """The fields of a message type; raises LogError for what CDR columns cannot hold."""
    fields = tuple(_field(types, name, key, desc) for key, desc in types[name][1])
    return fields or (Field(_EMPTY, ONE, 0, "u1"),)


def _field(types: Typesdict, owner: str, name: str, desc: Any) -> Field:
    kind, content = desc
    many, length = ONE, 0
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        many = FIXED if kind == Nodetype.ARRAY else COUNTED
        (kind, content), length = content
    if kind == Nodetype.NAME:
        return Field(name, many, length, fields=fields_of_type(types, content))
    base = content[0]
    if base == "string":
        return Field(name, many, length, text=True)
    if base in ("wstring", "wchar", "float128", "fixed"):
        raise LogError(f"field {name} of {owner} is a {base}, which is not read")
    return Field(name, many, length, dtype=np.dtype(DTYPES.get(base, base)).str[1:])


@dataclass(slots=True)
class Layout:
    """Places of one message's values, in the order of its fields; lengths are what the places depend on."""

    order: str  # "<" or ">"
    places: list[Any] = field(default_factory=list)
    guards: list[tuple[int, int]] = field(default_factory=list)  # (offset of a length, the length)
    end: int = HEAD_BYTES


def layout_of(fields: Sequence[Field], data: bytes) -> Layout:
    """Raises LogError where `data` is shorter than its own lengths say."""
    layout = Layout("<" if len(data) > 1 and data[1] & 1 else ">")
    try:
        layout.places = _places(fields, data, layout)
    except struct.error:
        raise LogError("a message ends before its last field") from None
    if layout.end > len(data):
        raise LogError("a message ends before its last field")
    return layout


def _places(fields: Sequence[Field], data: bytes, layout: Layout) -> list[Any]:
    return [_place(one, data, layout) for one in fields]


def _place(one: Field, data: bytes, layout: Layout) -> Any:
    """scalar: offset. text: (offset, bytes). Of many: (count, offset) or a list of places."""
    count = one.length
    if one.many == COUNTED:
        count = _length(data, layout)
    if one.dtype:
        size = int(one.dtype[1:])
        if one.many == ONE:
            return _take(layout, size, size)
        return count, _take(layout, size, size * count) if count else layout.end
    if one.many == ONE:
        return _text(data, layout) if one.text else _places(one.fields, data, layout)
    if count > len(data):  # each element has at least a byte: no list longer than the message
        raise LogError("a sequence is longer than its message")
    if one.text:
        return [_text(data, layout) for _ in range(count)]
    return [_places(one.fields, data, layout) for _ in range(count)]


def _take(layout: Layout, align: int, size: int) -> int:
    at = layout.end + (HEAD_BYTES - layout.end) % align
    layout.end = at + size
    return at


def _length(data: bytes, layout: Layout) -> int:
    at = _take(layout, 4, 4)
    length = int(struct.unpack_from(layout.order + "I", data, at)[0])
    layout.guards.append((at, length))
    return length


def _text(data: bytes, layout: Layout) -> tuple[int, int]:
    """Offset and length of a string, without the zero byte at its end."""
    length = _length(data, layout)
    return _take(layout, 1, length), max(0, length - 1)


# ---- groups of one layout ----

Group = tuple[NDArray[np.int64], NDArray[np.uint8], Layout]  # which messages, their bytes (n, size), layout


def groups_of(fields: Sequence[Field], payloads: Sequence[bytes]) -> list[Group]:
    """Split messages by layout; every index of `payloads` is in exactly one group."""
    by_size: dict[int, list[int]] = {}
    for index, data in enumerate(payloads):
        by_size.setdefault(len(data), []).append(index)
    groups: list[Group] = []
    for size, indices in by_size.items():
        joined = b"".join([payloads[index] for index in indices])
        rows: NDArray[np.uint8] = np.frombuffer(joined, np.uint8).reshape(len(indices), size)
        which = np.array(indices)
        while len(which):
            layout = layout_of(fields, payloads[which[0]])
            same = _matches(rows, layout)
            groups.append((which[same], rows[same], layout))
            which, rows = which[~same], rows[~same]
    return groups


def _matches(rows: NDArray[np.uint8], layout: Layout) -> NDArray[np.bool_]:
    """Which rows have the layout's byte order and lengths; the first one has."""
    same = (rows[:, 1] & 1) == (layout.order == "<")
    for at, length in layout.guards:
        same &= view(rows, layout.order + "u4", at) == length
    return np.asarray(same)


def view(rows: NDArray[np.uint8], dtype: str, at: int, count: int = ONE) -> NDArray[Any]:
    """The values at byte `at` of every row: (n,), or (n, count)."""
    size = np.dtype(dtype).itemsize
    shape = (len(rows),) if count == ONE else (len(rows), count)
    strides = (rows.strides[0],) if count == ONE else (rows.strides[0], size)
    return np.ndarray(shape, dtype, rows, at, strides)


def texts(rows: NDArray[np.uint8], at: int, length: int) -> list[str]:
    """The strings at byte `at` of every row; equal ones, which is the rule, are decoded once."""
    if not length:
        return [""] * len(rows)
    known: dict[bytes, str] = {}
    found = []
    for raw in np.ascontiguousarray(rows[:, at : at + length]).view(f"V{length}").ravel().tolist():
        data = bytes(raw)
        if data not in known:
            known[data] = data.decode(errors="replace")
        found.append(known[data])
    return found
