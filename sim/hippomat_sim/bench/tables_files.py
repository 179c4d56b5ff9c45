"""The report's files: Markdown for people, one CSV line for each figure, and what --json prints."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from io import StringIO
from typing import Any

from hippomat_sim.bench.tables_figures import METRICS, Figure
from hippomat_sim.bench.tables_goals import Goal
from hippomat_sim.bench.tables_layout import Section, Table

CSV_COLUMNS = (
    "kind", "metric", "unit", "method", "agents", "tasks", "loss", "relay", "value", "low", "high", "count",
)  # fmt: skip


def as_markdown(title: str, preface: str, sections: Sequence[Section]) -> str:
    """The whole page."""
    parts = [f"# {title}", preface]
    for section in sections:
        parts += [f"## {section.title}", section.text]
        parts += [_markdown_table(table) for table in section.tables if table.rows]
        parts += [f"![{section.title}]({plot})" for plot in section.plots]
    return "\n\n".join(part.strip() for part in parts if part.strip()) + "\n"


def _markdown_table(table: Table) -> str:
    head = f"| {' | '.join(table.columns)} |"
    rule = "|---|" + "---:|" * (len(table.columns) - 1)
    lines = [f"**{table.title}**", "", head, rule, *(f"| {' | '.join(row)} |" for row in table.rows)]
    return "\n".join(lines + (["", table.note] if table.note else []))


def as_csv(figures: Sequence[Figure]) -> str:
    """One line for each figure, with CSV_COLUMNS as head."""
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for one in figures:
        writer.writerow(_flat(one)[column] for column in CSV_COLUMNS)
    return text.getvalue()


def as_json(
    settings: Mapping[str, Any], figures: Sequence[Figure], goals: Sequence[Goal], missing: Mapping[str, str]
) -> dict[str, Any]:
    """What --json prints; NaN becomes null."""
    return {
        "settings": dict(settings),
        "figures": [{name: _finite(value) for name, value in _flat(one).items()} for one in figures],
        "goals": [
            {
                "name": goal.name,
                "value": _finite(goal.value),
                "bound": goal.bound,
                "at_least": goal.at_least,
                "unit": goal.unit,
                "not_judged": goal.not_judged,
                "met": None if goal.not_judged else goal.met,
            }
            for goal in goals
        ],
        "not_trained": dict(missing),
        "met": not any(goal.missed for goal in goals),
    }


def _flat(one: Figure) -> dict[str, Any]:
    estimate = one.estimate
    return {
        "kind": one.kind,
        "metric": one.metric,
        "unit": METRICS[one.kind][one.metric][1],
        "method": one.method,
        "agents": one.agents,
        "tasks": one.tasks,
        "loss": one.loss,
        "relay": one.relay,
        "value": estimate.value,
        "low": estimate.low,
        "high": estimate.high,
        "count": estimate.count,
    }


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
