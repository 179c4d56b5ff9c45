"""Ask every query of a scenario, and a sample of it the others too; judge every answer. Prints nothing.

Times are processor time of the one thread that works, so that a busy machine distorts them little.

A length counts as right within 1e-3 of the published one, or within its last printed digit. A path is
feasible where planning/feasibility.py finds no fault, which shares no code with any planner.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.planning.astar import plane_path
from hippomat_core.planning.feasibility import path_fault
from hippomat_core.planning.graph import CellPlane, cell_plane
from hippomat_sim.bench.plan_peers import Finder, Found, peers
from hippomat_sim.bench.plan_plain import plain_path
from hippomat_sim.maps.movingai import Query, Scenario

RELATIVE = 1e-3
OURS, PLAIN = "hippomat", "heapq A*"
REPEATS = 5

Progress = Callable[[str, int, int], None]  # what, done, of


@dataclass(frozen=True, slots=True)
class Answers:
    """What one planner did with its queries."""

    planner: str
    queries: int
    wrong: int  # lengths, or no answer
    infeasible: int  # paths; -1 where only lengths were given
    median_ms: float
    ours_ms: float  # our median on the same queries, asked in turn with it

    @property
    def ratio(self) -> float:
        """How many times as long as we it took."""
        return self.median_ms / self.ours_ms


@dataclass(frozen=True, slots=True)
class FileResult:
    """One scenario: our answers to all its queries, the others' to a sample."""

    name: str
    cells: int
    prepare_ms: float
    ours: Answers
    others: list[Answers]
    missing: list[str]  # peers that are not installed


def run_file(scenario: Scenario, names: Sequence[str], sample: int, progress: Progress) -> FileResult:
    """names: of peers to ask beside the plain one."""
    cell_plane(scenario.free[:4, :4])  # compiled now
    begun_ns = time.thread_time_ns()
    plane = cell_plane(scenario.free)
    prepare_ms = (time.thread_time_ns() - begun_ns) / 1e6
    ours = _all_of_ours(scenario, plane, progress)
    queries = sampled(scenario.queries, sample)
    rows = scenario.free.tolist()
    finders: dict[str, Finder] = {PLAIN: lambda start, goal: _as_array(plain_path(rows, start, goal))}
    missing, most = [], {}
    for name in names:
        peer = peers()[name]
        try:
            finders[name], most[name] = peer.prepare(scenario.free), peer.most
        except ImportError:
            missing.append(name)
    others = [
        _compared(scenario, plane, name, finder, queries[: most.get(name, len(queries))], progress)
        for name, finder in finders.items()
    ]
    return FileResult(scenario.name, scenario.free.size, prepare_ms, ours, others, missing)


def sampled(queries: Sequence[Query], count: int) -> list[Query]:
    """At most `count`, of every length alike: evenly spread over the buckets' order, in a seeded order."""
    ordered = sorted(queries, key=lambda query: (query.bucket, query.length, query.start, query.goal))
    places = np.unique(np.linspace(0, len(ordered) - 1, min(count, len(ordered))).round().astype(int))
    return [ordered[place] for place in np.random.default_rng(0).permutation(places)]


def _all_of_ours(scenario: Scenario, plane: CellPlane, progress: Progress) -> Answers:
    judge, times = _Judge(scenario.free), []
    for done, query in enumerate(scenario.queries, start=1):
        path, took_ms = _timed(lambda start, goal: plane_path(plane, start, goal), query)
        judge.see(query, path)
        times.append(took_ms)
        progress(f"{scenario.name}: {OURS}", done, len(scenario.queries))
    median_ms = statistics.median(times)
    return Answers(OURS, len(times), judge.wrong, judge.infeasible, median_ms, median_ms)


def _compared(
    scenario: Scenario,
    plane: CellPlane,
    name: str,
    finder: Finder,
    queries: Sequence[Query],
    progress: Progress,
) -> Answers:
    """Theirs and ours in turn, so that a drifting machine touches both alike."""
    judge, times, ours = _Judge(scenario.free), [], []
    for done, query in enumerate(queries, start=1):
        path, took_ms = _timed(finder, query)
        judge.see(query, path)
        times.append(took_ms)
        begun_ns = time.thread_time_ns()
        for _ in range(REPEATS):
            plane_path(plane, query.start, query.goal)
        ours.append((time.thread_time_ns() - begun_ns) / 1e6 / REPEATS)
        progress(f"{scenario.name}: {name}", done, len(queries))
    infeasible = -1 if judge.lengths_only else judge.infeasible
    return Answers(
        name, len(times), judge.wrong, infeasible, statistics.median(times), statistics.median(ours)
    )


class _Judge:
    """Counts wrong and infeasible answers."""

    def __init__(self, free: NDArray[np.bool_]) -> None:
        self._free = free
        self.wrong = self.infeasible = 0
        self.lengths_only = False

    def see(self, query: Query, found: Found) -> None:
        """found: a path, a length, or None, which is a wrong answer: every query has a way."""
        if found is None:
            self.wrong += 1
            return
        if isinstance(found, float):
            self.lengths_only, length = True, found
        else:
            length = path_length(found)
            self.infeasible += bool(path_fault(self._free, found, query.start, query.goal))
        self.wrong += abs(length - query.length) > max(RELATIVE * query.length, query.rounding)


def path_length(path: NDArray[np.int32]) -> float:
    """[cells] from centre to centre."""
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def _timed(finder: Finder, query: Query) -> tuple[Found, float]:
    begun_ns = time.thread_time_ns()
    found = finder(query.start, query.goal)
    return found, (time.thread_time_ns() - begun_ns) / 1e6


def _as_array(path: list[tuple[int, int]] | None) -> NDArray[np.int32] | None:
    return None if path is None else np.array(path, np.int32)
