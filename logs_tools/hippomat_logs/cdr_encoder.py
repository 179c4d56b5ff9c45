"""CDR bytes of our records, several times as fast as by rosbags: a robot encodes hundreds a second.

Decides bytes only; tests hold them equal to rosbags', whose decoder reads them. For each class a function is
generated once. In it a message is one struct.pack(), whose form depends on how many rows there are and how
long the arrays are, which seldom change. CDR: OMG DDS-XTypes 1.3, 7.4.1 (XCDR1, little-endian).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

ENCAPSULATION = b"\0\1\0\0"
LETTERS = {
    "bool": "?", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
FORMS = 512  # kept of each class: a serial port's reads come in some hundred lengths
Encoder = Callable[[Any], bytes]
Item = str | int | tuple[Any, ...]  # letter of struct, size of an array's elements, items of every row
_Element = tuple[str, int, int]  # code of struct, what it is aligned to, length in bytes


class FieldSpec(NamedTuple):
    """What encoder and decoder must know of a field; a nested message has a class and fields of its own."""

    name: str
    ros: str  # "uint8", "string", "float32[]", "uint8[]" of bytes ...
    is_bytes: bool
    nested: tuple[FieldSpec, ...]
    many: bool
    kind: type | None = None  # of a nested message


def make_encoder(fields: Iterable[FieldSpec]) -> Encoder:
    """A function from a record with these attributes to its bytes; struct.error, ValueError: it cannot."""
    source = _Source()
    source.fields("r.", fields)
    return source.function()


def make_row_encoder(fields: Sequence[FieldSpec]) -> Encoder:
    """The same from (anything, value of the first field, of the second ...); no field is a message itself.

    A field crc32 is not among them: it is the checksum of the field data.
    """
    names = {one.name for one in fields}
    if "crc32" in names and "data" not in names:
        raise TypeError("a field crc32 is the checksum of a field data, which these fields lack")
    source = _Source()
    given = [f"v_{one.name}" for one in fields if one.name != "crc32"]
    source.add(f"_, {', '.join(given)} = r")
    if len(given) < len(fields):
        source.add("v_crc32 = crc32(v_data)")
    source.fields("v_", fields)
    return source.function()


class _Source:
    """Lines of the generated function.

    d1, d2 ... are arrays as bytes, strings and rows, m1 ... nested messages. What is packed stands in one
    expression, unless there are rows: then in a list `values`, and all lengths in a list `key`.
    """

    def __init__(self) -> None:
        self._names: dict[str, Any] = {"HEAD": ENCAPSULATION, "array_bytes": _array_bytes, "crc32": crc32}
        self._lines: list[str] = []
        self._items: list[Item] = []
        self._values: list[str] = ["HEAD"]  # expressions of what is to be packed
        self._key: list[str] = []  # expressions that choose the form
        self._indent = ""
        self._variables = 0
        self._has_lists = False

    def function(self) -> Encoder:
        forms = _Forms(self._items)
        if self._has_lists:
            self._extend_lists()
            self.add("return forms[(*key,)](*values)")
        elif self._key:
            self.add(f"return forms[{', '.join(self._key)},]({', '.join(self._values)})")
        else:
            self._names["pack"] = forms[()]
            self.add(f"return pack({', '.join(self._values)})")
        self._names["forms"] = forms
        body = "\n ".join(self._lines)
        exec(compile(f"def encode(r):\n {body}", "<CDR encoder>", "exec"), self._names)
        return self._names["encode"]  # type: ignore[no-any-return]

    def add(self, line: str) -> None:
        self._lines.append(self._indent + line)

    def fields(self, owner: str, fields: Iterable[FieldSpec]) -> None:
        """owner: what stands before a field's name in an expression."""
        for one in fields:
            value = owner + one.name
            if one.nested and not one.many:
                message = self._variable("m", value)
                self.fields(f"{message}.", one.nested)
            elif one.nested:
                self._rows(value, one.nested)
            elif one.ros == "string":
                self._piece(self._variable("d", f"{value}.encode() + b'\\0'"), 1)
            elif one.is_bytes:
                self._piece(self._variable("d", value), 1)
            elif one.many:
                dtype = np.dtype(one.ros[:-2])
                self._names[f"dtype_{dtype.name}"] = dtype
                array = self._variable("a", value)
                plain = f"{array}.dtype is dtype_{dtype.name} and {array}.ndim == 1"
                data = f"{array}.tobytes() if {plain} else array_bytes({array}, dtype_{dtype.name})"
                self._piece(self._variable("d", data), dtype.itemsize)
            else:
                self._number(LETTERS[one.ros], value)

    def _variable(self, letter: str, value: str) -> str:
        self._variables += 1
        self.add(f"{letter}{self._variables} = {value}")
        return f"{letter}{self._variables}"

    def _number(self, letter: str, value: str) -> None:
        self._items.append(letter)
        self._values.append(value)

    def _piece(self, data: str, size: int) -> None:
        """An array's length and its bytes, `size` to an element."""
        length = self._variable("n", f"len({data})")
        self._number("I", length if size == 1 else f"{length} // {size}")
        self._items.append(size)
        self._values.append(data)
        self._key.append(length)

    def _rows(self, value: str, fields: Iterable[FieldSpec]) -> None:
        rows = self._variable("d", value)
        count = self._variable("n", f"len({rows})")
        self._number("I", count)
        self._key.append(count)
        self._extend_lists()
        before, self._items = self._items, []
        row = f"r{self._variables}"
        self.add(f"for {row} in {rows}:")
        self._indent += " "
        self.fields(f"{row}.", fields)
        self._extend_lists()
        self._indent = self._indent[:-1]
        self._items = [*before, tuple(self._items)]

    def _extend_lists(self) -> None:
        """With what has come since they were extended last."""
        become = "+=" if self._has_lists else "="
        for name, new in (("key", self._key), ("values", self._values)):
            if new or not self._has_lists:
                self.add(f"{name} {become} [{', '.join(new)}]")
        self._key, self._values, self._has_lists = [], [], True


class _Forms(dict[tuple[int, ...], Callable[..., bytes]]):
    """struct.pack() of a message, by the lengths of its arrays in bytes and its numbers of rows, in the order
    in which they stand in it."""

    def __init__(self, items: Sequence[Item]) -> None:
        self._items = items

    def __missing__(self, key: tuple[int, ...]) -> Callable[..., bytes]:
        if len(self) >= FORMS:
            self.clear()
        form = f"<{len(ENCAPSULATION)}s" + _form(_elements(self._items, iter(key)), 0)
        pack = self[key] = struct.Struct(form).pack
        return pack


def padded(letters: str, start: int) -> struct.Struct:
    """Numbers that begin `start` bytes behind a multiple of 8, each aligned to its size."""
    return struct.Struct("<" + _form(_elements(letters, iter(())), start))


def _form(elements: Iterable[_Element], start: int) -> str:
    text, at = "", start
    for code, size, length in elements:
        pad = -at % size
        text += f"{pad}x{code}" if pad else code
        at += pad + length
    return text


def _elements(items: Iterable[Item], lengths: Iterator[int]) -> Iterator[_Element]:
    for item in items:
        if isinstance(item, str):
            size = struct.calcsize("<" + item)
            yield item, size, size
        elif isinstance(item, int):
            length = next(lengths)
            yield f"{length}s", item if length else 1, length
        else:
            for _ in range(next(lengths)):
                yield from _elements(item, lengths)


def _array_bytes(values: Any, dtype: np.dtype[Any]) -> bytes:
    """Its elements in one piece, whatever its steps are."""
    if values.dtype != dtype or values.ndim != 1:
        raise ValueError(f"an array of {values.dtype} {values.shape} stands where one of {dtype} belongs")
    return values.tobytes()  # type: ignore[no-any-return]
