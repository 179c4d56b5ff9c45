"""From measurements to figures: every number of the tables, with its interval, in one list.

Tables, CSV, JSON, plots and goals read nothing but this list.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from hippomat_sim.bench import tables_cells as kinds
from hippomat_sim.bench.tables_cells import Cell
from hippomat_sim.bench.tables_measure import STEP_S
from hippomat_sim.bench.tables_run import Results
from hippomat_sim.bench.tables_stats import Estimate, difference, mean, ratio, ratio_of_ratios
from hippomat_sim.learn.evaluation import Figures

UNTRAINED = "graphsage_untrained"
LEARNED = ("graphsage", "graphsage_no_head")  # compared with the untrained head
_PERCENT = 100.0

# kind -> metric -> (what it is, unit)
METRICS: dict[str, dict[str, tuple[str, str]]] = {
    kinds.ONE_SHOT: {
        "cf1": ("tasks requested by exactly one agent in the first round, of min(N, M)", "%"),
        "ep": ("rounds without any conflict", "%"),
        "gap": ("total travel cost above the cheapest assignment", "%"),
        "rounds": ("allocation rounds until all are served", ""),
        "cost": ("total travel cost of an instance", "s"),
        "cost_over": ("total travel cost above Hungarian", "%"),
        "cf1_learned": ("CF1 minus that of the untrained head", "points"),
        "gap_learned": ("gap minus that of the untrained head", "points"),
        "left": ("agents that asked for nothing and had to be given a task", "%"),
    },
    kinds.CONTINUOUS: {
        "cf": ("requested tasks that exactly one agent requested", "%"),
        "ep": ("rounds without any conflict", "%"),
        "throughput": ("tasks allocated", "1/s"),
        "agent_s": ("agent-seconds per task", "s"),
        "agent_s_over": ("agent-seconds per task above Hungarian", "%"),
        "travel": ("travel cost per task", "s"),
        "travel_over": ("travel cost per task above Hungarian", "%"),
    },
    kinds.LOSS: {
        "cf1": ("tasks requested by exactly one agent in the first round, of min(N, M)", "%"),
        "cf1_over": ("the same minus Hungarian's from the same views", "points"),
    },
    kinds.PERMUTED: {
        "same_slot": ("agents that ask for the same slot when the tasks change places", "%"),
        "same_task": ("agents that ask for the same task when the tasks change places", "%"),
    },
    kinds.TIME: {
        "decision": ("one decision of one robot: median, and 5 to 95 % of the decisions", "ms"),
        "messages": ("messages of every robot in one allocation round", ""),
    },
}
METRICS[kinds.LOSS_CONTINUOUS] = METRICS[kinds.CONTINUOUS]


@dataclass(frozen=True, slots=True)
class Figure:
    """One number of the tables, in the unit that METRICS gives."""

    kind: str
    metric: str
    method: str
    agents: int
    tasks: int
    loss: float
    relay: bool
    estimate: Estimate


def figures_of(results: Results) -> list[Figure]:
    """Every figure that the measurements give."""
    return [
        Figure(cell.kind, metric, cell.method, cell.agents, cell.tasks, cell.loss, cell.relay, estimate)
        for cell in results.figures
        if cell.method != kinds.OPTIMUM
        for metric, estimate in _MAKERS[cell.kind](cell, results)
    ]


def _other(cell: Cell, method: str, results: Results, count: int) -> Figures | None:
    """The figures of another method on the first `count` of the same instances."""
    same = replace(cell, method=method, count=0)
    for candidate, figures in results.figures.items():
        if replace(candidate, count=0) == same:
            return {name: array[:count] for name, array in figures.items()}
    return None


def _one_shot(cell: Cell, results: Results) -> Iterator[tuple[str, Estimate]]:
    figures = results.figures[cell]
    count = len(figures["single"])
    tasks = np.full(count, min(cell.agents, cell.tasks))
    yield "cf1", ratio(figures["single"], tasks).scaled(_PERCENT)
    yield "ep", ratio(figures["clean"], figures["rounds"]).scaled(_PERCENT)
    yield "rounds", mean(figures["rounds"])
    yield "cost", mean(figures["cost_ms"]).scaled(1e-3)
    yield "left", ratio(figures["left"], np.full(count, cell.agents)).scaled(_PERCENT)
    other = _other(cell, kinds.REFERENCE, results, count)
    if other is not None:
        yield "cost_over", ratio(figures["cost_ms"], other["cost_ms"]).scaled(_PERCENT, -_PERCENT)
    optimum = _other(cell, kinds.OPTIMUM, results, count)
    if optimum is not None:
        yield "gap", ratio(figures["cost_ms"], optimum["cost_ms"]).scaled(_PERCENT, -_PERCENT)
    untrained = _other(cell, UNTRAINED, results, count) if cell.method in LEARNED else None
    if optimum is not None and untrained is not None:
        least = optimum["cost_ms"]
        yield "cf1_learned", difference(figures["single"], tasks, untrained["single"], tasks).scaled(_PERCENT)
        more = difference(figures["cost_ms"], least, untrained["cost_ms"], least)
        yield "gap_learned", more.scaled(_PERCENT)


def _continuous(cell: Cell, results: Results) -> Iterator[tuple[str, Estimate]]:
    figures = results.figures[cell]
    served, cost, steps = figures["served"], figures["cost_ms"], figures["steps"]
    yield "cf", ratio(figures["requested"] - figures["contested"], figures["requested"]).scaled(_PERCENT)
    yield "ep", ratio(figures["clean"], steps).scaled(_PERCENT)
    yield "throughput", ratio(served, steps).scaled(1.0 / STEP_S)
    yield "agent_s", ratio(steps, served).scaled(STEP_S * cell.agents)
    yield "travel", ratio(cost, served).scaled(1e-3)
    other = _other(cell, kinds.REFERENCE, results, len(served))
    if other is not None:
        more = ratio_of_ratios(steps, served, other["steps"], other["served"])
        yield "agent_s_over", more.scaled(_PERCENT, -_PERCENT)
        more = ratio_of_ratios(cost, served, other["cost_ms"], other["served"])
        yield "travel_over", more.scaled(_PERCENT, -_PERCENT)


def _loss(cell: Cell, results: Results) -> Iterator[tuple[str, Estimate]]:
    single = results.figures[cell]["single"]
    tasks = np.full(len(single), min(cell.agents, cell.tasks))
    yield "cf1", ratio(single, tasks).scaled(_PERCENT)
    other = _other(cell, kinds.REFERENCE, results, len(single))
    if other is not None:
        yield "cf1_over", difference(single, tasks, other["single"], tasks).scaled(_PERCENT)


def _permuted(cell: Cell, results: Results) -> Iterator[tuple[str, Estimate]]:
    figures = results.figures[cell]
    yield "same_slot", ratio(figures["same_slot"], figures["asked"]).scaled(_PERCENT)
    yield "same_task", ratio(figures["same_task"], figures["asked"]).scaled(_PERCENT)


def _time(cell: Cell, results: Results) -> Iterator[tuple[str, Estimate]]:
    spent_ms = results.figures[cell]["decision_ns"] / 1e6
    median, low, high = (float(value) for value in np.percentile(spent_ms, (50, 5, 95)))
    yield "decision", Estimate(median, low, high, len(spent_ms))
    yield "messages", mean(results.figures[cell]["messages"])


_MAKERS = {
    kinds.ONE_SHOT: _one_shot,
    kinds.CONTINUOUS: _continuous,
    kinds.LOSS_CONTINUOUS: _continuous,
    kinds.LOSS: _loss,
    kinds.PERMUTED: _permuted,
    kinds.TIME: _time,
}
