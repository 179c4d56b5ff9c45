"""The follower: every command within every limit, whatever it is asked; and a lagging robot still arrives."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hippomat_core.config import Config, ControlConfig, LimitsConfig, RobotConfig
from hippomat_core.control.follower import (
    REACTION_S,
    SLOWEST_MPS,
    Drive,
    Motion,
    braking_speed,
    follow,
    limited,
    look_ahead_m,
    regulated_speed,
    turn_bound,
)
from hippomat_core.control.nav_state import Navigator
from hippomat_core.control.navigator import navigate
from hippomat_core.control.pursuit import pursued_point
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.costmap import inflate
from hippomat_core.planning.distance_field import distance_field
from hippomat_sim.maps.demo_room import draw_demo_room

CONFIG = Config(robot=RobotConfig(id=0))
EMPTY = inflate(OccupancyGrid(np.zeros((200, 200), np.int8), 0.05, -5.0, -5.0), 0.17)
ROOM = draw_demo_room()
ROOM_MAP = inflate(ROOM, 0.17)
TICK_S = 0.05
EXACT = 1e-9

limits_of_a_base = st.builds(
    LimitsConfig,
    speed_mps=st.floats(0.02, 5.0),
    accel_mps2=st.floats(0.05, 20.0),
    decel_mps2=st.floats(0.05, 20.0),
    lateral_accel_mps2=st.floats(0.01, 20.0),
    curvature_per_m=st.floats(0.1, 100.0),
    turn_radps=st.floats(0.1, 10.0),
    turn_accel_radps2=st.floats(0.1, 50.0),
)


def assert_within_limits(last: Drive, now: Drive, dt_s: float, limits: LimitsConfig) -> None:
    faster_m = abs(now.v_mps) - abs(last.v_mps)
    assert abs(now.v_mps) <= limits.speed_mps + EXACT
    assert -limits.decel_mps2 * dt_s - EXACT <= faster_m <= limits.accel_mps2 * dt_s + EXACT
    assert now.v_mps * last.v_mps >= 0.0  # through standing, never over it
    turn = limits.turn_accel_radps2 * dt_s
    assert abs(now.wz_radps - last.wz_radps) <= turn + EXACT
    assert abs(now.wz_radps) <= limits.turn_radps + EXACT
    # Curvature and lateral acceleration: kept, or on the way there as fast as the turn can be braked.
    assert abs(now.wz_radps) <= max(turn_bound(now.v_mps, limits), abs(last.wz_radps) - turn) + EXACT


@given(
    limits_of_a_base,
    st.lists(st.tuples(st.floats(-9, 9), st.floats(-20, 20), st.floats(0.0, 0.2)), min_size=1, max_size=40),
)
@settings(deadline=None)
def test_whatever_is_wished_for_no_limit_is_passed(limits, wishes):
    last = Drive()
    for v, wz, dt_s in wishes:
        now = limited(Drive(v, wz), last, dt_s, limits)
        assert_within_limits(last, now, dt_s, limits)
        last = now


@given(limits_of_a_base, st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=50)
def test_no_path_and_no_sequence_of_poses_makes_a_command_pass_a_limit(limits, seed):
    random, config, last = np.random.default_rng(seed), replace(CONFIG, limits=limits), Drive()
    for _ in range(30):
        ahead = random.uniform(-2, 2, (1, 2)) + np.cumsum(random.uniform(-0.07, 0.07, (12, 2)), axis=0)
        motion = Motion(*random.uniform(-2, 2, 2), random.uniform(-7, 7), *random.uniform(-1, 1, 2))
        free_m = float(random.choice([0.0, 0.003, random.uniform(0, 3)]))
        now = follow(ahead, free_m, motion, last, TICK_S, config, EMPTY)
        assert_within_limits(last, now, TICK_S, limits)
        assert now.v_mps >= 0.0
        last = now


@given(st.floats(0.0, 100.0), st.floats(-0.2, 2.0), limits_of_a_base)
def test_the_regulated_speed_keeps_turn_rate_and_lateral_acceleration(curvature, room_m, limits):
    v = regulated_speed(curvature, room_m, replace(CONFIG, limits=limits))
    assert 0.0 < v <= limits.speed_mps
    assert v * curvature <= limits.turn_radps
    assert v * v * curvature <= limits.lateral_accel_mps2 + EXACT


def test_curves_and_tight_places_are_driven_slower_and_a_free_straight_is_not():
    def speed(curvature, room_m):
        return regulated_speed(curvature, room_m, CONFIG)

    fast = CONFIG.limits.speed_mps
    assert speed(0.0, 1.0) == speed(2.0, 1.0) == fast
    assert fast > speed(4.0, 1.0) > speed(8.0, 1.0) >= CONFIG.control.regulated_min_mps
    assert speed(0.0, 0.03) == pytest.approx(fast / 2)
    assert speed(0.0, -0.05) == CONFIG.control.regulated_min_mps


def test_the_look_ahead_grows_with_the_speed_between_its_bounds():
    control = ControlConfig(lookahead_s=1.5, lookahead_min_m=0.2, lookahead_max_m=0.9)
    assert [look_ahead_m(v, control) for v in (0.0, 0.4, -0.4, 2.0)] == pytest.approx([0.2, 0.6, 0.6, 0.9])


def test_the_pursued_point_lies_on_the_path_at_the_look_ahead():
    path = np.stack([np.arange(0.05, 2.0, 0.05), np.zeros(39)], axis=1)
    assert pursued_point(path, 0.0, 0.1, 0.5, EMPTY) == pytest.approx((math.sqrt(0.25 - 0.01), 0.0))
    assert pursued_point(path[:3], 0.0, 0.0, 0.5, EMPTY) == pytest.approx((0.15, 0.0))  # its end is nearer
    assert pursued_point(path[20:], 0.0, 0.0, 0.5, EMPTY) == pytest.approx(
        (1.05, 0.0)
    )  # its start is farther


@given(st.floats(0.5, 2.2), st.floats(-0.02, 0.02), st.floats(0.1, 5.0))
@settings(deadline=None)
def test_a_corner_is_not_cut_over_cells_that_are_not_free(y_m, aside_m, look_m):
    cells = np.zeros((60, 60), np.int8)
    cells[20:40, 20:40] = 100
    costmap = inflate(OccupancyGrid(cells, 0.05, 0.0, 0.0), 0.17)
    up = [(0.775, y) for y in np.arange(0.525, 2.23, 0.05) if y > y_m]
    path = np.array(up + [(x, 2.225) for x in np.arange(0.825, 2.0, 0.05)])
    x, y = pursued_point(path, 0.775 + aside_m, y_m, look_m, costmap)
    line = np.linspace((0.775 + aside_m, y_m), (x, y), 500)
    assert all(costmap.is_free(costmap.grid.cell_of(*point)) for point in line.tolist())


def test_where_nothing_is_in_the_way_the_farthest_point_is_pursued():
    around = np.array([(0.0, 0.5), (0.0, 1.0), (0.5, 1.0), (1.0, 1.0)])
    assert pursued_point(around, 0.0, 0.0, 5.0, EMPTY) == (1.0, 1.0)


@given(st.floats(0.3, 2.0), st.floats(0.0, 0.1), st.floats(0.0, 0.1))
@settings(deadline=None, max_examples=20)
def test_a_lagging_robot_stops_where_its_way_ends(free_m, delay_s, lag_s):
    path = np.stack([np.arange(0.05, 4.0, 0.05), np.zeros(79)], axis=1)
    base, last, x_m = LaggingBase(delay_s, lag_s), Drive(), 0.0
    for _ in range(600):
        left = path[path[:, 0] > x_m]
        last = follow(left, free_m - x_m, Motion(x_m, 0.0, 0.0, base.v), last, TICK_S, CONFIG, EMPTY)
        x_m += base.driven(last.v_mps, last.wz_radps)[0]
    unexpected_m = max(delay_s + lag_s - REACTION_S, 0.0) * CONFIG.limits.speed_mps
    assert free_m - 0.02 < x_m < free_m + 0.01 + unexpected_m
    assert base.v < 1e-3


@given(st.floats(0.0, 20.0))
def test_braking_from_the_braking_speed_takes_no_longer_than_the_way_that_is_free(free_m):
    limits = CONFIG.limits
    v = braking_speed(free_m, limits)
    assert v * 0.1 + v * v / (2 * 0.7 * limits.decel_mps2) == pytest.approx(free_m, abs=1e-9)


class LaggingBase:
    """Dead time, then a first-order lag: how wheels follow commands."""

    def __init__(self, delay_s: float, lag_s: float) -> None:
        self.queue = [(0.0, 0.0)] * round(delay_s / 0.01)
        self.keep = math.exp(-0.01 / lag_s) if lag_s > 1e-3 else 0.0
        self.v = self.wz = 0.0

    def driven(self, v: float, wz: float) -> tuple[float, list[tuple[float, float]]]:
        """Metres driven in one tick, and (v, wz) of each hundredth of a second."""
        steps = []
        for _ in range(round(TICK_S / 0.01)):
            self.queue.append((v, wz))
            to_v, to_wz = self.queue.pop(0)
            self.v = to_v + (self.v - to_v) * self.keep
            self.wz = to_wz + (self.wz - to_wz) * self.keep
            steps.append((self.v, self.wz))
        return sum(v for v, _ in steps) * 0.01, steps


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.15), st.floats(0.0, 0.15))
@settings(deadline=None, max_examples=8)
def test_with_lagging_wheels_every_goal_is_reached_and_the_path_is_kept(seed, delay_s, lag_s):
    random = np.random.default_rng(seed)
    iy, ix = np.nonzero(ROOM_MAP.free)
    start, goal = (ROOM.centre_of(int(ix[k]), int(iy[k])) for k in random.integers(0, len(ix), 2))
    field = distance_field(ROOM_MAP, ROOM.cell_of(*goal))
    (x, y), yaw, nav, base = (
        start,
        random.uniform(-math.pi, math.pi),
        Navigator(),
        LaggingBase(delay_s, lag_s),
    )
    farthest_m, path = 0.0, None
    ideal_s = field[ROOM.cell_of(*start)[1], ROOM.cell_of(*start)[0]] / CONFIG.limits.speed_mps
    for tick in range(round((ideal_s * 1.5 + 15.0) / TICK_S)):
        motion = Motion(x, y, yaw, base.v, base.wz)
        nav, out = navigate(nav, tick * 50_000_000, motion, goal, (), ROOM_MAP, field, CONFIG)
        if out.path is not None:
            path = ROOM_MAP.centres(out.path.cells)
        if path is not None and len(path):
            farthest_m = max(farthest_m, float(np.hypot(path[:, 0] - x, path[:, 1] - y).min()))
        if out.arrived and base.v < SLOWEST_MPS / 10 and out.v_mps == 0.0:
            break
        for v, wz in base.driven(out.v_mps, out.wz_radps)[1]:
            yaw += wz * 0.01
            x, y = x + v * math.cos(yaw) * 0.01, y + v * math.sin(yaw) * 0.01
    assert math.dist((x, y), goal) <= CONFIG.fleet.goal_tolerance_m
    assert farthest_m <= 0.08
