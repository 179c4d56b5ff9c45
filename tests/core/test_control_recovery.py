"""A robot that is stuck: what it tries, in which order, and that it ends."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hippomat_core.config import Config
from hippomat_core.control.follower import Motion
from hippomat_core.control.recovery import (
    BACK_UP,
    CLEAR,
    DRIVE,
    GIVE_UP,
    NEXT,
    TURN,
    WAIT,
    Recovery,
    Symptoms,
    recover,
)

CONFIG = Config()
TICK_NS = 50_000_000
GOAL = (5.0, 0.0)
STUCK = Symptoms(GOAL, waits=False, held=True, commanded_mps=0.0, remaining_m=5.0)
SEQUENCE = [CLEAR, BACK_UP, TURN, WAIT, GIVE_UP]


class Stander:
    """A robot that obeys recovery's orders, or does not, and otherwise stays where it is."""

    def __init__(self, obeys: bool = True, x: float = 0.0) -> None:
        self.recovery, self.stamp_ns, self.obeys = Recovery(), 0, obeys
        self.x, self.y, self.yaw, self.wheels_mps = x, 0.0, 0.0, 0.0
        self.began: list[tuple[float, str, str]] = []

    def came_along(self, metres: float) -> Stander:
        """It drove here, straight on."""
        for _ in range(round(metres / 0.01)):
            self.x += 0.01
            self.tick(replace(STUCK, held=False, commanded_mps=0.2, remaining_m=5.0 - self.x))
        return self

    def tick(self, seen: Symptoms, obstructed: bool = False):
        self.stamp_ns += TICK_NS
        motion = Motion(self.x, self.y, self.yaw, self.wheels_mps)
        self.recovery, order = recover(self.recovery, self.stamp_ns, motion, seen, CONFIG)
        if order.began:
            self.began.append((self.stamp_ns / 1e9, order.step, self.recovery.cause))
        if self.obeys and not obstructed:
            self.yaw += order.wz_radps * 0.05
            self.x += order.v_mps * math.cos(self.yaw) * 0.05
            self.y += order.v_mps * math.sin(self.yaw) * 0.05
        return order

    def run(self, seconds: float, seen: Symptoms = STUCK, obstructed: bool = False) -> Stander:
        for _ in range(round(seconds * 20)):
            self.tick(seen, obstructed)
        return self

    @property
    def steps(self) -> list[str]:
        return [step for _, step, _ in self.began]


def test_the_sequence_ends_with_giving_up():
    walked, step = [], DRIVE
    while step != GIVE_UP:
        step = NEXT[step]
        walked.append(step)
    assert walked == SEQUENCE


def test_a_robot_that_nothing_frees_tries_everything_once_and_gives_up_within_a_minute():
    stander = Stander().came_along(0.6).run(60)
    assert stander.steps[:5] == SEQUENCE
    assert stander.began[0][0] == pytest.approx(3.0 + CONFIG.recovery.stuck_s, abs=0.6)
    assert {cause for _, _, cause in stander.began[:5]} == {"guard"}


def test_a_robot_whose_lidar_does_not_look_behind_does_not_back_up():
    stander = Stander().came_along(0.6).run(60, replace(STUCK, behind=False))
    assert stander.steps[:4] == [CLEAR, TURN, WAIT, GIVE_UP]
    assert BACK_UP not in stander.steps


def test_backing_up_ends_when_the_lidar_looks_behind_no_more():
    stander = Stander().came_along(0.6)
    while stander.recovery.step != BACK_UP:
        stander.tick(STUCK)
    assert stander.tick(STUCK).v_mps < 0.0
    assert stander.tick(replace(STUCK, behind=False)).v_mps == 0.0


@given(
    st.lists(
        st.tuples(st.booleans(), st.booleans(), st.floats(0.0, 0.2), st.floats(0.5, 9.0)),
        min_size=1,
        max_size=9,
    ),
    st.integers(0, 2**32 - 1),
)
@settings(deadline=None, max_examples=8)
def test_whatever_it_senses_a_robot_that_comes_no_nearer_gives_up_in_a_bounded_time(phases, seed):
    random, stander, tick = np.random.default_rng(seed), Stander(), 0
    longest_s = CONFIG.recovery.distant_s + 2 * 9.5 / CONFIG.limits.speed_mps + 4 * 20.0 + 5 * 8.0 + 9.0
    while GIVE_UP not in stander.steps:
        _, held, commanded, remaining = phases[tick // 40 % len(phases)]
        seen = Symptoms(GOAL, False, held, commanded, max(remaining, 0.5))
        stander.tick(seen)
        stander.x += random.uniform(-0.02, 0.02)  # to and fro
        stander.yaw += random.uniform(-0.2, 0.2)
        tick += 1
        assert tick * 0.05 < longest_s
    assert [step for step in stander.steps if step != GIVE_UP][:4] == SEQUENCE[:4]


def test_a_robot_that_moves_on_is_never_stuck():
    stander = Stander()
    for k in range(2000):
        stander.x += 0.004
        stander.tick(replace(STUCK, held=k % 2 == 0, remaining_m=9.0 - stander.x))
    assert stander.began == []


def test_a_long_detour_is_no_reason_as_long_as_it_leads_on():
    stander, left_m = Stander(), 12.0
    stander.run(1.0, replace(STUCK, remaining_m=1.0))
    while left_m > 1.0:
        stander.x += 0.01
        left_m -= 0.01
        stander.tick(replace(STUCK, held=False, remaining_m=left_m))
    assert stander.began == []


def test_waiting_for_a_robot_that_is_heard_is_not_being_stuck_until_much_longer():
    waits = replace(STUCK, waits=True, held=False)
    assert Stander().run(CONFIG.recovery.waiting_s - 2.0, waits).began == []
    told = Stander().run(CONFIG.recovery.waiting_s + 2.0, waits).began
    assert [(step, cause) for _, step, cause in told] == [(CLEAR, "waiting")]


def test_a_robot_that_stands_on_purpose_is_not_stuck():
    assert Stander().run(300, replace(STUCK, goal=None)).began == []
    stander = Stander().run(7)
    stander.tick(replace(STUCK, goal=None))  # a moment of STOP: time begins anew
    assert stander.run(7).began == []
    stander = Stander().run(7)
    assert stander.run(7, replace(STUCK, goal=(0.0, 3.0))).began == []


@pytest.mark.parametrize(
    ("wheels_mps", "held", "commanded_mps", "cause"),
    [
        (0.0, True, 0.0, "guard"),
        (0.2, False, 0.2, "slip"),
        (0.0, False, 0.2, "wheels"),
        (0.0, False, 0.0, "blocked"),
    ],
)
def test_the_cause_is_told_apart_by_what_wheels_pose_and_guard_say(wheels_mps, held, commanded_mps, cause):
    stander = Stander()
    stander.wheels_mps = wheels_mps
    stander.run(9, replace(STUCK, held=held, commanded_mps=commanded_mps))
    assert [told for _, _, told in stander.began] == [cause]


def test_it_backs_up_along_the_way_it_came_and_no_further_than_configured():
    seen = replace(STUCK, held=False)
    stander = Stander().came_along(0.6).run(13.5, seen)
    assert stander.steps == [CLEAR, BACK_UP]
    stander.run(4, seen)
    assert 0.6 - stander.x == pytest.approx(CONFIG.recovery.back_m, abs=0.03)
    assert abs(stander.y) < 0.02


def test_it_does_not_back_up_where_it_has_not_come_from():
    stander = Stander().run(14)
    assert stander.steps == [CLEAR, BACK_UP]
    assert stander.x == 0.0


def test_backing_up_ends_when_the_guard_holds_it():
    stander = Stander().came_along(0.6).run(13.4, obstructed=True)
    assert stander.recovery.step == BACK_UP
    stander.run(1.5, obstructed=True)
    assert stander.recovery.step == DRIVE


def test_who_is_free_begins_anew_the_next_time():
    stander = Stander().came_along(0.6).run(9)
    assert stander.recovery.stuck
    stander.came_along(1.0)
    assert not stander.recovery.stuck
    stander.run(9)
    assert stander.steps == [CLEAR, CLEAR]
