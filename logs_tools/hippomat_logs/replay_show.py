"""What hippomat-replay prints of its reports. Knows reports, not how they came about."""

from __future__ import annotations

import json

from rich.console import Console
from rich.table import Table

from hippomat_core.errors import HippomatError
from hippomat_logs.report import DAMAGED, LOSSY, LevelResult, RunReport

_COLOURS = {"reproduced": "green", "diverged": "red", "damaged": "red", "error": "red"}
_CODES = {0: "green", 1: "red", 2: "red", 3: "red"}


def show(reports: list[RunReport], console: Console) -> None:
    table = Table(title=None, pad_edge=False, box=None)
    for name, justify in (
        ("run", "left"),
        ("level", "left"),
        ("result", "left"),
        ("compared", "right"),
        ("", "left"),
    ):
        table.add_column(name, justify=justify, overflow="fold")  # type: ignore[arg-type]
    for report in reports:
        name = f"robot {report.robot}" if report.robot >= 0 else "observer"
        for index, result in enumerate(report.results):
            colour = _COLOURS.get(result.status, "yellow")
            amount = f"{result.compared:,} {result.unit}" if result.unit else ""
            status = f"[{colour}]{result.status}[/{colour}]"
            table.add_row(name if not index else "", result.level, status, amount, _plain(result.detail))
    console.print(table)
    for report in reports:
        _show_findings(report, console)
    for report in reports:
        colour = _CODES[report.exit_code]
        console.print(f"{_plain(report.name)}: [{colour}]{report.verdict}[/{colour}]")


def _show_findings(report: RunReport, console: Console) -> None:
    for result in report.results:
        for note in result.notes:
            console.print(f"  robot {report.robot} {result.level}: {_plain(note)}")
        if result.divergence is not None:
            console.print("[red]first divergence[/red]: ", end="")
            console.print(f"{result.level}: {result.divergence}", markup=False)


def _plain(text: str) -> str:
    return text.replace("[", r"\[")


def say_error(error: HippomatError, as_json: bool, console: Console) -> None:
    if as_json:
        level = LevelResult("L0", LOSSY if error.exit_code == DAMAGED else "error", detail=str(error))
        print(json.dumps([RunReport("", -1, [level]).as_json()], indent=2))
    else:
        console.print(f"[red]{'damaged' if error.exit_code == DAMAGED else 'error'}[/red]: ", end="")
        console.print(str(error), markup=False)
