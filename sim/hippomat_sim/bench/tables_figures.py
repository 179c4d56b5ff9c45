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
from hippomat_sim.learn.evaluation import Figures, Ints

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


def _with_worlds(cell: Cell, results: Results) -> tuple[Figures, Ints | None]:
    """The cell's figures, and the world of each instance where they have it."""
    figures = results.figures[cell]
    return figures, figures.get("world")


def _one_shot(cell: Cell, results: Results) -> Iterator[tuple[str, Estimate]]:
    figures, worlds = _with_worlds(cell, results)
    count = len(figures["single"])
    tasks = np.full(count, min(cell.agents, cell.tasks))
    yield "cf1", ratio(figures["single"], tasks, worlds).scaled(_PERCENT)
    yield "ep", ratio(figures["clean"], figures["rounds"], worlds).scaled(_PERCENT)
    yield "rounds", mean(figures["rounds"], worlds)
    yield "cost", mean(figures["cost_ms"], worlds).scaled(1e-3)
    yield "left", ratio(figures["left"], np.full(count, cell.agents), worlds).scaled(_PERCENT)
    other = _other(cell, kinds.REFERENCE, results, count)
    if other is not None:
        over = ratio(figures["cost_ms"], other["cost_ms"], worlds)
        yield "cost_over", over.scaled(_PERCENT, -_PERCENT)
    optimum = _other(cell, kinds.OPTIMUM, results, count)
    if optimum is not None:
        over = ratio(figures["cost_ms"], optimum["cost_ms"], worlds)
        yield "gap", over.scaled(_PERCENT, -_PERCENT)
    untrained = _other(cell, UNTRAINED, results, count) if cell.method in LEARNED else None
    if optimum is not None and untrained is not None:
        least = optimum["cost_ms"]
        more = difference(figures["single"], tasks, untrained["single"], tasks, worlds)
        yield "cf1_learned", more.scaled(_PERCENT)
        more = difference(figures["cost_ms"], least, untrained["cost_ms"], least, worlds)
        yield "gap_learned", more.scaled(_PERCENT)


def _continuous(cell: Cell, results: Results) -> Iterator[tuple[str, Estimate]]:
    figures, worlds = _with_worlds(cell, results)
    served, cost, steps = figures["served"], figures["cost_ms"], figures["steps"]
    single = figures["requested"] - figures["contested"]
    yield "cf", ratio(single, figures["requested"], worlds).scaled(_PERCENT)
    yield "ep", ratio(figures["clean"], steps, worlds).scaled(_PERCENT)
    yield "throughput", ratio(served, steps, worlds).scaled(1.0 / STEP_S)
    yield "agent_s", ratio(steps, served, worlds).scaled(STEP_S * cell.agents)
    yield "travel", ratio(cost, served, worlds).scaled(1e-3)
    other = _other(cell, kinds.REFERENCE, results, len(served))
    if other is not None:
        more = ratio_of_ratios(steps, served, other["steps"], other["served"], worlds)
        yield "agent_s_over", more.scaled(_PERCENT, -_PERCENT)
        more = ratio_of_ratios(cost, served, other["cost_ms"], other["served"], worlds)
        yield "travel_over", more.scaled(_PERCENT, -_PERCENT)


def _loss(cell: Cell, results: Results) -> Iterator[tuple[str, Estimate]]:
    figures, worlds = _with_worlds(cell, results)
    single = figures["single"]
    tasks = np.full(len(single), min(cell.agents, cell.tasks))
    yield "cf1", ratio(single, tasks, worlds).scaled(_PERCENT)
    other = _other(cell, kinds.REFERENCE, results, len(single))
    if other is not None:
        yield "cf1_over", difference(single, tasks, other["single"], tasks, worlds).scaled(_PERCENT)


def _permuted(cell: Cell, results: Results) -> Iterator[tuple[str, Estimate]]:
    figures, worlds = _with_worlds(cell, results)
    yield "same_slot", ratio(figures["same_slot"], figures["asked"], worlds).scaled(_PERCENT)
    yield "same_task", ratio(figures["same_task"], figures["asked"], worlds).scaled(_PERCENT)


def _time(cell: Cell, results: Results) -> Iterator[tuple[str, Estimate]]:
    figures, worlds = _with_worlds(cell, results)
    spent_ms = figures["decision_ns"] / 1e6
    median, low, high = (float(value) for value in np.percentile(spent_ms, (50, 5, 95)))
    yield "decision", Estimate(median, low, high, len(spent_ms))
    yield "messages", mean(figures["messages"], worlds)


_MAKERS = {
    kinds.ONE_SHOT: _one_shot,
    kinds.CONTINUOUS: _continuous,
    kinds.LOSS_CONTINUOUS: _continuous,
    kinds.LOSS: _loss,
    kinds.PERMUTED: _permuted,
    kinds.TIME: _time,
}
