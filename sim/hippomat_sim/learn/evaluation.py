"""How methods are measured: one-shot problems in rounds, continuous allocation, first requests under loss.

Figures are integers per instance (or per copy of the environment), so that they can be stored, paired and
summed later without loss. Definitions:

  single    tasks requested by exactly one robot in the first round (CF1 = single / min(N, M))
  rounds    allocation rounds until nobody who could get a task is without one
  clean     rounds without a conflict
  cost_ms   total exact path time of the assignment
  left      robots that asked for nothing although they could have a task, and so would wait for ever; they
            are given the remaining tasks in order of id, and the cost of that counts
  served    tasks that were allocated
  requested tasks that were requested by somebody; contested: by several
  world     of the pool, in which an instance or a copy was: those of one world are alike
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from hippomat_core.wire.frames import UNREACHABLE
from hippomat_sim.learn.env import VectorEnv
from hippomat_sim.learn.instances import UNREACHABLE_MS, Instances
from hippomat_sim.learn.methods import Method
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.settings import EnvSettings
from hippomat_sim.learn.world_pool import WorldPool

Ints = NDArray[np.int64]
Figures = dict[str, Ints]


def play_one_shot(method: Method, instances: Instances) -> Figures:
    """Losers ask again until all are served. Every figure (B,)."""
    count, agents, tasks = instances.costs_q.shape
    figures: Figures = {
        name: np.zeros(count, np.int64) for name in ("single", "rounds", "clean", "cost_ms", "left")
    }
    slot_of = np.full((count, agents), -1, np.int64)
    waiting = np.ones((count, tasks), np.bool_)
    open_ = np.arange(count)
    number = 0
    while len(open_):  # every round allocates a task or is an instance's last one
        problems = instances.problems(open_, slot_of[open_] < 0, waiting[open_])
        actions = method.actions(problems, open_, number)
        winners, asking = resolve(actions, problems)
        figures["rounds"][open_] += 1
        figures["clean"][open_] += (asking <= 1).all(axis=1)
        if number == 0:
            figures["single"][:] = (asking == 1).sum(axis=1)
        rows, robots = np.nonzero(winners >= 0)
        slot_of[open_[rows], robots] = winners[rows, robots]
        waiting[open_[rows], winners[rows, robots]] = False
        open_ = open_[_could_serve(instances, slot_of, waiting, open_) & asking.any(axis=1)]
        number += 1
    figures["left"][:] = _give_the_rest(instances, slot_of, waiting)
    figures["cost_ms"][:] = _total_ms(instances, slot_of)
    return figures | {"world": instances.world}


def play_optimum(instances: Instances) -> Figures:
    """The cheapest assignment by exact path times (Kuhn 1955): what costs are compared with. cost_ms (B,)."""
    cost_ms = np.zeros(len(instances), np.int64)
    for index, travel in enumerate(instances.travel_ms.astype(np.int64)):
        # A pair without a way costs more than all ways together, so that there are as few of them as can be.
        priced = np.where(travel == UNREACHABLE_MS, UNREACHABLE_MS * len(travel), travel)
        rows, slots = linear_sum_assignment(priced)
        chosen = travel[rows, slots]
        cost_ms[index] = chosen[chosen != UNREACHABLE_MS].sum()
    return {"cost_ms": cost_ms}


def resolve(actions: Ints, problems: ProblemBatch) -> tuple[Ints, Ints]:
    """The rule of the paper: of several the smallest (cost code, id) wins. What cannot be had is no request.

    actions: (B, N)  returns: slot of each winner, else -1 (B, N); requests per task (B, M)
    """
    count, agents, tasks = problems.costs_q.shape
    rows, robots = np.nonzero((actions > 0) & problems.available)
    slots = actions[rows, robots] - 1
    codes = problems.costs_q[rows, robots, slots]
    valid = problems.waiting[rows, slots] & (codes != UNREACHABLE)
    rows, robots, slots, codes = rows[valid], robots[valid], slots[valid], codes[valid]
    asking = np.zeros((count, tasks), np.int64)
    np.add.at(asking, (rows, slots), 1)
    keys = codes.astype(np.int64) * agents + robots
    smallest = np.full((count, tasks), np.iinfo(np.int64).max)
    np.minimum.at(smallest, (rows, slots), keys)
    won = keys == smallest[rows, slots]
    winners = np.full((count, agents), -1, np.int64)
    winners[rows[won], robots[won]] = slots[won]
    return winners, asking


def _could_serve(instances: Instances, slot_of: Ints, waiting: NDArray[np.bool_], which: Ints) -> Ints:
    """(K,) bool: a robot without a task can still reach a task without a robot."""
    reachable = instances.travel_ms[which] != UNREACHABLE_MS
    pairs = reachable & (slot_of[which] < 0)[:, :, None] & waiting[which][:, None, :]
    return pairs.any(axis=(1, 2))  # type: ignore[no-any-return]


def _give_the_rest(instances: Instances, slot_of: Ints, waiting: NDArray[np.bool_]) -> Ints:
    """(B,) robots that had to be given a task: the lowest id takes the lowest slot that it can reach."""
    left = np.zeros(len(instances), np.int64)
    for index in np.flatnonzero((slot_of < 0).any(axis=1)):
        for robot in np.flatnonzero(slot_of[index] < 0):
            can = waiting[index] & (instances.travel_ms[index, robot] != UNREACHABLE_MS)
            if can.any():
                slot_of[index, robot] = int(np.argmax(can))
                waiting[index, slot_of[index, robot]] = False
                left[index] += 1
    return left


def _total_ms(instances: Instances, slot_of: Ints) -> Ints:
    """(B,) path times of an assignment, -1 = none."""
    times = np.take_along_axis(instances.travel_ms, np.maximum(slot_of, 0)[:, :, None], axis=2)[:, :, 0]
    return np.where(slot_of >= 0, times.astype(np.int64), 0).sum(axis=1)  # type: ignore[no-any-return]


def play_continuous(
    method: Method, settings: EnvSettings, pool: WorldPool, copies: int, seed: int, warm_up_steps: int
) -> Figures:
    """settings.episode_steps steps count after the warm-up. Every figure (copies,)."""
    steps = warm_up_steps + settings.episode_steps
    endless = replace(settings, episode_steps=steps + 1)
    env = VectorEnv(endless, pool, copies, seed)
    names = ("served", "requested", "contested", "clean", "steps", "cost_ms")
    figures: Figures = {name: np.zeros(copies, np.int64) for name in names}
    problems = env.reset()
    figures["world"] = env.hidden.world.copy()  # for the whole time: no episode ends
    for number in range(steps):
        step = env.step(fleet_actions(method, env, problems, number))
        problems = step.problems
        if number < warm_up_steps:
            continue
        events, won = step.events, step.events.allocated >= 0
        figures["served"] += won.sum(axis=1)
        figures["requested"] += events.requested_tasks
        figures["contested"] += events.conflicted_tasks
        figures["clean"] += events.conflicted_tasks == 0
        figures["steps"] += 1
        figures["cost_ms"] += np.where(won, events.travel_ms, 0).sum(axis=1, dtype=np.int64)
    return figures


def play_first_requests(
    method: Method, settings: EnvSettings, pool: WorldPool, copies: int, seed: int
) -> Figures:
    """The first round of one-shot problems under loss, from the same views for every method; (copies,)."""
    env = VectorEnv(settings, pool, copies, seed)
    problems = env.reset()
    actions = fleet_actions(method, env, problems, 0)
    _, asking = resolve(actions, problems)
    return {
        "single": (asking == 1).sum(axis=1),
        "requested": (asking >= 1).sum(axis=1),
        "world": env.hidden.world.copy(),
    }


def fleet_actions(method: Method, env: VectorEnv, problems: ProblemBatch, round_number: int) -> Ints:
    """(E, N) actions: on the common snapshot, or where frames are lost each robot on what it holds."""
    if env.settings.loss == 0.0:
        return method.actions(problems, np.arange(len(problems)), round_number)
    actions = np.zeros(problems.available.shape, np.int64)
    copies, robots = np.nonzero(problems.available)
    if len(copies):
        views = env.views().take(copies * problems.available.shape[1] + robots)
        actions[copies, robots] = method.own_actions(views, robots, copies, round_number)
    return actions


def play_permuted(method: Method, instances: Instances, seed: int) -> Figures:
    """The slot-permutation test: which robots ask for the same slot, and which for the same task, once the
    tasks of an instance are in other slots. Every figure (B,); asked: robots that asked both times."""
    count, _, tasks = instances.costs_q.shape
    slots = np.roll(np.arange(tasks), 1 + seed % max(1, tasks - 1))  # no task stays in its slot
    which = np.arange(count)
    before = first_actions(method, instances, which)
    after = first_actions(method, instances.permuted(slots), which)
    asked = (before > 0) & (after > 0)
    same_task = asked & (slots[after - 1] == before - 1)
    return {
        "asked": asked.sum(axis=1),
        "same_slot": (asked & (after == before)).sum(axis=1),
        "same_task": same_task.sum(axis=1),
        "world": instances.world,
    }


def first_actions(method: Method, instances: Instances, which: Ints) -> Ints:
    """(K, N) what everybody asks for at first."""
    free = np.ones((len(which), instances.costs_q.shape[1]), np.bool_)
    waiting = np.ones((len(which), instances.costs_q.shape[2]), np.bool_)
    return method.actions(instances.problems(which, free, waiting), which, 0)
