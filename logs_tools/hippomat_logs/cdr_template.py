"""A message of constant layout as bytes, in which only some numbers change. Knows bytes, not topics."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from hippomat_logs.cdr_layout import ONE, Field, layout_of


class Template:
    """`fill(values)` puts new numbers at `paths` into a copy of `data`, CDR, and gives its bytes.

    Neighbouring paths of one type are packed together.
    """

    def __init__(self, fields: Sequence[Field], data: bytes, paths: Sequence[str]) -> None:
        places = layout_of(fields, data).places
        offsets = _offsets(fields, places, "")
        arrays = (
            (one, place) for one, place in zip(fields, places, strict=True) if one.many != ONE and one.dtype
        )
        self._arrays = {one.name: (place[1], place[0] * int(one.dtype[1:])) for one, place in arrays}
        self._data = bytearray(data)
        self._places: list[tuple[struct.Struct, int, slice]] = []  # what packs, where, which of the values
        at, letters = -1, ""
        begun = 0
        for path in paths:
            offset, letter = offsets[path]
            if offset != at and letters:
                self._place(letters, begun)
                letters = ""
            begun = begun if letters else offset
            letters, at = letters + letter, offset + struct.calcsize("<" + letter)
        self._place(letters, begun)

    def _place(self, letters: str, begun: int) -> None:
        first = self._places[-1][2].stop if self._places else 0
        self._places.append((struct.Struct("<" + letters), begun, slice(first, first + len(letters))))

    def fill(self, *values: float, **arrays: NDArray[Any]) -> bytes:
        """values: in the order of the paths; arrays: by field, with the lengths they had."""
        for packer, offset, which in self._places:
            packer.pack_into(self._data, offset, *values[which])
        for name, array in arrays.items():
            offset, size = self._arrays[name]
            self._data[offset : offset + size] = array.data.cast("B")
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
