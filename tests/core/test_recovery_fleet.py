"""A stuck robot in a lockstep fleet: things on no map, wheels that do not turn, and nothing wrong."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from fleet_world import FleetWorld, full_sweep

from hippomat_core.config import FleetConfig, RecoveryConfig
from hippomat_core.control.recovery import BACK_UP, CLEAR, DRIVE, GIVE_UP, TURN, WAIT
from hippomat_core.messages import (
    AlarmCleared,
    AlarmRaised,
    ClaimChanged,
    Drive,
    GuardLimited,
    RecoveryChanged,
    ScanReceived,
)

IMPATIENT = RecoveryConfig(stuck_s=3.0, retry_s=1.5, wait_s=1.0, shun_s=15.0)
SEQUENCE = [CLEAR, BACK_UP, TURN, WAIT, GIVE_UP]


class Cluttered(FleetWorld):
    """A fleet whose lidars see discs (x, y, radius) that are on no map; walls are not shown."""

    discs: tuple[tuple[float, float, float], ...] = ()

    def _advance(self, robot: int) -> None:
        body = self.bodies[robot]
        take = body.take

        def seeing(event):
            return take(self.seen_from(body, event.stamp_ns) if isinstance(event, ScanReceived) else event)

        body.take = seeing
        try:
            super()._advance(robot)
        finally:
            del body.take

    def seen_from(self, body, stamp_ns: int) -> ScanReceived:
        sweep = full_sweep(stamp_ns)
        angle = body.yaw_rad + math.pi - np.radians(sweep.angle_q6 / 64.0)
        far = np.full(360, np.inf)
        for x, y, radius in self.discs:
            dx, dy = x - body.x_m, y - body.y_m
            along = dx * np.cos(angle) + dy * np.sin(angle)
            across2 = dx * dx + dy * dy - along * along
            depth = along - np.sqrt(np.maximum(radius * radius - across2, 0.0))
            far = np.where((across2 < radius * radius) & (along > 0.0), np.minimum(far, depth), far)
        distance_q2 = np.where(np.isfinite(far), np.maximum(far, 0.0) * 4000, 0).astype(np.uint16)
        return replace(sweep, distance_q2=distance_q2)

    def nearest_disc_m(self) -> float:
        return min(
            math.dist((body.x_m, body.y_m), (x, y)) - radius - body.state.config.robot.radius_m
            for body in self.bodies
            for x, y, radius in self.discs
        )


def said(body, kind, since_ns=0):
    return [effect for stamp_ns, effect in body.effects if isinstance(effect, kind) and stamp_ns >= since_ns]


def orders() -> FleetConfig:
    return FleetConfig(task_slots=6, allocator="hungarian", turnover="on_completion")


def driving(world: FleetWorld) -> FleetWorld:
    """Until the first robot, which has little patience, drives to its task with most of the way to go."""
    body = world.bodies[0]
    impatient = replace(body.state.config, recovery=IMPATIENT)
    body.state = replace(body.state, config=impatient)
    while body.state.fleet.own_claim is None or body.v_mps < 0.15 or body.state.outcome.remaining_m < 1.5:
        world.tick()
    return world


def fenced(body, count: int = 24, away_m: float = 0.3):
    """Discs all around it that no map shows."""
    angles = [k / count * math.tau for k in range(count)]
    return tuple((body.x_m + away_m * math.cos(a), body.y_m + away_m * math.sin(a), 0.05) for a in angles)


def test_a_robot_that_is_fenced_in_tries_everything_and_gives_its_task_back_untouched():
    world = driving(Cluttered(1, fleet=orders()))
    body, begun_ns = world.bodies[0], world.now_ns
    world.discs = fenced(body)
    task = body.state.fleet.own_claim.id.task
    nearest = math.inf
    while not said(body, ClaimChanged, begun_ns) and world.now_ns - begun_ns < 120 * 10**9:
        world.tick()
        nearest = min(nearest, world.nearest_disc_m())
    steps = [told.step for told in said(body, RecoveryChanged, begun_ns) if told.step != DRIVE]
    assert [step for step in steps if step in SEQUENCE] == SEQUENCE
    dropped = said(body, ClaimChanged, begun_ns)[0]
    assert (dropped.what, dropped.cause, (dropped.slot, dropped.generation)) == ("dropped", "stuck", task)
    assert {"stuck", "gave_up"} <= {alarm.code for alarm in said(body, AlarmRaised, begun_ns)}
    assert nearest > 0.0
    held = said(body, GuardLimited, begun_ns)
    assert held
    assert all(seen.nearest_m < 0.5 and seen.stop_m > seen.free_m >= 0.0 for seen in held)
    again_ns = world.now_ns
    world.run(10)
    assert task not in [
        (c.slot, c.generation) for c in said(body, ClaimChanged, again_ns) if c.what == "requested"
    ]
    assert "stuck" in [cleared.code for cleared in said(body, AlarmCleared)]


def test_an_unmapped_thing_on_its_way_costs_time_and_nothing_else():
    world = driving(Cluttered(1, fleet=orders()))
    body, begun_ns = world.bodies[0], world.now_ns
    ahead = 0.6
    x, y = body.x_m + ahead * math.cos(body.yaw_rad), body.y_m + ahead * math.sin(body.yaw_rad)
    world.discs = ((x, y, 0.1),)
    nearest = math.inf
    while not body.claims("completed") and world.now_ns - begun_ns < 120 * 10**9:
        world.tick()
        nearest = min(nearest, world.nearest_disc_m())
    assert body.claims("completed")
    assert nearest > 0.0


def test_wheels_that_do_not_turn_are_told_and_the_task_goes_to_another_robot():
    world = driving(FleetWorld(2, fleet=orders()))
    world.run(2.0)
    body, begun_ns = world.bodies[0], world.now_ns
    x, y, yaw = body.x_m, body.y_m, body.yaw_rad
    while not body.claims("dropped") and world.now_ns - begun_ns < 120 * 10**9:
        world.tick()
        body.x_m, body.y_m, body.yaw_rad = x, y, yaw
    assert [changed.cause for changed in body.claims("dropped")] == ["stuck"]
    causes = {told.cause for told in said(body, RecoveryChanged, begun_ns)}
    assert causes <= {"wheels", "slip"}
    assert causes
    backing = [drive for drive in said(body, Drive, begun_ns) if drive.reason == "recover:back_up"]
    assert min(drive.v_mps for drive in backing) == pytest.approx(-IMPATIENT.back_mps)


def test_in_a_fleet_that_gets_on_nobody_is_ever_stuck():
    world = FleetWorld(4, loss=0.2, seed=5, fleet=FleetConfig(task_slots=8, allocator="hungarian"))
    world.run(15)
    for body in world.bodies:
        assert said(body, RecoveryChanged) == []


def test_while_it_frees_itself_commands_stay_within_the_limits():
    world = driving(Cluttered(1, fleet=orders()))
    body, begun_ns = world.bodies[0], world.now_ns
    world.discs = fenced(body, away_m=0.45)
    world.run(20)
    limits, last = body.state.config.limits, None
    for drive in said(body, Drive, begun_ns):
        assert abs(drive.v_mps) <= limits.speed_mps + 1e-9
        assert abs(drive.wz_radps) <= limits.turn_radps + 1e-9
        if last is not None and drive.reason.startswith("recover") and last.reason.startswith("recover"):
            assert (
                abs(drive.v_mps) - abs(last.v_mps) <= limits.accel_mps2 * 0.05 + 0.016
            )  # below it: no motion
        last = drive
    assert "recover:turn" in {drive.reason for drive in said(body, Drive, begun_ns)}
