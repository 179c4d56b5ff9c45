"""Measures one cell. Whatever is changed here may change a figure, so it is part of the store's key."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from hippomat_core.allocation.port import Problem
from hippomat_sim.bench import tables_cells as kinds
from hippomat_sim.bench.tables_cells import Cell
from hippomat_sim.bench.tables_machine import machine_name
from hippomat_sim.learn.evaluation import (
    Figures,
    play_continuous,
    play_first_requests,
    play_one_shot,
    play_optimum,
    play_permuted,
)
from hippomat_sim.learn.instances import Instances, draw_instances
from hippomat_sim.learn.method_registry import METHODS, Sources, make_method
from hippomat_sim.learn.methods import Method
from hippomat_sim.learn.runs import Fleet
from hippomat_sim.learn.settings import EnvSettings, WorldSettings
from hippomat_sim.learn.world_pool import WorldPool

STEPS, WARM_UP_STEPS = 400, 40  # of the continuous mode: 100 s count, 10 s do not
STEP_S = EnvSettings().step_s
TEST_SPLIT = "test"  # worlds that no training ever saw


@dataclass(frozen=True, slots=True)
class Bench:
    """What every cell needs to be measured."""

    world: WorldSettings
    sources: Sources
    seed: int
    machine: str = field(default_factory=machine_name)  # that decisions are timed on


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
    return {"decision_ns": spent, "messages": sent, "world": instances.world}


def _instances(cell: Cell, bench: Bench, pool: WorldPool) -> Instances:
    return draw_instances(pool, cell.count, cell.agents, cell.tasks, bench.seed)
