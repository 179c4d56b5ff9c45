"""Figures laid out as tables of text: which rows, which columns, what a cell says. Knows no file format."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from hippomat_sim.bench.tables_figures import Figure
from hippomat_sim.bench.tables_stats import Estimate
from hippomat_sim.learn.method_registry import METHODS

NO_FIGURE = "-"
NOT_TRAINED = "not trained"


@dataclass(frozen=True, slots=True)
class Table:
    """columns[0] heads the names of the rows."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Section:
    """A chapter of the report. plots: names of pictures that belong to it."""

    title: str
    text: str
    tables: Sequence[Table] = ()
    plots: Sequence[str] = ()

    @property
    def says_something(self) -> bool:
        """Pictures alone do; pictures beside tables do not where the tables are empty."""
        return any(table.rows for table in self.tables) or bool(self.plots and not self.tables)


@dataclass(frozen=True, slots=True)
class Book:
    """All figures, to look things up. untrained: methods with a size for which weights are missing."""

    figures: Sequence[Figure]
    untrained: frozenset[tuple[str, str, int, int]] = field(default_factory=frozenset)  # kind, method, N, M
    _index: dict[tuple[str, str, str, int, int, float, bool], Estimate] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for one in self.figures:
            key = (one.kind, one.metric, one.method, one.agents, one.tasks, one.loss, one.relay)
            self._index[key] = one.estimate

    def find(
        self,
        kind: str,
        metric: str,
        method: str,
        agents: int,
        tasks: int,
        loss: float = 0.0,
        relay: bool = True,
    ) -> Estimate | None:
        """None where it was not measured."""
        return self._index.get((kind, metric, method, agents, tasks, loss, relay))

    def text(
        self, kind: str, metric: str, method: str, agents: int, tasks: int, digits: int, signed: bool = False
    ) -> str:
        """What a table says of it."""
        found = self.find(kind, metric, method, agents, tasks)
        if found is None and (kind, method, agents, tasks) in self.untrained:
            return NOT_TRAINED
        return shown(found, digits, signed)

    def sizes(self, kind: str, square: bool | None = None) -> list[tuple[int, int]]:
        """(N, M) that were measured, in order. square: only those with N = M, or only the others."""
        found = {(one.agents, one.tasks) for one in self.figures if one.kind == kind}
        return sorted(size for size in found if square is None or (size[0] == size[1]) == square)

    def methods(self, kind: str) -> list[str]:
        """Those that were measured or wait for weights, in the registry's order."""
        found = {one.method for one in self.figures if one.kind == kind}
        found |= {method for of_kind, method, _, _ in self.untrained if of_kind == kind}
        return [name for name in METHODS if name in found]


def shown(estimate: Estimate | None, digits: int, signed: bool = False) -> str:
    """`99.6 ± 0.1`: the value and half of the width of its interval."""
    if estimate is None or math.isnan(estimate.value):
        return NO_FIGURE
    half = (estimate.high - estimate.low) / 2.0
    return f"{number(estimate.value, digits, signed)} ± {number(half, digits)}"


def number(value: float, digits: int, signed: bool = False) -> str:
    """No `-0.0`."""
    text = f"{value:{'+' if signed else ''}.{digits}f}"
    return text if any(digit in text for digit in "123456789") else f"{0.0:.{digits}f}"


def by_size(
    book: Book,
    title: str,
    kind: str,
    metric: str,
    sizes: Iterable[tuple[int, int]],
    digits: int,
    signed: bool = False,
    methods: Sequence[str] | None = None,
    note: str = "",
) -> Table:
    """One row for each method, one column for each size."""
    columns = list(sizes)
    rows = [
        [METHODS[name].label, *(book.text(kind, metric, name, *size, digits, signed) for size in columns)]
        for name in (book.methods(kind) if methods is None else methods)
    ]
    return Table(title, ["method", *(size_name(*size) for size in columns)], _not_empty(rows), note)


def size_name(agents: int, tasks: int) -> str:
    return f"N = M = {agents}" if agents == tasks else f"N = {agents}, M = {tasks}"


def beside_paper(
    title: str,
    agents: Sequence[int],
    methods: Sequence[str],
    ours: Callable[[str, int], str],
    paper: Callable[[str, int], str],
    note: str = "",
) -> Table:
    """For every N a column of ours and one of the paper's."""
    columns = ["method"]
    for size in agents:
        columns += [f"N = {size}", "paper"]
    rows = []
    for name in methods:
        row = [METHODS[name].label]
        for size in agents:
            row += [ours(name, size), paper(name, size)]
        rows.append(row)
    return Table(title, columns, _not_empty(rows), note)


def _not_empty(rows: list[list[str]]) -> list[list[str]]:
    """Rows that say something."""
    return [row for row in rows if any(text not in (NO_FIGURE, "") for text in row[1:])]
