"""The report on a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

from hippomat_sim.bench.tables_layout import Section, Table


def show(sections: Sequence[Section], verdict: str, met: bool, console: Console) -> None:
    """All tables, and the verdict last, where it stays in sight."""
    for section in sections:
        console.rule(section.title, align="left")
        console.print(Text(section.text, style="dim"))
        for table in section.tables:
            if table.rows:
                console.print(_grid(table))
                if table.note:
                    console.print(Text(table.note + "\n", style="dim"))
    console.print(Text(verdict, style="bold green" if met else "bold red"))


def _grid(table: Table) -> Grid:
    grid = Grid(
        title=Text(table.title),
        title_justify="left",
        title_style="bold",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    for number, name in enumerate(table.columns):
        grid.add_column(Text(name), justify="right" if number else "left", overflow="fold")
    for row in table.rows:
        grid.add_row(*(Text(text.replace("**", "")) for text in row))
    return grid
