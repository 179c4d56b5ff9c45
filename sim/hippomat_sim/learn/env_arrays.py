"""What the compiled environment works on: plain arrays in named tuples, one axis of copies in front.

E copies, N agents, M task slots; W worlds, S sites, V starts per class (see WorldPool). A place is a start
(0 .. V - 1), a site (V .. V + S - 1), or ON_THE_WAY: somewhere else, with travel times of its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hippomat_sim.learn.random_stream import streams
from hippomat_sim.learn.rewards import Prices, prices
from hippomat_sim.learn.settings import TURNOVERS, EnvSettings
from hippomat_sim.learn.travel_times import UNREACHABLE_MS
from hippomat_sim.learn.world_pool import WorldPool

ON_THE_WAY = -1
NEVER, ON_CLAIM, ON_COMPLETION = (TURNOVERS.index(name) for name in TURNOVERS)


class Rules(NamedTuple):
    """The settings as numbers, and what they need of the pool."""

    turnover: int
    step_ms: int
    dwell_ms: int
    episode_steps: int
    airborne_tasks: float
    starts: int  # V
    landed: int  # sites 0 .. landed - 1 are on the ground
    handover: bool
    handover_gain_ms: int
    prices: Prices
    vehicle: NDArray[np.int64]  # (N,) UGV or UAV
    travel_ms: NDArray[np.uint16]  # (W, 2, V + S, S)
    code_of_ms: NDArray[np.uint8]  # (65536,)
    codes: NDArray[np.uint8]  # (W, 2, V + S, S) of travel_ms: most rows are those of idle agents


class Copies(NamedTuple):
    """The state of all copies."""

    random: NDArray[np.uint64]  # (E,) streams
    world: NDArray[np.int64]  # (E,)
    steps: NDArray[np.int64]  # (E,) of the episode
    site: NDArray[np.int64]  # (E, M) where the task of a slot is
    generation: NDArray[np.int64]  # (E, M) counts the tasks of a slot
    taken: NDArray[np.bool_]  # (E, S) sites that are in a slot
    left: NDArray[np.int64]  # (E, 2) sites that are not: on the ground, in the air
    place: NDArray[np.int64]  # (E, N) from where the row counts: the destination, of a busy agent
    busy_ms: NDArray[np.int64]  # (E, N) until it is free; 0 = idle
    slot: NDArray[np.int64]  # (E, N) of the claim, while its task is in it; else -1
    origin: NDArray[np.int64]  # (E, N) place where a busy agent set out
    destination: NDArray[np.int64]  # (E, N) site; -1 = none
    trip_ms: NDArray[np.int64]  # (E, N) travel time from there to the destination
    own_row_ms: NDArray[np.uint16]  # (E, N, S) travel times of who is ON_THE_WAY; (E, N, 0) without handovers
    own_cell: NDArray[np.int16]  # (E, N, 3) where it is
    handed_over: NDArray[np.bool_]  # (E, N, M) left this task to another one
    new_row: NDArray[np.bool_]  # (E, N) its codes are to be found anew
    new_slot: NDArray[np.bool_]  # (E, M)


class Seen(NamedTuple):
    """The arrays of ProblemBatch; present and ages_rounds never change here."""

    costs_q: NDArray[np.uint8]  # (E, N, M)
    available: NDArray[np.bool_]  # (E, N)
    busy: NDArray[np.bool_]  # (E, N)
    waiting: NDArray[np.bool_]  # (E, M)
    assigned: NDArray[np.bool_]  # (E, N)


class Outcome(NamedTuple):
    """What a step did."""

    rewards: NDArray[np.float32]  # (E, N)
    team_reward: NDArray[np.float32]  # (E,)
    terminated: NDArray[np.bool_]  # (E,)
    truncated: NDArray[np.bool_]  # (E,)
    requested_tasks: NDArray[np.int64]  # (E,)
    conflicted_tasks: NDArray[np.int64]  # (E,)
    allocated: NDArray[np.int64]  # (E, N) slot, -1 = none
    travel_ms: NDArray[np.int64]  # (E, N) of the task allocated, 0 = none
    completed: NDArray[np.int64]  # (E,) tasks served
    released: NDArray[np.bool_]  # (E, N) left its task to another one
    elapsed_ms: NDArray[np.int64]  # (E, N) on the way by then


class Scratch(NamedTuple):
    """What a step needs on its way."""

    asking: NDArray[np.int64]  # (M,) requests for a task, of one copy
    best: NDArray[np.int64]  # (M,) smallest (code, id) of them
    fates: NDArray[np.int64]  # (E, N) see rewards.py
    codes: NDArray[np.int64]  # (E, N) of the task that was won
    starts: NDArray[np.bool_]  # (2, V) given out, of one copy
    sites: NDArray[np.uint16]  # (M,) of the slots, of one copy
    slots: NDArray[np.int64]  # (M,) to be priced anew, of one copy


def rules_of(settings: EnvSettings, pool: WorldPool, vehicle: NDArray[np.int64]) -> Rules:
    gain_s = settings.handover_gain_s
    handover = settings.turnover == "on_completion" and np.isfinite(gain_s)
    return Rules(
        turnover=TURNOVERS.index(settings.turnover),
        step_ms=round(settings.step_s * 1000),
        dwell_ms=round(settings.dwell_s * 1000),
        episode_steps=settings.episode_steps,
        airborne_tasks=float(settings.airborne_tasks),
        starts=pool.settings.starts,
        landed=pool.settings.sites - pool.settings.airborne_sites,
        handover=bool(handover),
        handover_gain_ms=round(gain_s * 1000) if handover else UNREACHABLE_MS,
        prices=prices(settings.rewards),
        vehicle=vehicle,
        travel_ms=pool.travel_ms,
        code_of_ms=pool.code_of_ms,
        codes=pool.code_of_ms[pool.travel_ms],
    )


def new_copies(rules: Rules, copies: int, tasks: int, seed: int) -> Copies:
    """Nothing drawn yet."""
    agents, sites = len(rules.vehicle), rules.travel_ms.shape[3]
    whole = {"world": (copies,), "steps": (copies,), "left": (copies, 2)}
    whole |= {"site": (copies, tasks), "generation": (copies, tasks)}
    for name in ("place", "busy_ms", "slot", "origin", "destination", "trip_ms"):
        whole[name] = (copies, agents)
    return Copies(
        random=streams(copies, seed),
        taken=np.zeros((copies, sites), np.bool_),
        own_row_ms=np.zeros((copies, agents, sites if rules.handover else 0), np.uint16),
        own_cell=np.zeros((copies, agents, 3), np.int16),
        handed_over=np.zeros((copies, agents, tasks if rules.handover else 0), np.bool_),
        new_row=np.zeros((copies, agents), np.bool_),
        new_slot=np.zeros((copies, tasks), np.bool_),
        **{name: np.zeros(shape, np.int64) for name, shape in whole.items()},
    )


def new_seen(copies: int, agents: int, tasks: int) -> Seen:
    flags = [np.zeros((copies, agents), np.bool_) for _ in range(3)]
    available, busy, assigned = flags
    costs_q = np.zeros((copies, agents, tasks), np.uint8)
    return Seen(costs_q, available, busy, np.zeros((copies, tasks), np.bool_), assigned)


def new_outcome(copies: int, agents: int) -> Outcome:
    each = (copies, agents)
    return Outcome(
        rewards=np.zeros(each, np.float32),
        team_reward=np.zeros(copies, np.float32),
        terminated=np.zeros(copies, np.bool_),
        truncated=np.zeros(copies, np.bool_),
        requested_tasks=np.zeros(copies, np.int64),
        conflicted_tasks=np.zeros(copies, np.int64),
        allocated=np.zeros(each, np.int64),
        travel_ms=np.zeros(each, np.int64),
        completed=np.zeros(copies, np.int64),
        released=np.zeros(each, np.bool_),
        elapsed_ms=np.zeros(each, np.int64),
    )


def new_scratch(rules: Rules, copies: int, tasks: int) -> Scratch:
    agents = len(rules.vehicle)
    return Scratch(
        asking=np.zeros(tasks, np.int64),
        best=np.zeros(tasks, np.int64),
        fates=np.zeros((copies, agents), np.int64),
        codes=np.zeros((copies, agents), np.int64),
        starts=np.zeros((2, rules.starts), np.bool_),
        sites=np.zeros(tasks, np.uint16),
        slots=np.zeros(tasks, np.int64),
    )
