"""Many copies of the allocation problem, stepped together: the environment that policies learn in.

A step is an allocation round. Of several that request a task the smallest (cost code, id) gets it, as on the
robots. turnover "never": nobody moves, rounds go on until everyone who can has a task. Otherwise winners
travel and serve in real time, and their rows count from their destination, the time until then included.
Decides on no action; rewards are in rewards.py, worlds in world_pool.py, radio loss in delivery.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hippomat_sim.learn.delivery import Delivery
from hippomat_sim.learn.env_arrays import (
    ON_THE_WAY,
    Copies,
    new_copies,
    new_outcome,
    new_scratch,
    new_seen,
    rules_of,
)
from hippomat_sim.learn.env_checks import checked
from hippomat_sim.learn.env_kernels import advance
from hippomat_sim.learn.env_tasks import observe, reset_copies
from hippomat_sim.learn.instances import vehicle_classes
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.settings import EnvSettings
from hippomat_sim.learn.world_pool import WorldPool


@dataclass(frozen=True, slots=True, eq=False)
class Events:
    """What happened in a step, for metrics and not for policies."""

    requested_tasks: NDArray[np.int64]  # (E,) tasks that somebody free requested
    conflicted_tasks: NDArray[np.int64]  # (E,) of those: by several, or held by another one already
    allocated: NDArray[np.int64]  # (E, N) slot that the agent got, else -1
    travel_ms: NDArray[np.int64]  # (E, N) its exact travel time, 0 without
    completed: NDArray[np.int64]  # (E,) tasks served
    released: NDArray[np.bool_]  # (E, N) left its task to another one on the way


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """The arrays are the environment's own and hold until its next step: copy what has to last longer."""

    rewards: NDArray[np.float32]  # (E, N) r_i
    team_reward: NDArray[np.float32]  # (E,) R(t) = sum of r_i
    terminated: NDArray[np.bool_]  # (E,) nobody is left who could get a task
    truncated: NDArray[np.bool_]  # (E,) the episode's steps are over
    final: (
        ProblemBatch | None
    )  # what agents of the K copies that ended would see next: (K, ..), with loss (K N, ..)
    problems: ProblemBatch  # (E, ..) of the next round; ended copies have begun their next episode
    events: Events


class VectorEnv:
    """E copies. Copy e of a seed does the same for any number of copies, given the same actions.

    Agents that fly are the last ones. The same settings with another loss have the same worlds and tasks.
    """

    def __init__(self, settings: EnvSettings, pool: WorldPool, copies: int, seed: int) -> None:
        """ConfigError for settings that the pool cannot serve."""
        checked(settings, pool)
        self.settings, self.pool, self.copies, self.seed = settings, pool, copies, seed
        agents, tasks = settings.agents, settings.tasks
        self.classes = vehicle_classes(agents, settings.uav_share)  # (N,) UGV or UAV
        self._rules = rules_of(settings, pool, self.classes)
        self._copies = new_copies(self._rules, copies, tasks, seed)
        self._seen = seen = new_seen(copies, agents, tasks)
        self._out = out = new_outcome(copies, agents)
        self._scratch = new_scratch(self._rules, copies, tasks)
        self._problems = ProblemBatch(
            costs_q=seen.costs_q,
            available=seen.available,
            busy=seen.busy,
            waiting=seen.waiting,
            present=np.ones((copies, agents), np.bool_),
            assigned=seen.assigned,
            ages_rounds=np.zeros((copies, agents), np.float32),
        )
        self._events = Events(
            out.requested_tasks,
            out.conflicted_tasks,
            out.allocated,
            out.travel_ms,
            out.completed,
            out.released,
        )
        self._delivery = Delivery(settings, copies, seed) if settings.loss > 0.0 else None
        self._all = np.arange(copies)
        self._begin(self._all)

    @property
    def hidden(self) -> Copies:
        """What no agent sees whole: places, destinations, sites. To be looked at, not to be changed."""
        return self._copies

    def reset(self) -> ProblemBatch:
        """Begins a new episode in every copy. (E, ..) problems, valid until the next step."""
        self._begin(self._all)
        return self._problems

    def views(self) -> ProblemBatch:
        """(E N, ..) what agents hold: view e N + i is that of agent i of copy e, valid until the next step.

        A row never heard is not present and unreachable; a late one is as it was, with its age. Without loss
        everybody holds the common snapshot, copied for each.
        """
        if self._delivery is None:
            return self._problems.take(np.repeat(self._all, self.settings.agents))
        return self._delivery.views()

    def step(self, actions: ArrayLike) -> Step:
        """actions: (E, N) 0 = no request, j = task slot j - 1. Copies that end begin anew by themselves.

        A request of a busy agent, or for a task out of reach, has no effect but its reward.
        """
        chosen = self._checked_actions(actions)
        if advance(self._rules, self._copies, self._seen, self._out, self._scratch, chosen):
            self._stop_on_the_way()
        observe(self._rules, self._copies, self._seen, self._scratch, self._all)
        if self._delivery is not None:
            self._delivery.deliver(self._copies, self._seen, self._all)
        out = self._out
        ended = np.flatnonzero(out.terminated | out.truncated)
        final = None
        if len(ended):
            final = self._held(ended)
            self._begin(ended)
        return Step(
            out.rewards,
            out.team_reward,
            out.terminated,
            out.truncated,
            final,
            self._problems,
            self._events,
        )

    @property
    def problems(self) -> ProblemBatch:
        """(E, ..) of the next round, valid until the next step."""
        return self._problems

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All that its future depends on, copied; for restore()."""
        return {name: array.copy() for name, array in self._future().items()}

    def restore(self, state: Mapping[str, NDArray[np.generic]]) -> None:
        """Goes on as the environment of these settings did that gave the state."""
        for name, array in self._future().items():
            array[...] = state[name]

    def _future(self) -> dict[str, NDArray[np.generic]]:
        air = {} if self._delivery is None else self._delivery.memory()
        return {**self._copies._asdict(), **self._seen._asdict(), **air}

    def _begin(self, which: NDArray[np.int64]) -> None:
        reset_copies(self._rules, self._copies, self._seen, self._scratch, which)
        observe(self._rules, self._copies, self._seen, self._scratch, which)
        if self._delivery is not None:
            self._delivery.forget(which)
            self._delivery.deliver(self._copies, self._seen, which)

    def _held(self, which: NDArray[np.int64]) -> ProblemBatch:
        """What the agents of these copies hold, copied: the snapshot, or with loss a view for each agent."""
        if self._delivery is None:
            return self._problems.take(which)
        agents = self.settings.agents
        return self._delivery.views().take((which[:, None] * agents + np.arange(agents)).reshape(-1))

    def _checked_actions(self, actions: ArrayLike) -> NDArray[np.int64]:
        chosen = np.ascontiguousarray(actions, np.int64)
        shape, most = (self.copies, self.settings.agents), self.settings.tasks
        if chosen.shape != shape:
            raise ValueError(f"actions of shape {chosen.shape}: give {shape}, one per copy and agent")
        # As unsigned numbers those below 0 are large too: one comparison, no array of flags.
        if chosen.view(np.uint64).max(initial=0) > most:
            raise ValueError(f"actions {chosen.min()} .. {chosen.max()}: give 0 .. {most}")
        return chosen

    def _stop_on_the_way(self) -> None:
        """Who left its task to another one is idle where it is by now."""
        copies, seen, pool = self._copies, self._seen, self.pool
        for e, i in np.argwhere(self._out.released).tolist():
            world, vehicle = int(copies.world[e]), int(self.classes[i])
            cell = self._departure(e, i)
            elapsed_ms, site = int(self._out.elapsed_ms[e, i]), int(copies.destination[e, i])
            cell = pool.cell_on_way(world, vehicle, cell, site, elapsed_ms)
            copies.own_cell[e, i] = cell
            copies.own_row_ms[e, i] = pool.row_from(world, vehicle, cell)
            copies.place[e, i] = ON_THE_WAY
            copies.busy_ms[e, i], copies.destination[e, i] = 0, -1
            copies.new_row[e, i] = True
            seen.available[e, i], seen.busy[e, i], seen.assigned[e, i] = True, False, False

    def _departure(self, e: int, i: int) -> NDArray[np.int16]:
        """(3,) the cell where a busy agent set out."""
        copies, place = self._copies, int(self._copies.origin[e, i])
        cell: NDArray[np.int16] = copies.own_cell[e, i].copy()
        if place != ON_THE_WAY:
            cell = self.pool.places_cell[copies.world[e], self.classes[i], place]
        return cell
