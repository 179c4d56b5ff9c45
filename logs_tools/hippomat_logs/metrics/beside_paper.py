"""The paper's three metrics for one fleet, with the paper's own values beside them, and why they differ."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hippomat_core.config import Config
from hippomat_logs import paper_values as paper
from hippomat_logs.metrics.figures import NONE, number
from hippomat_logs.metrics.fleet import FleetMetrics

CAVEAT = (
    "The paper states neither its instances and map nor its unit of cost and number\n"
    "of continuous tasks, and this is another place: compare orders of methods, not\n"
    "sizes."
)


@dataclass(frozen=True, slots=True)
class PaperRow:
    """One of the paper's metrics: ours as text, and what the paper prints for this method and size."""

    metric: str
    ours: str
    printed: float | None


@dataclass(frozen=True, slots=True)
class Beside:
    """title: which of the paper's tables. rows: empty where it has none of this kind; then `why` says so."""

    title: str
    rows: tuple[PaperRow, ...]
    why: str = ""


def beside_paper(metrics: FleetMetrics) -> Beside:
    """What the paper has for this fleet's size, allocator and kind of allocation."""
    config = metrics.config
    if config is None:
        return Beside("", (), "the configuration is not known")
    fixed = config.fleet.turnover == "never"
    kind = "fixed" if fixed else "continuous"
    method = paper.method_of(config.fleet.allocator)
    title = f"{method}, {config.fleet.size} agents, {kind} tasks"
    if not method:
        return Beside(title, (), f"it has no values for the allocator {config.fleet.allocator}")
    rows = _rows(metrics, config, method, fixed)
    if all(row.printed is None for row in rows):
        sizes = ", ".join(map(str, paper.sizes(paper.FIXED_SUCCESS if fixed else paper.CONTINUOUS_SUCCESS)))
        return Beside(title, (), f"it has no values for {config.fleet.size} agents ({kind}: {sizes})")
    return Beside(title, rows)


def _rows(metrics: FleetMetrics, config: Config, method: str, fixed: bool) -> tuple[PaperRow, ...]:
    size = config.fleet.size
    cost, success = (
        (paper.FIXED_COST, paper.FIXED_SUCCESS)
        if fixed
        else (paper.CONTINUOUS_COST, paper.CONTINUOUS_SUCCESS)
    )
    done = len(metrics.completed)
    cost_text, of = number(metrics.travel_cost_s, 1), metrics.coverage and f" ({metrics.coverage})"
    rows = [
        PaperRow(
            "total travel cost",
            cost_text if cost_text == NONE else f"{cost_text} s, {done} tasks{of}",
            paper.paper_value(cost, method, size),
        ),
        PaperRow(
            "conflict-free success rate [%]",
            f"{number(100 * metrics.conflict_free_rate, 1)}{of}",
            paper.paper_value(success, method, size),
        ),
    ]
    if fixed:
        time = paper.paper_value(paper.FIXED_TIME, method, size)
        rows.append(
            PaperRow("time to allocate all tasks [s]", f"{number(metrics.all_allocated_s, 1)}{of}", time)
        )
    return tuple(rows)


def printed_text(value: float | None) -> str:
    """As the paper prints it."""
    return NONE if value is None or math.isnan(value) else f"{value:g}"
