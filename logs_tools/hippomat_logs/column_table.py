"""Messages of one topic as columns. Decides names and types of columns; knows CDR layouts, not files.

A nested field is a column of its own ("pose.pose.position.x"); an array is a column of arrays; a sequence of
messages is a table of its own, whose column `row` says which message of the outer table an element is in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import HippomatError
from hippomat_logs.cdr_layout import ONE, Field, Layout, groups_of, texts, view

if TYPE_CHECKING:
    import pandas as pd

TIME, NUMBER, ROW = "log_time_ns", "record", "row"


@dataclass
class Table:
    """Columns of equal length; `children` are the tables of fields that hold several messages."""

    name: str
    columns: dict[str, NDArray[Any]]
    children: dict[str, Table] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __getitem__(self, name: str) -> NDArray[Any]:
        try:
            return self.columns[name]
        except KeyError:
            known = ", ".join([*self.columns, *(f"child {child}" for child in self.children)])
            raise HippomatError(f"{self.name} has no column {name!r}; it has {known}") from None

    def child(self, name: str) -> Table:
        """The elements of a field that holds a sequence of messages, e.g. `transforms` of /tf."""
        try:
            return self.children[name]
        except KeyError:
            raise HippomatError(
                f"{self.name} has no child table {name!r}; it has {', '.join(self.children) or 'none'}"
            ) from None

    @property
    def dtype(self) -> np.dtype[np.void]:
        return np.dtype([(name, column.dtype) for name, column in self.columns.items()])

    def to_numpy(self) -> NDArray[np.void]:
        """One structured array (n,); strings and arrays of varying length are objects."""
        rows = np.empty(len(self), self.dtype)
        for name, column in self.columns.items():
            rows[name] = column
        return rows

    def to_pandas(self) -> pd.DataFrame:
        """A DataFrame without the children; index 0 .. n-1."""
        try:
            import pandas as pd
        except ModuleNotFoundError:
            raise HippomatError("pandas is not installed: pip install 'hippomat[tables]'") from None
        return pd.DataFrame(self.columns)

    def stacked(self, name: str) -> NDArray[Any]:
        """A column of arrays as one array (n, k); they must be of one length."""
        column = self[name]
        if len({len(row) for row in column}) > 1:
            raise HippomatError(f"{self.name}: the arrays in {name!r} have different lengths")
        return np.stack(list(column)) if len(column) else np.empty((0, 0))

    def tables(self) -> Iterator[Table]:
        """This table and all below it."""
        yield self
        for child in self.children.values():
            yield from child.tables()


def table_of(
    name: str,
    fields: Sequence[Field],
    times: Sequence[int],
    numbers: Sequence[int],
    payloads: Sequence[bytes],
) -> Table:
    """The messages in `payloads` (CDR), in their order. Raises LogError for one that does not decode."""
    table = Table(name, {TIME: np.array(times, np.int64), NUMBER: np.array(numbers, np.int64)})
    building = _Building(table, len(payloads))
    for which, rows, layout in groups_of(fields, payloads):
        building.fill(fields, layout.places, which, rows, layout, "")
    building.done()
    return table


class _Building:
    """A table being filled, group by group."""

    def __init__(self, table: Table, length: int) -> None:
        self._table, self._length = table, length
        self._elements: dict[str, list[tuple[NDArray[np.int64], Any, NDArray[np.uint8], Layout]]] = {}
        self._fields: dict[str, tuple[Field, ...]] = {}

    def fill(
        self,
        fields: Sequence[Field],
        places: Sequence[Any],
        which: NDArray[np.int64],
        rows: NDArray[np.uint8],
        layout: Layout,
        prefix: str,
    ) -> None:
        for one, place in zip(fields, places, strict=True):
            name = prefix + one.name
            if name in (TIME, NUMBER, ROW):
                name += "_"
            if one.fields and one.many == ONE:
                self.fill(one.fields, place, which, rows, layout, name + ".")
            elif one.fields:
                self._fields[name] = one.fields
                held = self._elements.setdefault(name, [])
                held += [(which, element, rows, layout) for element in place]
            elif one.text:
                self._objects(name)[which] = _texts(one, place, rows)
            elif one.many == ONE:
                dtype = "bool" if one.dtype[0] == "b" else one.dtype
                column = self._table.columns.setdefault(name, np.zeros(self._length, dtype))
                column[which] = view(rows, _ordered(layout, one.dtype), place)
            else:
                count, at = place
                values = view(rows, _ordered(layout, one.dtype), at, count)
                self._objects(name)[which] = _cells(values.astype(np.dtype(one.dtype), order="C"))

    def _objects(self, name: str) -> NDArray[Any]:
        return self._table.columns.setdefault(name, np.empty(self._length, object))

    def done(self) -> None:
        """Make the children: their rows are in the order of the outer messages, then of the elements."""
        for name, fields in self._fields.items():
            elements = self._elements[name]
            counts = [len(which) for which, *_ in elements]
            total = sum(counts)
            owners = np.concatenate([which for which, *_ in elements]) if elements else np.empty(0, np.int64)
            order = np.argsort(owners, kind="stable")
            rank = np.empty(total, np.int64)
            rank[order] = np.arange(total)
            child = Table(f"{self._table.name}.{name}", {ROW: owners[order]})
            building, at = _Building(child, total), 0
            for (_, places, rows, layout), count in zip(elements, counts, strict=True):
                building.fill(fields, places, rank[at : at + count], rows, layout, "")
                at += count
            building.done()
            self._table.children[name] = child


def _ordered(layout: Layout, dtype: str) -> str:
    return layout.order + dtype


def _cells(values: NDArray[Any]) -> NDArray[Any]:
    """(n, k) -> (n,) of arrays (k,)."""
    cells = np.empty(len(values), object)
    for index, row in enumerate(values):  # an assignment in one go would guess at the shape
        cells[index] = row
    return cells


def _texts(one: Field, place: Any, rows: NDArray[np.uint8]) -> NDArray[Any]:
    cells = np.empty(len(rows), object)
    if one.many == ONE:
        cells[:] = texts(rows, *place)
        return cells
    lists = zip(*(texts(rows, *part) for part in place), strict=True) if place else [()] * len(rows)
    for index, words in enumerate(lists):
        cells[index] = list(words)
    return cells
