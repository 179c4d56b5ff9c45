"""The scan guard: whatever is commanded, nothing seen is touched; and nobody is kept from leaving."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hippomat_core.config import Config, LidarConfig
from hippomat_core.control.guard import carried_along, guard, scan_points
from hippomat_core.messages import ScanReceived

CONFIG = Config()
RADIUS_M = CONFIG.robot.radius_m
NO_PEERS = np.zeros((0, 3))
NO_POINTS = np.zeros((0, 2))


def sweep(*returns: tuple[float, float]) -> ScanReceived:
    """(clockwise degrees, metres) each."""
    angle = np.array([round(a * 64) for a, _ in returns], np.uint16)
    distance = np.array([round(r * 4000) for _, r in returns], np.uint16)
    return ScanReceived(0, np.full(len(returns), 15, np.uint8), angle, distance)


def test_the_lidar_faces_backwards_and_counts_clockwise() -> None:
    points = scan_points(sweep((0, 1.0), (90, 2.0), (180, 3.0)), LidarConfig())
    assert points == pytest.approx(np.array([[-1.0, 0.0], [0.0, 2.0], [3.0, 0.0]]), abs=1e-9)


def test_the_lidars_place_is_added_and_its_yaw_turns() -> None:
    lidar = LidarConfig(x_m=0.05, y_m=-0.02, yaw_rad=0.0)
    points = scan_points(sweep((0, 1.0), (90, 2.0)), lidar)
    assert points == pytest.approx(np.array([[1.05, -0.02], [0.05, -2.02]]), abs=1e-9)


def test_returns_outside_the_range_and_no_returns_are_left_out() -> None:
    assert scan_points(sweep((0, 0.0), (10, 0.1), (20, 0.2), (30, 13.0)), LidarConfig()).shape == (1, 2)
    assert scan_points(sweep(), LidarConfig()).shape == (0, 2)


def test_points_are_carried_into_the_frame_of_the_robot_that_moved_on() -> None:
    then, now = (1.0, 2.0, 0.3), (1.2, 2.1, 1.1)
    world = np.array([[2.0, 2.5], [0.0, 0.0]])

    def seen(pose: tuple[float, float, float]) -> np.ndarray:
        dx, dy = world[:, 0] - pose[0], world[:, 1] - pose[1]
        c, s = math.cos(pose[2]), math.sin(pose[2])
        return np.stack([c * dx + s * dy, -s * dx + c * dy], axis=1)

    assert carried_along(seen(then), then, now) == pytest.approx(seen(now))


def driven_until_still(points: np.ndarray, v_mps: float, wz_radps: float) -> float:
    """The nearest a point comes while a robot that brakes as configured obeys the guard, latency included."""
    pose, speed, nearest = (0.0, 0.0, 0.0), v_mps, math.inf
    dt_s, delay = 0.01, round(CONFIG.guard.latency_s / 0.01)
    commands = [(v_mps, wz_radps)] * delay
    for _ in range(600):
        safe = guard(carried_along(points, (0.0, 0.0, 0.0), pose), v_mps, wz_radps, NO_PEERS, CONFIG)
        commands.append((safe.v_mps, safe.wz_radps))
        v, wz = commands.pop(0)
        change = CONFIG.limits.accel_mps2 * dt_s
        speed += max(-change, min(change, v - speed))
        turn = wz if abs(v) < 1e-9 else wz * speed / v
        x, y, yaw = pose
        pose = (x + speed * math.cos(yaw) * dt_s, y + speed * math.sin(yaw) * dt_s, yaw + turn * dt_s)
        gaps = np.hypot(points[:, 0] - pose[0], points[:, 1] - pose[1])
        nearest = min(nearest, float(gaps.min()))
    return nearest


@given(st.integers(0, 2**32 - 1), st.floats(0.03, 0.5), st.floats(-1.5, 1.5), st.booleans())
@settings(max_examples=25, deadline=None)
def test_no_point_in_the_corridor_is_ever_touched(seed: int, v: float, wz: float, back: bool) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (6, 2))
    # The first latency cannot be prevented: begin where the guard lets the wanted speed be.
    stop_m = v * CONFIG.guard.latency_s + v * v / (2 * CONFIG.limits.accel_mps2)
    points = points[np.hypot(*points.T) > RADIUS_M + CONFIG.guard.margin_m + stop_m + 0.01]
    if len(points):
        assert driven_until_still(points, -v if back else v, wz) > RADIUS_M


def test_a_wall_ahead_stops_and_a_wall_behind_does_not() -> None:
    wall = np.stack([np.full(41, 0.155), np.linspace(-1, 1, 41)], axis=1)
    ahead = guard(wall, 0.2, 0.5, NO_PEERS, CONFIG)
    assert (ahead.v_mps, ahead.wz_radps, ahead.limited) == (0.0, 0.5, True)
    behind = guard(-wall, 0.2, 0.5, NO_PEERS, CONFIG)
    assert (behind.v_mps, behind.limited) == (0.2, False)
    reverse = guard(-wall, -0.2, 0.0, NO_PEERS, CONFIG)
    assert (reverse.v_mps, reverse.limited) == (0.0, True)


def test_turning_in_place_is_always_allowed() -> None:
    ring = 0.13 * np.stack([np.cos(np.arange(0, 6.28, 0.1)), np.sin(np.arange(0, 6.28, 0.1))], axis=1)
    safe = guard(ring, 0.0, -1.5, NO_PEERS, CONFIG)
    assert (safe.v_mps, safe.wz_radps, safe.limited) == (0.0, -1.5, False)


def test_a_robot_that_is_too_near_may_drive_away_or_along() -> None:
    point = np.array([[-0.13, 0.02]])
    assert not guard(point, 0.2, 0.0, NO_PEERS, CONFIG).limited
    wall_beside = np.stack([np.linspace(-1, 1, 81), np.full(81, 0.17)], axis=1)
    assert not guard(wall_beside, 0.2, 0.0, NO_PEERS, CONFIG).limited


def test_slowing_keeps_the_curvature() -> None:
    safe = guard(np.array([[0.20, 0.0]]), 0.2, 0.1, NO_PEERS, CONFIG)
    assert 0.0 < safe.v_mps < 0.2
    assert safe.wz_radps / safe.v_mps == pytest.approx(0.5)


def test_a_peer_is_a_disc_even_where_the_lidar_sees_nothing() -> None:
    ahead, behind = np.array([[0.272, 0.0, RADIUS_M]]), np.array([[-0.28, 0.0, RADIUS_M]])
    assert guard(NO_POINTS, 0.2, 0.0, ahead, CONFIG).v_mps == 0.0
    assert not guard(NO_POINTS, 0.2, 0.0, behind, CONFIG).limited
