"""Frozen one-shot problems: every method gets the same ones. Drawn from a world pool, by seed alone.

An instance is N agents at different starts and M tasks at different sites of one world. Costs are exact path
times; the methods see their 8-bit codes, as they do on the air.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import ConfigError
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.settings import UAV, UGV
from hippomat_sim.learn.world_pool import WorldPool

UNREACHABLE_MS = 65535  # WorldPool.travel_ms


@dataclass(frozen=True, slots=True, eq=False)
class Instances:
    """B one-shot problems. Nobody is busy, every row is held and new."""

    travel_ms: NDArray[np.uint16]  # (B, N, M) exact path times, 65535 = unreachable
    costs_q: NDArray[np.uint8]  # (B, N, M) their codes, 255 = unreachable
    world: NDArray[np.int64]  # (B,) of the pool: where they are

    def __len__(self) -> int:
        return len(self.costs_q)

    def problems(
        self, which: NDArray[np.int64], free: NDArray[np.bool_], waiting: NDArray[np.bool_]
    ) -> ProblemBatch:
        """Snapshots of the chosen instances. free: (K, N) has no task yet  waiting: (K, M) nobody has it."""
        return ProblemBatch(
            costs_q=self.costs_q[which],
            available=free,
            busy=np.zeros_like(free),  # one task for each: who has one takes no other
            waiting=waiting,
            present=np.ones_like(free),
            assigned=~free,
            ages_rounds=np.zeros(free.shape, np.float32),
        )

    def permuted(self, slots: NDArray[np.int64]) -> Instances:
        """The same problems with the tasks in other slots: new slot j holds what was in slots[j]."""
        return Instances(self.travel_ms[:, :, slots], self.costs_q[:, :, slots], self.world)


def draw_instances(
    pool: WorldPool, count: int, agents: int, tasks: int, seed: int, uav_share: float = 0.5
) -> Instances:
    """The first `count` instances of this size and seed: a larger count begins with the same ones."""
    _, _, places, sites = pool.travel_ms.shape
    starts, ground = places - sites, sites - pool.settings.airborne_sites
    if agents > starts or tasks > ground:
        raise ConfigError(
            f"{agents} agents, {tasks} tasks: too many for {starts} starts, {ground} ground sites"
        )
    classes = vehicle_classes(agents, uav_share)
    travel = np.empty((count, agents, tasks), np.uint16)
    worlds = np.empty(count, np.int64)
    for index in range(count):
        random = np.random.default_rng((seed, agents, tasks, index))
        world = worlds[index] = random.integers(len(pool.travel_ms))
        start = random.choice(starts, agents, replace=False)
        site = random.choice(ground, tasks, replace=False)
        travel[index] = pool.travel_ms[world, classes[:, None], start[:, None], site[None, :]]
    return Instances(travel, pool.code_of_ms[travel], worlds)


def vehicle_classes(agents: int, uav_share: float) -> NDArray[np.int64]:
    """(N,) UGV or UAV: the last ones fly."""
    flying = round(agents * uav_share)
    return np.where(np.arange(agents) >= agents - flying, UAV, UGV)
