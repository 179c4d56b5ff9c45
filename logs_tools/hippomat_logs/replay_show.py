"""What hippomat-replay prints of its reports, 80 columns wide. Knows reports, not how they came about."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hippomat_core.errors import HippomatError
from hippomat_logs.paragraphs import say
from hippomat_logs.report import DAMAGED, LOSSY, LevelResult, RunReport
from hippomat_logs.shortfalls import whose_log
from hippomat_logs.terminal import Terminal

_COLOURS = {"reproduced": "green", "diverged": "red", "damaged": "red", "error": "red"}
_CODES = {0: "green", 1: "red", 2: "red", 3: "red"}


def show(reports: list[RunReport], console: Console) -> None:
    """A block for each run, then a verdict for each."""
    names = names_of(reports)
    for name, report in zip(names, reports, strict=True):
        say(console, f"{whose_log(report.robot)}: {name}", 0, "bold")
        console.print(_levels_table(report.results))
        for result in report.results:
            _show_findings(result, console)
        console.print()
    for name, report in zip(names, reports, strict=True):
        colour = _CODES[report.exit_code]
        console.print(f"{escape(name)}: [{colour}]{report.verdict}[/{colour}]")


def names_of(reports: Sequence[RunReport]) -> list[str]:
    """The runs' names; where two are alike, with their places below what all have in common."""
    counts = Counter(report.name for report in reports)
    if len(reports) == len(counts):
        return [report.name for report in reports]
    above = os.path.commonpath([os.path.dirname(report.file) or "." for report in reports])
    places = [os.path.relpath(os.path.dirname(report.file) or ".", above) for report in reports]
    return [
        report.name if place == "." or counts[report.name] == 1 else f"{place}/{report.name}"
        for place, report in zip(places, reports, strict=True)
    ]


def _levels_table(results: Sequence[LevelResult]) -> Table:
    table = Table(pad_edge=False, box=None, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(width=7)
    for justify in ("left", "right"):
        table.add_column(justify=justify, no_wrap=True)
    table.add_column(overflow="fold")
    for result in results:
        colour = _COLOURS.get(result.status, "yellow")
        amount = f"{result.compared:,} {result.unit}" if result.unit else ""
        status = f"[{colour}]{result.status}[/{colour}]"
        table.add_row(f" {result.level}", status, amount, escape(result.detail))
    return table


def _show_findings(result: LevelResult, console: Console) -> None:
    for note in result.notes:
        say(console, f"{result.level}: {note}", 1)
    if result.divergence is not None:
        console.print(" [red]first divergence[/red]: ", end="")
        console.print(f"{result.level}: {result.divergence}", markup=False)


def say_error(error: HippomatError, as_json: bool) -> None:
    """Why nothing was replayed: as JSON where that is what is read, else on standard error."""
    if as_json:
        level = LevelResult("L0", LOSSY if error.exit_code == DAMAGED else "error", detail=str(error))
        print(json.dumps([RunReport("", -1, [level]).as_json()], indent=2))
    else:
        console = Terminal(stderr=True)
        console.print(f"[red]{'damaged' if error.exit_code == DAMAGED else 'error'}[/red]: ", end="")
        console.print(str(error), markup=False)
