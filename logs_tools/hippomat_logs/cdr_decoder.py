"""Our records out of their CDR bytes, several times as fast as by rosbags: a replay decodes a million.

The counterpart of cdr_encoder.py, made the same way: one generated function per class, in which every run of
numbers is one struct.unpack_from(). Damaged bytes raise; tests hold what comes out equal to rosbags'.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from hippomat_core.replaced import maker_of
from hippomat_logs.cdr_encoder import ENCAPSULATION, LETTERS, FieldSpec, padded

Decoder = Callable[[Any], Any]  # bytes or memoryview -> a record; its arrays are read-only


def make_decoder(kind: type, fields: Iterable[FieldSpec]) -> Decoder:
    """A function from bytes to a `kind`; struct.error or ValueError: they hold none."""
    source = _Source()
    value = source.value(kind, fields)
    source.end_run()
    body = "\n ".join(source.lines)
    code = f"def decode(data):\n if data[:2] != LE: refused(data)\n d, n = data[4:], 0\n {body}\n"
    code += f" if not n <= len(d) <= n + 3: wrong_size(d, n)\n return {value}"
    names: dict[str, Any] = {"LE": ENCAPSULATION[:2], "refused": _refused, "wrong_size": _wrong_size}
    names["frombuffer"] = np.frombuffer
    names.update(source.names)
    exec(compile(code, "<CDR decoder>", "exec"), names)
    return names["decode"]  # type: ignore[no-any-return]


class _Source:
    """Lines of the generated function. `d` is what follows the encapsulation header, `n` where it is read."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.names: dict[str, Any] = {}
        self._run: list[tuple[str, str]] = []  # letters and variables not yet unpacked
        self._indent = ""
        self._variables = 0

    def value(self, kind: type, fields: Iterable[FieldSpec]) -> str:
        """The expression that makes a `kind` once the lines so far have run."""
        self.names[kind.__name__] = maker_of(kind)
        return f"{kind.__name__}({', '.join([self._field(one) for one in fields])})"

    def end_run(self) -> None:
        """Unpack what has come together."""
        if not self._run:
            return
        letters = "".join(letter for letter, _ in self._run)
        name = f"unpacks_{letters.replace('?', 't')}"
        forms = [padded(letters, start) for start in range(8)]
        self.names[name] = tuple((form.unpack_from, form.size) for form in forms)
        targets = ", ".join(variable for _, variable in self._run)
        self._add(f"unpack, size = {name}[n & 7]; {targets}, = unpack(d, n); n += size")
        self._run = []

    def _field(self, one: FieldSpec) -> str:
        if one.kind is not None:
            return self._rows(one.kind, one.nested) if one.many else self.value(one.kind, one.nested)
        if one.ros == "string":
            length, value = self._length(), self._variable()
            self._add(f"{value} = str(d[n : n + {length} - 1], 'utf-8') if {length} else ''; n += {length}")
        elif one.is_bytes:
            length, value = self._length(), self._variable()
            self._add(f"{value} = bytes(d[n : n + {length}]); n += {length}")
        elif one.many:
            value = self._array(np.dtype(one.ros[:-2]))
        else:
            value = self._variable()
            self._run.append((LETTERS[one.ros], value))
        return value

    def _add(self, line: str) -> None:
        self.lines.append(self._indent + line)

    def _variable(self) -> str:
        self._variables += 1
        return f"v{self._variables}"

    def _length(self) -> str:
        """Unpack the run with the length that ends it; the variable that holds the length."""
        length = self._variable()
        self._run.append(("I", length))
        self.end_run()
        return length

    def _array(self, dtype: np.dtype[Any]) -> str:
        length, value = self._length(), self._variable()
        if dtype.itemsize > 4:
            self._add(f"if {length}: n += -n & {dtype.itemsize - 1}")
        self.names[f"dtype_{dtype.name}"] = dtype
        self._add(
            f"{value} = frombuffer(d, dtype_{dtype.name}, {length}, n) if {length} else none_{dtype.name}"
        )
        self._add(f"n += {dtype.itemsize} * {length}")
        self.names[f"none_{dtype.name}"] = _none(dtype)
        return value

    def _rows(self, kind: type, fields: Iterable[FieldSpec]) -> str:
        length, rows = self._length(), self._variable()
        self._add(f"{rows} = []")
        self._add(f"for _ in range({length}):")
        self._indent += " "
        value = self.value(kind, fields)
        self.end_run()
        self._add(f"{rows}.append({value})")
        self._indent = self._indent[:-1]
        return f"tuple({rows})"


def _none(dtype: np.dtype[Any]) -> np.ndarray[Any, Any]:
    """The empty array; frombuffer() refuses to make one at the end of its buffer."""
    made = np.empty(0, dtype)
    made.flags.writeable = False
    return made


def _refused(data: Any) -> None:
    raise ValueError(f"bytes that begin with {bytes(data[:2]).hex()} are no little-endian CDR")


def _wrong_size(d: Any, n: int) -> None:
    """Up to 3 bytes of padding may follow."""
    raise ValueError(f"{n} bytes were expected, {len(d)} are there")
