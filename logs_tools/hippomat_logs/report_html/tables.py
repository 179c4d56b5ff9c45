"""The report's tables as rows of text; how they look is the page's."""

from __future__ import annotations

from dataclasses import dataclass

from rich.table import Table
from rich.text import Text

from hippomat_core.messages import ERROR, WARNING
from hippomat_logs.report_html.data import ReportData
from hippomat_logs.report_html.look import label_of

LEVELS = {WARNING: "warning", ERROR: "error"}
MOST_ROWS = 500


@dataclass(frozen=True, slots=True)
class HtmlTable:
    """Header and rows of text; the last row is the fleet's."""

    header: list[str]
    rows: list[list[str]]


def metrics_html(table: Table) -> HtmlTable:
    """A terminal's table as one for a page: the same cells."""
    columns = [[_plain(cell) for cell in column.cells] for column in table.columns]
    return HtmlTable([_plain(column.header) for column in table.columns], [list(row) for row in zip(*columns, strict=True)])


def _plain(cell: object) -> str:
    text = cell.plain if isinstance(cell, Text) else Text.from_markup(str(cell)).plain
    return text.replace("-\n", "").replace("\n", " ").strip()


@dataclass(frozen=True, slots=True)
class AlarmRow:
    at_s: float
    robot: str
    level: str  # info, warning, error
    code: str
    text: str


def alarm_rows(data: ReportData) -> list[AlarmRow]:
    """Alarms, STOPs and lost records of all robots by time; the most severe if there are too many."""
    rows = [
        (one.level, AlarmRow(one.at_s, label_of(robot), LEVELS.get(one.level, "info"), one.code, one.text))
        for robot in data.robots
        for one in robot.happenings
        if one.kind in ("alarm", "stop", "loss")
    ]
    rows.sort(key=lambda row: (-row[0], row[1].at_s))
    return sorted((row for _, row in rows[:MOST_ROWS]), key=lambda row: row.at_s)


@dataclass(frozen=True, slots=True)
class ConflictRow:
    at_s: float
    robot: str
    other: int
    task: str
    cause: str
    outcome: str


def conflict_rows(data: ReportData) -> list[ConflictRow]:
    rows = [
        ConflictRow(
            one.at_s,
            label_of(robot),
            one.other,
            f"slot {one.slot}, generation {one.generation}",
            one.cause,
            "kept its claim" if one.kept else "gave its claim up",
        )
        for robot in data.robots
        for one in robot.conflicts
    ]
    return sorted(rows, key=lambda row: row.at_s)[:MOST_ROWS]
