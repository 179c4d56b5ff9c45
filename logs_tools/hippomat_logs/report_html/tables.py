"""The report's tables as rows of text; how they look is the page's."""

from __future__ import annotations

from dataclasses import dataclass

from rich.table import Table
from rich.text import Text

from hippomat_core.fleet.robot_names import named
from hippomat_core.messages import ERROR, WARNING
from hippomat_logs.report_html.data import ReportData

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
    return HtmlTable(
        [_plain(column.header) for column in table.columns], [list(row) for row in zip(*columns, strict=True)]
    )


def _plain(cell: object) -> str:
    text = cell.plain if isinstance(cell, Text) else Text.from_markup(str(cell)).plain
    return text.replace("-\n", "").replace("\n", " ").strip()


@dataclass(frozen=True, slots=True)
class AlarmRow:
    """One text, as often as it was said."""

    level: str  # info, warning, error
    code: str
    text: str
    robots: str
    at_s: list[float]


def alarm_rows(data: ReportData) -> list[AlarmRow]:
    """Alarms, STOPs and lost records of all robots by their first time; the worst, if there are many."""
    told: dict[tuple[int, str, str], list[tuple[float, int]]] = {}
    for robot in data.robots:
        for one in robot.happenings:
            if one.kind in ("alarm", "stop", "loss"):
                told.setdefault((one.level, one.code, one.text), []).append((one.at_s, robot.robot))
    severe = sorted(told, key=lambda key: (-key[0], min(told[key])))[:MOST_ROWS]
    return [
        AlarmRow(
            LEVELS.get(level, "info"),
            code,
            text,
            named(sorted({robot for _, robot in told[level, code, text]})),
            sorted(at_s for at_s, _ in told[level, code, text]),
        )
        for level, code, text in sorted(severe, key=lambda key: min(told[key]))
    ]
