"""A recorded fleet run again, for replay level L4: the plan's robots and air in lockstep, the rest by a seed.

Drawn from the seed: noise of wheels and lidars, the radios' boots and clocks, carrier sense, losses that the
plan does not fix. Nothing is kept but what the sink keeps.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hippomat_core.messages import Effect, Event
from hippomat_core.wire.codec import decode_header
from hippomat_logs.closed_loop.plan import LOSS, RECORDED, Air, FleetPlan, RobotPlan, Sink
from hippomat_sim.air import AirSettings
from hippomat_sim.lockstep_fleet import FIRST_US, Computer, LockstepFleet
from hippomat_sim.lockstep_robot import TICK_US, Recording
from hippomat_sim.medium import Medium
from hippomat_sim.run_preparation import simulation_setup

FAR_M = 500.0  # where bodies of robots without a log stand: outside every map


class Seen(NamedTuple):
    """What a reading of metrics takes for a record."""

    log_time_ns: int
    message: Any


class RecordedLosses:
    """Frames arrive where the recorded ones nearest in time arrived; a sender without any is mute."""

    def __init__(self, air: Air, stations: int) -> None:
        self._deliveries = air.deliveries
        self._nobody = np.ones(stations, np.bool_)

    def lost(self, now_us: int, sender: int, frame: bytes) -> NDArray[np.bool_]:
        found = self._deliveries.get(sender)
        if found is None:
            return self._nobody
        return ~found.delivered(now_us - FIRST_US, decode_header(frame).kind)


def run_closed_loop(plan: FleetPlan, seed: int, sink: Sink) -> None:
    """See hippomat_logs.closed_loop.plan.FleetWorld."""
    fleet = closed_loop_fleet(plan, seed, sink)
    try:
        fleet.advance(FIRST_US + math.ceil(plan.seconds * 1e6))
        fleet.stop()
    finally:
        fleet.close()


def closed_loop_fleet(plan: FleetPlan, seed: int, sink: Sink) -> LockstepFleet:
    """The fleet before its first moment; close() it."""
    config = plan.robots[0].config
    starts = np.array([(FAR_M + 10.0 * robot, FAR_M, 0.0) for robot in range(plan.size)])
    for robot in plan.robots:
        starts[robot.config.robot.id] = robot.start
    settings = air_settings(plan.air)
    setup = simulation_setup(config, plan.grid, starts, seed, settings)
    losses = RecordedLosses(plan.air, plan.size) if plan.air.kind == RECORDED else None
    medium = Medium(plan.size, settings, seed, losses)
    computers = [_computer(robot) for robot in plan.robots]

    def recorder(computer: Computer, _stamp_ns: int) -> Recording:
        return _Watcher(computer.config.robot.id, sink)

    return LockstepFleet(setup, computers, recorder, medium)


def air_settings(air: Air) -> AirSettings:
    """Only losses that are drawn come with the collisions of a simulated air: recorded ones have theirs."""
    if air.kind == LOSS:
        return AirSettings(loss=air.loss)
    return AirSettings(duplicate=0.0, capture_db=-math.inf)


def _computer(robot: RobotPlan) -> Computer:
    begins_us, ends_us = (FIRST_US + round(at_s * 1e6) for at_s in (robot.begins_s, robot.ends_s))
    first_tick_us = max(TICK_US, round(robot.first_tick_s * 1e6))
    return Computer(robot.config, robot.policy, begins_us, first_tick_us, ends_us)


class _Watcher:
    """One robot's records, handed on as they come; bytes tell nothing that events do not."""

    def __init__(self, robot: int, sink: Sink) -> None:
        self._robot, self._sink = robot, sink

    def put(self, stamp_ns: int, message: Event | Effect) -> None:
        self._sink(self._robot, Seen(stamp_ns, message))

    def serial(self, stamp_ns: int, port: int, direction: int, phase: int, data: bytes) -> None: ...
    def close(self) -> None: ...
