"""Measures the cells of a plan, in several processes, and keeps what is done. Knows no table."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import Any

import numpy as np

from hippomat_core.allocation.port import Problem
from hippomat_sim.bench import tables_cells as kinds
from hippomat_sim.bench.tables_cells import Cell, Plan
from hippomat_sim.bench.tables_store import Store, code_hash, key_of
from hippomat_sim.learn.evaluation import (
    Figures,
    play_continuous,
    play_first_requests,
    play_one_shot,
    play_optimum,
    play_permuted,
)
from hippomat_sim.learn.instances import Instances, draw_instances
from hippomat_sim.learn.method_registry import METHODS, NotTrained, Sources, make_method
from hippomat_sim.learn.methods import Method
from hippomat_sim.learn.runs import Fleet
from hippomat_sim.learn.settings import EnvSettings, WorldSettings
from hippomat_sim.learn.world_pool import WorldPool, make_pool

STEPS, WARM_UP_STEPS = 400, 40  # of the continuous mode: 100 s count, 10 s do not
STEP_S = EnvSettings().step_s
TEST_SPLIT = "test"  # worlds that no training ever saw

Tell = Callable[[str, int, int], None]  # what is measured now, how many cells are done, of how many


@dataclass(slots=True)
class Results:
    """figures: of every cell that could be measured. missing: why the others could not."""

    figures: dict[Cell, Figures] = field(default_factory=dict)
    missing: dict[Cell, str] = field(default_factory=dict)
    fingerprints: dict[str, str] = field(default_factory=dict)  # method -> hash of its weights


@dataclass(frozen=True, slots=True)
class Bench:
    """What every cell needs to be measured."""

    world: WorldSettings
    sources: Sources
    seed: int


def turnover_of(cell: Cell) -> str:
    """More slots than agents are those of continuous tasks."""
    continuous = cell.kind in (kinds.CONTINUOUS, kinds.LOSS_CONTINUOUS)
    permuted = cell.kind == kinds.PERMUTED and cell.tasks != cell.agents
    return "on_claim" if continuous or permuted else "never"


def fleet_of(cell: Cell) -> Fleet:
    """What the cell's method has to work for."""
    return Fleet(cell.agents, cell.tasks, turnover_of(cell))


def environment_of(cell: Cell, world: WorldSettings) -> EnvSettings:
    """The learning environment that a cell is measured in."""
    return EnvSettings(
        agents=cell.agents,
        tasks=cell.tasks,
        turnover=turnover_of(cell),
        step_s=STEP_S,
        episode_steps=STEPS,
        loss=cell.loss,
        relay=cell.relay,
        world=world,
    )


def measure(cell: Cell, bench: Bench, pool: WorldPool) -> Figures:
    """The figures of one cell; NotTrained where its weights are missing."""
    if cell.method == kinds.OPTIMUM:
        return play_optimum(_instances(cell, bench, pool))
    method = make_method(cell.method, fleet_of(cell), bench.sources)
    if cell.kind == kinds.ONE_SHOT:
        return play_one_shot(method, _instances(cell, bench, pool))
    if cell.kind == kinds.PERMUTED:
        return play_permuted(method, _instances(cell, bench, pool), bench.seed)
    if cell.kind == kinds.TIME:
        return play_timed(method, METHODS[cell.method].messages, _instances(cell, bench, pool))
    settings = environment_of(cell, bench.world)
    if cell.kind == kinds.LOSS:
        return play_first_requests(method, settings, pool, cell.count, bench.seed)
    return play_continuous(method, settings, pool, cell.count, bench.seed, WARM_UP_STEPS)


def play_timed(method: Method, messages: Callable[[Problem], int], instances: Instances) -> Figures:
    """Wall time of one decision of one robot, and how many messages it takes; (B,).

    The first decision, which compiles and fills caches, does not count.
    """
    count, agents, tasks = instances.costs_q.shape
    free, waiting = np.ones((1, agents), np.bool_), np.ones((1, tasks), np.bool_)
    spent, sent = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for index in (0, *range(count)):
        which = np.array([index])
        problems, own = instances.problems(which, free, waiting), np.array([index % agents])
        start = time.perf_counter_ns()
        method.own_actions(problems, own, which, 0)
        spent[index] = time.perf_counter_ns() - start
        sent[index] = messages(problems.problem(0))
    return {"decision_ns": spent, "messages": sent}


def _instances(cell: Cell, bench: Bench, pool: WorldPool) -> Instances:
    return draw_instances(pool, cell.count, cell.agents, cell.tasks, bench.seed)


def run(plan: Plan, bench: Bench, pool: WorldPool, store: Store, jobs: int, tell: Tell) -> Results:
    """Everything that the plan asks for: from the store, or measured now."""
    results, cells = Results(), plan.cells()
    figures: dict[Cell, Figures] = {}
    keys = {cell: key for cell in cells if (key := _key(cell, bench, pool, results)) is not None}
    due = []
    for cell, key in keys.items():
        stored = store.get(key)
        if stored is None:
            due.append(cell)
        else:
            figures[cell] = stored
    tell("measuring", len(cells) - len(due), len(cells))
    for done, (cell, figures[cell]) in enumerate(_measured(due, bench, pool, jobs), start=1):
        store.put(keys[cell], figures[cell])
        tell(cell.about, len(cells) - len(due) + done, len(cells))
    results.figures = {cell: figures[cell] for cell in keys}  # in the plan's order, however they were done
    return results


def _key(cell: Cell, bench: Bench, pool: WorldPool, results: Results) -> str | None:
    """None where the method's weights are missing, which is noted."""
    fingerprint = ""
    if cell.method != kinds.OPTIMUM:
        try:
            fingerprint = make_method(cell.method, fleet_of(cell), bench.sources).fingerprint
        except NotTrained as error:
            results.missing[cell] = str(error)
            return None
        if fingerprint:
            results.fingerprints[cell.method] = fingerprint
    facts: dict[str, Any] = {
        "seed": bench.seed,
        "pool": pool.hash,
        "weights": fingerprint,
        "code": code_hash(),
        "steps": [STEPS, WARM_UP_STEPS, STEP_S],
    }
    return key_of(cell, facts)


def _measured(
    due: Sequence[Cell], bench: Bench, pool: WorldPool, jobs: int
) -> Iterator[tuple[Cell, Figures]]:
    """In the order in which they are done. Cells that are timed run here and alone."""
    shared = [cell for cell in due if cell.kind != kinds.TIME]
    if jobs > 1 and len(shared) > 1:
        with get_context("spawn").Pool(jobs, _prepare_worker, (bench,)) as workers:
            yield from workers.imap_unordered(_measure_in_worker, shared)
        shared = []
    for cell in (*shared, *(cell for cell in due if cell.kind == kinds.TIME)):
        yield cell, measure(cell, bench, pool)


_worker: tuple[Bench, WorldPool] | None = None


def _prepare_worker(bench: Bench) -> None:
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all: the parent says it, and ends us
    _worker = bench, make_pool(bench.world, TEST_SPLIT)


def _measure_in_worker(cell: Cell) -> tuple[Cell, Figures]:
    assert _worker is not None
    return cell, measure(cell, *_worker)
