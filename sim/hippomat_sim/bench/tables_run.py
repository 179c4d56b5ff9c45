"""Measures the cells of a plan, in several processes, and keeps what is done. Knows no table."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import Any

from hippomat_sim.bench import tables_cells as kinds
from hippomat_sim.bench.tables_cells import Cell, Plan
from hippomat_sim.bench.tables_measure import TEST_SPLIT, Bench, fleet_of, measure
from hippomat_sim.bench.tables_store import Store, code_hash, key_of
from hippomat_sim.learn.evaluation import Figures
from hippomat_sim.learn.method_registry import NotTrained, make_method
from hippomat_sim.learn.world_pool import WorldPool, make_pool

Tell = Callable[[str, int, int], None]  # what is measured now, how many cells are done, of how many


@dataclass(slots=True)
class Results:
    """figures: of every cell that could be measured. missing: why the others could not."""

    figures: dict[Cell, Figures] = field(default_factory=dict)
    missing: dict[Cell, str] = field(default_factory=dict)
    fingerprints: dict[str, str] = field(default_factory=dict)  # method -> hash of its weights


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
    }
    if cell.kind == kinds.TIME:  # another machine takes another time
        facts["machine"] = bench.machine
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
