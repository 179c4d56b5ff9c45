"""A message of constant layout as bytes, in which only some numbers change. Knows bytes, not topics."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hippomat_logs.cdr_layout import ONE, Field, layout_of


class Template:
    """`fill(values)` puts new numbers at `paths`, two or more in the order of the bytes, into `data`, CDR,
    and gives a copy of its bytes. What stands between them is packed again too, so that it takes one pack.
    """

    def __init__(self, fields: Sequence[Field], data: bytes, paths: Sequence[str]) -> None:
        places = layout_of(fields, data).places
        self._fields = {one.name: (place, one) for one, place in zip(fields, places, strict=True)}
        self._data = bytearray(data)
        offsets = _offsets(fields, places, "")
        letters, self._between, order = "", list[bytes](), list[int]()
        self._begin = at = offsets[paths[0]][0]
        for number, path in enumerate(paths):
            offset, letter = offsets[path]
            if offset < at:
                raise ValueError(f"{path} lies before the path that is named before it")
            if offset > at:
                letters += f"{offset - at}s"
                order.append(len(paths) + len(self._between))
                self._between.append(data[at:offset])
            letters, at = letters + letter, offset + struct.calcsize("<" + letter)
            order.append(number)
        self._pack_into = struct.Struct("<" + letters).pack_into
        self._end = at
        self._in_order = itemgetter(*order)

    def array(self, name: str) -> NDArray[Any]:
        """Where an array of numbers lies, in its length: what is put there goes into what is filled next."""
        (count, offset), field = self._fields[name]
        if offset < self._end:
            raise ValueError(f"{name} lies among the paths: fill() writes there")
        return np.frombuffer(self._data, "<" + field.dtype, count, offset)

    def fill(self, *values: float) -> bytes:
        """values: in the order of the paths."""
        self._pack_into(self._data, self._begin, *self._in_order((*values, *self._between)))
        return bytes(self._data)


_LETTERS = {"f8": "d", "f4": "f", "i4": "i", "u4": "I", "i8": "q", "u8": "Q"}


def _offsets(fields: Sequence[Field], places: Sequence[Any], prefix: str) -> dict[str, tuple[int, str]]:
    """Byte and struct letter of every single number, by path, e.g. "transforms[0].header.stamp.sec"."""
    found: dict[str, tuple[int, str]] = {}
    for one, place in zip(fields, places, strict=True):
        name = prefix + one.name
        if one.fields and one.many == ONE:
            found |= _offsets(one.fields, place, name + ".")
        elif one.fields:
            for index, row in enumerate(place):
                found |= _offsets(one.fields, row, f"{name}[{index}].")
        elif one.many == ONE and one.dtype in _LETTERS:
            found[name] = place, _LETTERS[one.dtype]
    return found
