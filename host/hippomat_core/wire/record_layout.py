"""A dataclass whose fields follow each other on the wire: bytes and back, little-endian, strict.

The annotation of a field says how wide it is; `sizes` gives the bytes of those that are bytes or text
(printable ASCII, zeros behind). Knows no message; ranges narrower than a field are the caller's to check.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, Generic, TypeVar, get_args, get_type_hints

from hippomat_core.wire.packing import RANGES, require, whole_number

T = TypeVar("T")

_CODES = {"uint8": "B", "uint16": "H", "uint32": "I", "uint64": "Q", "int8": "b"}


class RecordLayout(Generic[T]):
    """The layout of one dataclass."""

    def __init__(self, kind: type[T], sizes: Mapping[str, int]) -> None:
        self.kind = kind
        self._fields: dict[str, tuple[type, str]] = {}  # Python type and struct code
        for name, hint in get_type_hints(kind, include_extras=True).items():
            self._fields[name] = _field(hint, sizes.get(name, 0))
        self._struct = struct.Struct("<" + "".join(code for _, code in self._fields.values()))
        self.size = self._struct.size

    def encode(self, record: T) -> bytes:
        return self._struct.pack(*(self._to_wire(name, getattr(record, name)) for name in self._fields))

    def decode(self, data: bytes) -> T:
        require(len(data) == self.size, f"{self.kind.__name__} length", len(data), f"is not {self.size}")
        raw = self._struct.unpack(data)
        return self.kind(*map(self._from_wire, self._fields, raw))

    def _to_wire(self, name: str, value: Any) -> Any:
        (kind, code), field = self._fields[name], f"{self.kind.__name__}.{name}"
        if kind is str:
            return _text_to_bytes(field, value, int(code[:-1]))
        if kind is bytes:
            size = int(code[:-1])
            require(len(value) == size, f"{field} length", len(value), f"is outside {size} .. {size}")
            return bytes(value)
        return whole_number(field, value, *((0, 1) if kind is bool else RANGES[code]))

    def _from_wire(self, name: str, value: Any) -> Any:
        (kind, _), field = self._fields[name], f"{self.kind.__name__}.{name}"
        if kind is str:
            return _bytes_to_text(field, value)
        if kind is bool:
            return bool(whole_number(field, value, 0, 1))
        return value


def _field(hint: Any, size: int) -> tuple[type, str]:
    if hint in (str, bytes):
        return hint, f"{size}s"
    if hint is bool:
        return bool, "B"
    kind, width = get_args(hint)
    return kind, _CODES[width]


def _text_to_bytes(field: str, text: str, size: int) -> bytes:
    fits = len(text) <= size and all(" " <= character <= "~" for character in text)
    require(fits, field, text, f"is not at most {size} printable ASCII characters")
    return text.encode()


def _bytes_to_text(field: str, data: bytes) -> str:
    text = data.rstrip(b"\0")
    require(all(32 <= byte <= 126 for byte in text), field, data, "is not printable ASCII, zeros behind")
    return text.decode()
