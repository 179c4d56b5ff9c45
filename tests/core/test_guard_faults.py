"""The scan guard in a closed loop with everything late, lost or wrong that it has to survive.

The base obeys after a dead time and brakes exactly as configured, no harder; the wish is always to go on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hippomat_core.config import Config, GuardConfig, LimitsConfig, RobotConfig
from hippomat_core.control.guard import Lateness, carried_along, guard, stopping_way
from hippomat_core.control.stopping import beyond_body_m

CONFIG = Config()
NO_PEERS, NO_POINTS = np.zeros((0, 3)), np.zeros((0, 2))
DT_S, TICK_S = 0.01, 0.05
OUTLINE = ((0.14, 0.08), (-0.10, 0.08), (-0.10, -0.08), (0.14, -0.08))
LONG = replace(CONFIG, robot=RobotConfig(radius_m=0.17, footprint=OUTLINE))
Pose = tuple[float, float, float]


@dataclass
class Faults:
    """What goes wrong; seconds."""

    scan_every_s: float = 0.1
    scan_read_late_s: float = 0.0  # its stamp is that much too late
    base_dead_s: float = 0.15  # the loop's 0.05 s on top make 0.20 of the 0.25 configured
    odometry_every_s: float = 0.04
    dropped: float = 0.0  # share of beams
    obstacle_mps: tuple[float, float] = (0.0, 0.0)


@dataclass
class Trial:
    """One robot that always wants on, and things it only knows of by its lidar."""

    config: Config
    things: np.ndarray  # (n, 2) world
    faults: Faults
    random: np.random.Generator
    pose: Pose = (0.0, 0.0, 0.0)
    v: float = 0.0
    wz: float = 0.0
    now_s: float = 0.0
    nearest_m: float = math.inf
    touched_mps: float = 0.0  # own speed when something was touched first, which ends the trial
    trail: list[tuple[float, Pose]] = field(default_factory=list)
    scan: tuple[float, np.ndarray, Pose] | None = None
    sweeps: list[tuple[float, np.ndarray]] = field(default_factory=list)
    commands: list[tuple[float, float]] = field(default_factory=list)

    def run(self, v_mps: float, wz_radps: float, seconds: float) -> Trial:
        self.commands = [(self.v, self.wz)] * round(self.faults.base_dead_s / DT_S)
        command = (self.v, self.wz)
        for step in range(round(seconds / DT_S)):
            self.now_s = step * DT_S
            if step % round(self.faults.odometry_every_s / DT_S) == 0:
                self.trail.append((self.now_s, self.pose))
            self._look(step)
            if step % round(TICK_S / DT_S) == 0:
                command = self._decide(v_mps, wz_radps)
            self._move(*command)
            if self.nearest_m < 0.0:
                break
        return self

    def _look(self, step: int) -> None:
        if step % round(self.faults.scan_every_s / DT_S) == 0:
            kept = self.random.random(len(self.things)) >= self.faults.dropped
            self.sweeps.append((self.now_s, carried_along(self.things[kept], (0.0, 0.0, 0.0), self.pose)))
        due = [sweep for sweep in self.sweeps if self.now_s - sweep[0] >= self.faults.scan_read_late_s - 1e-9]
        for _, points in due:
            self.scan = (self.now_s, points, self.trail[-1][1])
        self.sweeps = self.sweeps[len(due) :]

    def _decide(self, v_mps: float, wz_radps: float) -> tuple[float, float]:
        if self.scan is None:
            return 0.0, 0.0
        told_s, told = self.trail[-1]
        seen_s, points, pose = self.scan
        late = Lateness(self.now_s - seen_s, self.now_s - told_s, self.v)
        safe = guard(carried_along(points, pose, told), v_mps, wz_radps, NO_PEERS, self.config, late)
        return safe.v_mps, safe.wz_radps

    def _move(self, v: float, wz: float) -> None:
        self.commands.append((v, wz))
        v, wz = self.commands.pop(0)
        limits = self.config.limits
        change = limits.decel_mps2 * DT_S
        before = self.v
        self.v += max(-change, min(change, v - self.v))
        if abs(v) > 1e-9:
            self.wz = wz * self.v / v
        elif abs(self.v) > 1e-9:
            self.wz *= self.v / before  # it brakes along its arc
        else:
            turn = limits.turn_accel_radps2 * DT_S
            self.wz += max(-turn, min(turn, wz - self.wz))
        x, y, yaw = self.pose
        yaw += self.wz * DT_S
        self.pose = (x + self.v * math.cos(yaw) * DT_S, y + self.v * math.sin(yaw) * DT_S, yaw)
        self.things = self.things + np.array(self.faults.obstacle_mps) * DT_S
        self._judge()

    def _judge(self) -> None:
        corners = np.array(self.config.robot.footprint).reshape(-1, 2)
        for x, y in carried_along(self.things, (0.0, 0.0, 0.0), self.pose):
            gap = beyond_body_m(x, y, corners, self.config.robot.radius_m)
            self.nearest_m = min(self.nearest_m, gap)
        if self.nearest_m < 0.0:
            self.touched_mps = abs(self.v)


def box(x: float, y: float, size: float = 0.05, across: int = 5) -> np.ndarray:
    """Returns from a small thing."""
    side = np.linspace(-size / 2, size / 2, across)
    return np.concatenate(
        [[(x - size / 2, y + k), (x + k, y - size / 2), (x + k, y + size / 2)] for k in side]
    )


def placed(seed: int, config: Config, least_m: float) -> tuple[np.ndarray, np.random.Generator]:
    """A few boxes around, none nearer than least_m beyond the body."""
    random = np.random.default_rng(seed)
    boxes = [box(*random.uniform(-0.9, 0.9, 2)) for _ in range(4)]
    far = [b for b in boxes if np.hypot(*b.T).min() > config.robot.radius_m + least_m]
    return np.concatenate([*far, box(0.9, 0.0)]), random


@given(
    st.integers(0, 2**32 - 1),
    st.floats(0.05, 0.2),
    st.floats(-1.5, 1.5),
    st.booleans(),
    st.floats(0.1, 0.5),
    st.sampled_from([CONFIG, LONG]),
)
@settings(deadline=None, max_examples=25)
def test_scans_up_to_half_a_second_old_never_let_a_static_thing_be_touched(
    seed, v, wz, back, every_s, config
):
    things, random = placed(seed, config, 0.05)
    faults = Faults(scan_every_s=round(every_s, 2))
    trial = Trial(config, things, faults, random).run(-v if back else v, wz, 6.0)
    assert trial.nearest_m > 0.0


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.2), st.floats(-1.5, 1.5), st.floats(0.0, 0.2))
@settings(deadline=None, max_examples=15)
def test_lateness_may_be_in_the_reading_or_in_the_base_as_long_as_their_sum_is_configured(
    seed, v, wz, share_s
):
    things, random = placed(seed, CONFIG, 0.05)
    late_s = round(share_s, 2)
    faults = Faults(scan_read_late_s=late_s, base_dead_s=0.2 - late_s)
    assert Trial(CONFIG, things, faults, random).run(v, wz, 5.0).nearest_m > 0.0


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.2), st.floats(-0.8, 0.8), st.floats(0.0, 0.4))
@settings(deadline=None, max_examples=15)
def test_beams_that_are_lost_at_random_do_not_hide_a_thing_for_long_enough(seed, v, wz, dropped):
    things, random = placed(seed, CONFIG, 0.05)
    assert Trial(CONFIG, things, Faults(dropped=dropped), random).run(v, wz, 5.0).nearest_m > 0.0


@given(st.floats(0.4, 1.0), st.floats(0.05, 0.15), st.floats(0.5, 1.5), st.floats(0.3, 2.0))
@settings(deadline=None, max_examples=15)
def test_fast_and_weak_bases_are_stopped_in_time_as_well(v, dead_s, latency_factor, decel):
    limits = LimitsConfig(speed_mps=v, decel_mps2=decel)
    latency_s = (dead_s + TICK_S) * max(latency_factor, 1.0)
    config = replace(CONFIG, limits=limits, guard=GuardConfig(latency_s=latency_s))
    faults = Faults(base_dead_s=round(dead_s, 2))
    trial = Trial(config, box(4.0, 0.03, 0.2), faults, np.random.default_rng(0))
    assert trial.run(v, 0.0, 12.0).nearest_m > 0.0
    assert trial.pose[0] > 4.0 - 0.1 - 0.12 - CONFIG.guard.margin_m - 0.06  # and not far too early


@given(st.floats(0.1, 0.3), st.floats(-0.4, 0.4), st.floats(0.1, 0.2))
@settings(deadline=None, max_examples=15)
@example(speed=0.125, direction=0.375, v=0.15234375)  # it passes the standing robot and comes into its flank
def test_what_comes_from_ahead_no_faster_than_stated_finds_the_robot_standing(speed, direction, v):
    config = replace(CONFIG, guard=GuardConfig(obstacle_speed_mps=0.3))
    towards = (-speed * math.cos(direction), -speed * math.sin(direction))
    things = box(1.2 * math.cos(direction) + 0.2, 1.2 * math.sin(direction))
    faults = Faults(obstacle_mps=towards)
    trial = Trial(config, things, faults, np.random.default_rng(1)).run(v, 0.0, 1.2 / speed + 2.0)
    things = carried_along(trial.things, (0.0, 0.0, 0.0), trial.pose)
    x, _ = min(things.tolist(), key=lambda thing: math.hypot(*thing))
    assert trial.touched_mps < 1e-6 or x < 0.03  # beside its middle, where the way is free: it drives on


@given(st.floats(0.0, 0.2), st.floats(0.05, 0.2))
@settings(deadline=None, max_examples=20)
def test_a_thing_that_appears_inside_the_stopping_distance_is_approached_no_more_than_cannot_be_helped(
    gap, v
):
    trial = Trial(CONFIG, np.array([[9.0, 9.0]]), Faults(), np.random.default_rng(2))
    trial.run(v, 0.0, 2.0)
    x_m, speed = trial.pose[0], trial.v
    trial.things, trial.sweeps, trial.trail = box(x_m + 0.12 + gap + 0.025, 0.0), [], []
    trial.run(v, 0.0, 4.0)
    cannot_help_m = stopping_way(speed, 0.1 + 0.05 + 0.15 + 0.04, CONFIG.limits.decel_mps2)
    if trial.nearest_m < 0.0:
        assert gap < cannot_help_m
    else:
        assert trial.v < 1e-9
        assert trial.pose[0] - x_m <= max(gap, cannot_help_m)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_a_wish_that_is_no_number_stops(wrong):
    for v, wz in ((wrong, 0.0), (0.1, wrong), (wrong, wrong)):
        safe = guard(NO_POINTS, v, wz, NO_PEERS, CONFIG)
        assert (safe.v_mps, safe.wz_radps, safe.limited) == (0.0, 0.0, True)


def test_a_thing_whose_place_is_no_number_is_in_the_way():
    nowhere = np.array([[math.nan, 0.3]])
    assert guard(nowhere, 0.2, 0.0, NO_PEERS, CONFIG).v_mps == 0.0
    assert guard(NO_POINTS, 0.2, 0.0, np.array([[0.5, math.nan, 0.12]]), CONFIG).v_mps == 0.0


def test_returns_from_its_own_body_do_not_hold_a_robot():
    antenna = np.array([[0.05, 0.02], [0.06, 0.02]])
    assert not guard(antenna, 0.2, 0.0, NO_PEERS, CONFIG).limited
    skin = np.array([[0.11, 0.0]])  # just inside: something pressed against it, not a part of it
    assert guard(skin, 0.2, 0.0, NO_PEERS, CONFIG).limited
    assert not guard(skin, -0.2, 0.0, NO_PEERS, CONFIG).limited


def test_behind_a_lidar_that_sees_a_sector_no_way_is_free():
    for v, wz in ((-0.1, 0.0), (-0.05, 0.5), (-0.3, -0.1)):
        assert guard(NO_POINTS, v, wz, NO_PEERS, CONFIG).v_mps == v
        safe = guard(NO_POINTS, v, wz, NO_PEERS, CONFIG, whole=False)
        assert (safe.v_mps, safe.wz_radps, safe.limited, safe.free_m) == (0.0, wz, True, 0.0)
    assert not guard(NO_POINTS, 0.2, 0.3, NO_PEERS, CONFIG, whole=False).limited


def test_a_base_that_is_faster_than_commanded_is_reckoned_with_as_fast_as_it_is():
    wall = np.stack([np.full(41, 0.27), np.linspace(-1, 1, 41)], axis=1)
    assert not guard(wall, 0.15, 0.0, NO_PEERS, CONFIG).limited
    fast = guard(wall, 0.15, 0.0, NO_PEERS, CONFIG, Lateness(v_mps=0.4))
    assert fast.stop_m == pytest.approx(stopping_way(0.4, 0.25, 0.5))
    assert fast.v_mps <= 0.15
    backwards = guard(wall, 0.15, 0.0, NO_PEERS, CONFIG, Lateness(v_mps=-0.4))
    assert backwards.stop_m == pytest.approx(stopping_way(0.15, 0.25, 0.5))


def test_old_odometry_counts_as_way_already_driven():
    wall = np.stack([np.full(41, 0.26), np.linspace(-1, 1, 41)], axis=1)
    fresh = guard(wall, 0.2, 0.0, NO_PEERS, CONFIG)
    late = guard(wall, 0.2, 0.0, NO_PEERS, CONFIG, Lateness(odometry_s=0.3))
    assert late.v_mps < fresh.v_mps
    assert late.stop_m - fresh.stop_m == pytest.approx(0.2 * 0.3)


def test_a_guard_that_holds_says_what_it_saw():
    safe = guard(np.array([[0.2, 0.0]]), 0.2, 0.0, NO_PEERS, CONFIG)
    assert safe.nearest_m == pytest.approx(0.08)
    assert safe.free_m == pytest.approx(0.05, abs=0.0101)
    assert safe.stop_m == pytest.approx(0.09)
    assert guard(NO_POINTS, 0.2, 0.0, NO_PEERS, CONFIG).nearest_m == math.inf
