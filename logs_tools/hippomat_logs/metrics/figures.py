"""The figures of a fleet's run that tables are made of: name, unit, digits, and how each comes about.

Decides what is shown and how it is rounded. docs/metrics.md defines each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from hippomat_core.errors import HippomatError
from hippomat_logs.metrics.fleet import FleetMetrics
from hippomat_logs.metrics.links import LinkMetrics
from hippomat_logs.metrics.samples import mean, quantiles

NONE = "-"


@dataclass(frozen=True, slots=True)
class Figure:
    """One number of a fleet's run; nan where the run has no value for it."""

    key: str
    label: str
    unit: str  # empty: a count
    digits: int
    of: Callable[[FleetMetrics], float]

    @property
    def title(self) -> str:
        return f"{self.label} [{self.unit}]" if self.unit else self.label


def per_task(total: Callable[[FleetMetrics], float]) -> Callable[[FleetMetrics], float]:
    """That, over the tasks that were completed; nan where none was."""

    def of(fleet: FleetMetrics) -> float:
        done = len(fleet.completed)
        return total(fleet) / done if done else math.nan

    return of


def over_links(of: Callable[[LinkMetrics], float]) -> Callable[[FleetMetrics], float]:
    """Mean over the directions that have a value."""
    return lambda fleet: mean(of(link) for robot in fleet.robots for link in robot.links)


def most(values: Iterable[float]) -> float:
    """The largest of those that are numbers; nan where none is."""
    return max((value for value in values if not math.isnan(value)), default=math.nan)


def _compute_ms(share: float) -> Callable[[FleetMetrics], float]:
    def of(fleet: FleetMetrics) -> float:
        values = fleet.compute_ms
        return float(np.quantile(values, share)) if values.size else math.nan

    return of


FIGURES: tuple[Figure, ...] = (
    Figure("completed", "tasks completed", "", 0, lambda f: len(f.completed)),
    Figure("rate", "tasks per minute", "1/min", 2, lambda f: f.tasks_per_min),
    Figure("cost", "total travel cost", "s", 1, lambda f: f.travel_cost_s),
    Figure("cost_per_task", "travel cost per task", "s", 2, per_task(lambda f: f.travel_cost_s)),
    Figure("travel_per_task", "travel time per task", "s", 2, per_task(lambda f: f.travel_time_s)),
    Figure("driven", "distance driven", "m", 1, lambda f: f.driven_m),
    Figure("cf1", "conflict-free CF1", "%", 1, lambda f: 100.0 * f.conflict_free_rate),
    Figure("twice", "completed twice", "", 0, lambda f: len(f.completed_twice)),
    Figure("allocation", "allocation time", "s", 2, lambda f: quantiles(f.allocation_s)[0]),
    Figure("settling", "request to confirmation", "s", 2, lambda f: quantiles(f.settling_s)[0]),
    Figure("all_allocated", "all allocated after", "s", 1, lambda f: f.all_allocated_s),
    Figure("delivery", "frames delivered", "%", 1, lambda f: 100.0 * f.delivery),
    Figure("in_time", "rows in time", "%", 1, lambda f: 100.0 * f.rows_in_time),
    Figure("relayed", "of them relayed", "%", 1, lambda f: 100.0 * f.rows_relayed),
    Figure("rssi", "RSSI", "dBm", 0, over_links(lambda link: link.rssi_dbm)),
    Figure("state_age", "age of STATE", "ms", 0, over_links(lambda link: link.state_age_ms)),
    Figure("row_age", "age of rows", "ms", 0, over_links(lambda link: link.row_age_ms)),
    Figure("latency", "STATE core to core", "ms", 1, lambda f: f.latency_ms),
    Figure("compute", "compute, median", "ms", 1, _compute_ms(0.5)),
    Figure("compute_95", "compute, 95 %", "ms", 1, _compute_ms(0.95)),
    Figure("cpu", "processor", "%", 1, lambda f: mean(100.0 * r.computer.cpu_share for r in f.robots)),
)
PAPER = ("completed", "rate", "cost_per_task", "cf1", "allocation", "delivery")  # a paper's table has


def figures_of(fleet: FleetMetrics) -> dict[str, float]:
    return {figure.key: float(figure.of(fleet)) for figure in FIGURES}


def chosen(keys: Sequence[str]) -> list[Figure]:
    """In the order given; raises HippomatError for a name that is none."""
    by_key = {figure.key: figure for figure in FIGURES}
    for key in keys:
        if key not in by_key:
            raise HippomatError(f"--figures {key}: there is none of that name; there are {', '.join(by_key)}")
    return [by_key[key] for key in keys]


def number(value: float, digits: int) -> str:
    """Rounded; "-" where there is no value."""
    if math.isnan(value):
        return NONE
    text = f"{value:,.{digits}f}"
    return text.removeprefix("-") if float(text.replace(",", "")) == 0.0 else text
