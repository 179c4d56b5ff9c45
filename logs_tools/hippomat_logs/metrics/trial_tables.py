"""Tables over trials: for a terminal, as Markdown, LaTeX (booktabs), CSV and JSON. Knows groups, not logs.

A cell is the mean over the trials of a group ± half the width of its 95 % interval; one trial has none. Where
a figure has values in fewer trials than the group, their number follows in brackets.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from rich.markup import escape
from rich.table import Table

from hippomat_logs.metrics.as_json import plain
from hippomat_logs.metrics.comparison import Group
from hippomat_logs.metrics.figures import NONE, Figure, number
from hippomat_logs.metrics.intervals import Interval

TERMINAL_COLUMNS = 80
METHOD = "mean ± half of the 95 % interval over n trials (Student's t)"
PAIRED = "the same seed, robots, tasks and map"


@dataclass(frozen=True, slots=True)
class Grid:
    """Header and rows of text; `caption` says what the cells are."""

    caption: str
    header: list[str]
    rows: list[list[str]]


def grids(
    groups: Sequence[Group], keys: Sequence[str], figures: Sequence[Figure], baseline: str
) -> list[Grid]:
    """A row per group, a column per figure; then the differences to the baseline, where there is one."""
    header = [*keys, "n", *(figure.title for figure in figures)]
    rows = [
        [
            *group.facts,
            str(len(group.trials)),
            *(_cell(group.interval(f.key), f, len(group.trials)) for f in figures),
        ]
        for group in groups
    ]
    made = [
        Grid(METHOD if any(len(group.trials) > 1 for group in groups) else "one trial each", header, rows)
    ]
    if baseline:
        rows = [
            [*group.facts, str(len(group.pairs)), *(_difference(group, f) for f in figures)]
            for group in groups
            if not group.is_baseline
        ]
        caption = f"difference to {baseline}, {METHOD.replace('trials', 'pairs')}; a pair has {PAIRED}"
        made.append(Grid(caption, header, rows))
    return made


def _cell(found: Interval, figure: Figure, trials: int) -> str:
    text = number(found.mean, figure.digits)
    if not math.isnan(found.half):
        text += f" ± {number(found.half, figure.digits)}"
    return f"{text} ({found.n})" if 0 < found.n < trials else text


def _difference(group: Group, figure: Figure) -> str:
    found = group.difference(figure.key)
    text = _cell(found, figure, len(group.pairs))
    return (
        f"+{text}" if found.mean > 0.0 and float(number(found.mean, figure.digits).replace(",", "")) else text
    )


# ---- terminal: figures down, groups across, so that 80 columns hold a few methods ----


def terminal_tables(grid: Grid, keys: int, width: int = TERMINAL_COLUMNS) -> Iterator[Table]:
    """As many tables as it takes."""
    columns = [grid.header[keys:], *(row[keys:] for row in grid.rows)]
    names = [" ".join(grid.header[:keys]), *(" ".join(row[:keys]) for row in grid.rows)]
    widths = [max(map(len, (name, *column))) + 2 for name, column in zip(names, columns, strict=True)]
    at = 1
    while at < len(columns):
        end, used = at + 1, widths[0] + widths[at]
        while end < len(columns) and used + widths[end] <= width:
            used += widths[end]
            end += 1
        table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
        table.add_column(escape(names[0]), no_wrap=True)
        for name in names[at:end]:
            table.add_column(escape(name), justify="right", no_wrap=True)
        for cells in zip(columns[0], *columns[at:end], strict=True):
            table.add_row(*map(escape, cells))
        yield table
        at = end


# ---- files ----


def as_markdown(made: Sequence[Grid]) -> str:
    blocks = []
    for grid in made:
        rule = ["---", *("---:" for _ in grid.header[1:])]
        lines = [
            " | ".join(cell.replace("|", "\\|") for cell in row) for row in (grid.header, rule, *grid.rows)
        ]
        blocks.append(
            "\n".join(f"| {line} |" for line in lines) + f"\n\n{grid.caption[0].upper()}{grid.caption[1:]}."
        )
    return "\n\n".join(blocks) + "\n"


def as_latex(made: Sequence[Grid], keys: int) -> str:
    r"""For a document with \usepackage{booktabs}."""
    return "\n".join(_latex_table(grid, keys) for grid in made)


def _latex_table(grid: Grid, keys: int) -> str:
    def row(cells: Sequence[str], of: Callable[[str], str]) -> str:
        return "    " + " & ".join([*map(latex_text, cells[:keys]), *map(of, cells[keys:])]) + r" \\"

    lines = [
        r"% needs \usepackage{booktabs}",
        r"\begin{table}",
        r"  \centering",
        rf"  \caption{{{latex_text(grid.caption[0].upper() + grid.caption[1:])}.}}",
        rf"  \begin{{tabular}}{{{'l' * keys}{'r' * (len(grid.header) - keys)}}}",
        r"    \toprule",
        row([*grid.header[:keys], *map(_two_lines, grid.header[keys:])], str),
        r"    \midrule",
        *(row(cells, _latex_number) for cells in grid.rows),
        r"    \bottomrule",
        r"  \end{tabular}",
        r"\end{table}",
        "",
    ]
    return "\n".join(lines)


def _two_lines(title: str) -> str:
    """Long column heads would make the table wider than a page."""
    words = title.split()
    if len(words) < 2 or len(title) < 12:
        return latex_text(title)
    breaks = range(1, len(words))
    at = min(breaks, key=lambda k: max(len(" ".join(words[:k])), len(" ".join(words[k:]))))
    above, below = latex_text(" ".join(words[:at])), latex_text(" ".join(words[at:]))
    return rf"\shortstack{{{above}\\{below}}}"


_LATEX = {
    "\\": r"\textbackslash{}",
    **{char: "\\" + char for char in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    "<": r"$<$",
    ">": r"$>$",
    "|": r"$|$",
}


def latex_text(text: str) -> str:
    """Shown as it is."""
    return "".join(_LATEX.get(char, char) for char in text)


def _latex_number(cell: str) -> str:
    """A number and its interval in mathematics, so that a minus is one."""
    value, plus_minus, rest = cell.partition(" ± ")
    if value == NONE:
        return "--"
    half, _, count = rest.partition(" ")
    body = value.replace(",", r"{,}") + (rf" \pm {half.replace(',', '{,}')}" if plus_minus else "")
    return f"${body}$" + (f" {count}" if count else "")


def as_csv(groups: Sequence[Group], keys: Sequence[str], figures: Sequence[Figure]) -> str:
    """One line per group and figure, unrounded; empty where there is no value."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    names = ("n", "mean", "low", "high", "pairs", "difference", "difference_low", "difference_high")
    writer.writerow([*keys, "figure", "unit", *names])
    for group in groups:
        for figure in figures:
            found, difference = group.interval(figure.key), group.difference(figure.key)
            values = [found.n, *_bounds(found), difference.n, *_bounds(difference)]
            cells = ("" if isinstance(one, float) and math.isnan(one) else one for one in values)
            writer.writerow([*group.facts, figure.key, figure.unit, *cells])
    return out.getvalue()


def as_values(
    groups: Sequence[Group], keys: Sequence[str], figures: Sequence[Figure]
) -> list[dict[str, Any]]:
    """For JSON."""
    return [
        {
            "by": dict(zip(keys, group.facts, strict=True)),
            "trials": [{"name": trial.name, "figures": plain(trial.figures)} for trial in group.trials],
            "figures": {f.key: _values(group.interval(f.key), f) for f in figures},
            "differences": {f.key: _values(group.difference(f.key), f) for f in figures}
            if group.pairs
            else {},
        }
        for group in groups
    ]


def _values(found: Interval, figure: Figure) -> Any:
    mean, low, high = _bounds(found)
    return plain({"unit": figure.unit, "n": found.n, "mean": mean, "low": low, "high": high})


def _bounds(found: Interval) -> tuple[float, float, float]:
    return found.mean, found.mean - found.half, found.mean + found.half
