"""What one decision's travel costs cost: 30 agents x 30 tasks in 50 x 50 x 30 cells, one task replaced.

Ours keeps a distance field per task, so that a replaced task costs one field and the matrix a look-up; the
yardstick asks plain A* for every pair. Prints nothing.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hippomat_core.planning.field3d import CellSpace, cell_space, distance_field_3d
from hippomat_core.planning.field_cache import Fields
from hippomat_core.planning.graph import STRAIGHT, UNREACHED
from hippomat_sim.bench.plan_plain import plain_length_3d
from hippomat_sim.bench.plan_run import Progress

AGENTS = TASKS = 30
SHAPE = (30, 50, 50)  # (Z, Y, X)
OBSTACLES, SEED = 0.2, 0
REPLACED = 41  # decisions that are timed, one replaced task each
RELATIVE = 1e-6


@dataclass(frozen=True, slots=True)
class MatrixResult:
    """Per decision."""

    pairs: int  # asked of the plain A*, the same number of every row
    wrong: int  # values that differ
    field_ms: float  # of it: the replaced task's field
    lookup_us: float  # and the matrix
    decision_ms: float
    plain_ms: float  # for all AGENTS x TASKS pairs
    sampled: bool

    @property
    def ratio(self) -> float:
        """How many times as long plain A* takes."""
        return self.plain_ms / self.decision_ms


def run_matrix(limit: int, progress: Progress) -> MatrixResult:
    """limit: at most so many pairs are asked of the plain A*; its time is scaled up to all of them."""
    free = np.random.default_rng(SEED).random(SHAPE) >= OBSTACLES
    space = cell_space(free)
    places = _places(space, AGENTS + TASKS + REPLACED)
    agents, sites = places[:AGENTS], places[AGENTS:]
    nodes = np.array([space.node_of(cell) for cell in agents])
    goals = {(slot, 0): sites[slot] for slot in range(TASKS)}
    fields = Fields({}).with_goals(space, goals, 1.0)
    decisions_ms, fields_ms, lookups_us = [], [], []
    for turn in range(REPLACED):
        slot = turn % TASKS
        goals = {key: goal for key, goal in goals.items() if key[0] != slot}
        goals[slot, turn + 1] = sites[TASKS + turn]
        begun_ns = time.perf_counter_ns()
        fields = fields.with_goals(space, goals, 1.0)
        between_ns = time.perf_counter_ns()
        units = fields.matrix(list(goals), nodes)
        ended_ns = time.perf_counter_ns()
        decisions_ms.append((ended_ns - begun_ns) / 1e6)
        fields_ms.append((between_ns - begun_ns) / 1e6)
        lookups_us.append((ended_ns - between_ns) / 1e3)
    ours = np.where(units == UNREACHED, np.inf, units / STRAIGHT)
    pairs, plain, plain_ms = _plain(free, agents, list(goals.values()), limit, progress)
    found = np.array([ours[pair] for pair in pairs])
    wrong = int(np.count_nonzero(~np.isclose(found, plain, rtol=RELATIVE, atol=0.0)))
    return MatrixResult(
        len(pairs),
        wrong,
        statistics.median(fields_ms),
        statistics.median(lookups_us),
        statistics.median(decisions_ms),
        plain_ms * AGENTS * TASKS / len(pairs),
        len(pairs) < AGENTS * TASKS,
    )


def _plain(
    free: NDArray[np.bool_],
    agents: list[tuple[int, int, int]],
    goals: list[tuple[int, int, int]],
    limit: int,
    progress: Progress,
) -> tuple[list[tuple[int, int]], list[float], float]:
    """The pairs (agent, task) asked, their lengths [cells], and how long all that took [ms]."""
    every = list(product(range(AGENTS), range(TASKS)))
    chosen = np.random.default_rng(SEED).permutation(len(every))[:limit]
    pairs = [every[place] for place in sorted(chosen.tolist())]
    rows = free.tolist()
    lengths, took_ms = [], 0.0
    for done, (agent, task) in enumerate(pairs, start=1):
        begun_ns = time.perf_counter_ns()
        lengths.append(plain_length_3d(rows, agents[agent], goals[task]))
        took_ms += (time.perf_counter_ns() - begun_ns) / 1e6
        progress("cost matrix: heapq A*", done, len(pairs))
    return pairs, lengths, took_ms


def _places(space: CellSpace, count: int) -> list[tuple[int, int, int]]:
    """Different cells of the largest part, [ix, iy, iz]."""
    free = np.argwhere(space.free)
    random = np.random.default_rng(SEED + 1)
    for first in random.permutation(len(free)):
        iz, iy, ix = free[first].tolist()
        reached = np.argwhere(distance_field_3d(space, (ix, iy, iz)) != UNREACHED)
        if 2 * len(reached) > len(free):
            chosen = reached[random.choice(len(reached), count, replace=False)].tolist()
            return [(ix, iy, iz) for iz, iy, ix in chosen]
    raise AssertionError("a seeded space with 20 % obstacles has one large part")
