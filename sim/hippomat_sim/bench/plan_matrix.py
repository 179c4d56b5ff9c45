"""What one decision's travel costs cost: 30 agents x 30 tasks in 50 x 50 x 30 cells, one task replaced.

Three cells of ten, drawn at random, are obstacles; with two of ten the ratio to plain A* is half as large.

Ours keeps a distance field per task, so that a replaced task costs one field and the matrix a look-up; the
yardstick asks plain A* for every pair. Our own A* in the air is asked for the same pairs. Prints nothing.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from hippomat_core.planning.astar3d import shortest_path_3d
from hippomat_core.planning.feasibility import path_fault_3d
from hippomat_core.planning.field3d import CellSpace, cell_space, distance_field_3d
from hippomat_core.planning.field_cache import Fields
from hippomat_core.planning.graph import STRAIGHT, UNREACHED
from hippomat_sim.bench.plan_plain import Cell3, plain_length_3d
from hippomat_sim.bench.plan_run import Progress

AGENTS = TASKS = 30
SHAPE = (30, 50, 50)  # (Z, Y, X)
OBSTACLES, SEED = 0.3, 0
REPLACED = 41  # decisions that are timed, one replaced task each
RELATIVE = 1e-6


@dataclass(frozen=True, slots=True)
class MatrixResult:
    """Per decision."""

    pairs: int  # asked of the plain A*, the same number of every row
    wrong: int  # values that differ, of the matrix or of our A*
    infeasible: int  # paths of our A*
    field_ms: float  # of it: the replaced task's field
    lookup_us: float  # and the matrix
    decision_ms: float
    plain_ms: float  # for all AGENTS x TASKS pairs
    path_ratio: float  # plain A* / our A*, medians of single paths
    sampled: bool

    @property
    def ratio(self) -> float:
        """How many times as long plain A* takes."""
        return self.plain_ms / self.decision_ms


def run_matrix(limit: int, progress: Progress) -> MatrixResult:
    """limit: at most so many pairs are asked of the plain A*; its time is scaled up to all of them."""
    space = cell_space(np.random.default_rng(SEED).random(SHAPE) >= OBSTACLES)
    places = _places(space, AGENTS + TASKS + REPLACED)
    agents, sites = places[:AGENTS], places[AGENTS:]
    decisions = _Decisions(space, agents, sites)
    units = decisions.units
    pairs = _pairs(limit)
    asked = _asked(space, agents, sites, pairs, decisions, progress)
    found = np.array([units[pair] / STRAIGHT if units[pair] != UNREACHED else np.inf for pair in pairs])
    wrong = ~np.isclose(found, asked.plain, rtol=RELATIVE, atol=0.0)
    wrong |= ~np.isclose(asked.ours, asked.plain, rtol=RELATIVE, atol=0.0)
    return MatrixResult(
        pairs=len(pairs),
        wrong=int(np.count_nonzero(wrong)),
        infeasible=asked.infeasible,
        field_ms=statistics.median(decisions.fields_ms),
        lookup_us=1e3 * statistics.median(decisions.lookups_ms),
        decision_ms=statistics.median(map(sum, zip(decisions.fields_ms, decisions.lookups_ms, strict=True))),
        plain_ms=sum(asked.plain_ms) * AGENTS * TASKS / len(pairs),
        path_ratio=statistics.median(asked.plain_ms) / statistics.median(asked.ours_ms),
        sampled=len(pairs) < AGENTS * TASKS,
    )


class _Decisions:
    """Ours: fields kept from one decision to the next. sites: of the first TASKS tasks, then of others."""

    def __init__(self, space: CellSpace, agents: list[Cell3], sites: list[Cell3]) -> None:
        self._space, self._sites = space, sites
        self._nodes = np.array([space.node_of(cell) for cell in agents])
        self._goals = {(slot, 0): sites[slot] for slot in range(TASKS)}
        self._fields = Fields({}).with_goals(space, self._goals, 1.0)
        self.units = self._fields.matrix(list(self._goals), self._nodes)  # (AGENTS, TASKS)
        self.fields_ms: list[float] = []
        self.lookups_ms: list[float] = []

    def replace_a_task(self) -> None:
        """One more decision, after one more task was replaced."""
        turn = len(self.fields_ms)
        slot = turn % TASKS
        self._goals = {key: goal for key, goal in self._goals.items() if key[0] != slot}
        self._goals[slot, turn + 1] = self._sites[TASKS + turn]
        begun_ns = time.thread_time_ns()
        self._fields = self._fields.with_goals(self._space, self._goals, 1.0)
        between_ns = time.thread_time_ns()
        self.units = self._fields.matrix(list(self._goals), self._nodes)
        ended_ns = time.thread_time_ns()
        self.fields_ms.append((between_ns - begun_ns) / 1e6)
        self.lookups_ms.append((ended_ns - between_ns) / 1e6)


@dataclass(slots=True)
class _Asked:
    """Lengths [cells] and times per pair."""

    plain: list[float] = field(default_factory=list)
    ours: list[float] = field(default_factory=list)
    plain_ms: list[float] = field(default_factory=list)
    ours_ms: list[float] = field(default_factory=list)
    infeasible: int = 0


def _pairs(limit: int) -> list[tuple[int, int]]:
    """(agent, task): all, or so many of them."""
    every = list(product(range(AGENTS), range(TASKS)))
    chosen = np.random.default_rng(SEED).permutation(len(every))[:limit]
    return [every[place] for place in sorted(chosen.tolist())]


def _asked(
    space: CellSpace,
    agents: list[Cell3],
    sites: list[Cell3],
    pairs: list[tuple[int, int]],
    decisions: _Decisions,
    progress: Progress,
) -> _Asked:
    """Plain A* and ours in turn, and a decision now and then: all see the same machine."""
    asked, rows = _Asked(), space.free.tolist()
    shortest_path_3d(space, agents[0], sites[0])  # compiled now
    due = np.linspace(0, len(pairs) - 1, REPLACED).astype(int).tolist()
    for done, (agent, task) in enumerate(pairs, start=1):
        ends = agents[agent], sites[task]
        times_ns = [time.thread_time_ns()]
        asked.plain.append(plain_length_3d(rows, *ends))
        times_ns.append(time.thread_time_ns())
        path = shortest_path_3d(space, *ends)
        times_ns.append(time.thread_time_ns())
        asked.plain_ms.append((times_ns[1] - times_ns[0]) / 1e6)
        asked.ours_ms.append((times_ns[2] - times_ns[1]) / 1e6)
        asked.infeasible += bool(path_fault_3d(space.free, path, *ends))
        asked.ours.append(float(np.sqrt((np.diff(path, axis=0) ** 2).sum(axis=1)).sum()))
        for _ in range(due.count(done - 1)):
            decisions.replace_a_task()
        progress("cost matrix: heapq A*", done, len(pairs))
    return asked


def _places(space: CellSpace, count: int) -> list[Cell3]:
    """Different cells of the largest part, [ix, iy, iz]."""
    free = np.argwhere(space.free)
    random = np.random.default_rng(SEED + 1)
    for first in random.permutation(len(free)):
        iz, iy, ix = free[first].tolist()
        reached = np.argwhere(distance_field_3d(space, (ix, iy, iz)) != UNREACHED)
        if 2 * len(reached) > len(free):
            chosen = reached[random.choice(len(reached), count, replace=False)].tolist()
            return [(ix, iy, iz) for iz, iy, ix in chosen]
    raise AssertionError("a seeded space with 30 % obstacles has one large part")
