"""What the core makes of ROS: where the robot is, what its lidar sees, and how old what it knows is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ros_samples import MS, OFFSET_NS, scan, transform

from hippomat_core.config import RosConfig
from hippomat_core.messages import OdometryReceived
from hippomat_core.ros.clock import BACK, RosClock
from hippomat_core.ros.feed import RosFeed, with_odometry, with_scan, with_transform
from hippomat_core.ros.transforms import HERE, Rigid, Transforms
from hippomat_core.slam.pose2 import compose

ROS = RosConfig(url="ws://x")
angles = st.floats(-3.1, 3.1)
metres = st.floats(-50.0, 50.0)
poses = st.tuples(metres, metres, angles)
quaternions = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(v * v for v in q) > 0.1)


def fed(*events, feed=None, ros=ROS) -> RosFeed:
    feed = feed or RosFeed()
    for event in events:
        feed = with_transform(feed, event, ros)
    return feed


def rigid(move, q) -> Rigid:
    length = math.sqrt(sum(v * v for v in q))
    return Rigid(move, tuple(v / length for v in q))


def matrix(r: Rigid) -> np.ndarray:
    """4 x 4, from what it does to the axes."""
    columns = [r.rotated(axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
    return np.vstack([np.column_stack([*columns, r.move]), [0, 0, 0, 1]])


# ---- transforms ----


@given(st.tuples(metres, metres, metres), quaternions, st.tuples(metres, metres, metres), quaternions)
def test_rigid_motions_compose_as_their_matrices_do(move, q, inner_move, inner_q):
    outer, inner = rigid(move, q), rigid(inner_move, inner_q)
    assert matrix(inner.within(outer)) == pytest.approx(matrix(outer) @ matrix(inner), abs=1e-9)
    turn = matrix(outer)[:3, :3]
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-12)


@given(poses, poses)
def test_the_pose_is_the_chain_of_correction_and_odometry(correction, odom):
    feed = fed(transform("map", "odom", 0, correction), transform("odom", "base_link", 1, odom))
    assert feed.pose is not None
    assert feed.pose[:2] == pytest.approx(compose(correction, odom)[:2], abs=1e-9)
    assert math.remainder(feed.pose[2] - correction[2] - odom[2], math.tau) == pytest.approx(0.0, abs=1e-9)


@given(st.permutations(range(4)))
def test_the_order_in_which_a_chain_becomes_known_does_not_matter(order):
    links = [
        transform("map", "odom", 0, (1.0, 2.0, 0.5)),
        transform("odom", "base_footprint", 0, (0.5, 0.0, 0.1)),
        transform("base_footprint", "base_link", 0, (0.0, 0.1, 0.0), fixed=True),
        transform("base_link", "laser", 0, (0.1, 0.0, 3.0), fixed=True),
    ]
    feed = fed(*(links[k] for k in order))
    assert feed.pose == pytest.approx(fed(*links).pose, abs=1e-12)


def test_a_loop_of_frames_is_no_way_and_no_endless_one():
    loop = fed(transform("b", "a", 0), transform("a", "b", 0)).transforms
    assert loop.way("a", "map") is None
    assert loop.top("a") in ("a", "b")


def test_a_transform_that_is_no_rotation_or_no_place_is_left_out():
    good = transform("map", "odom", 0)
    for bad in (replace(good, qw=0.0), replace(good, x_m=math.nan), replace(good, qz=math.inf)):
        assert Transforms({}).with_transform(bad, 0).edges == {}


def test_a_hanging_lidar_sees_its_left_on_the_robots_right():
    upside_down = rigid((0.2, 0.0, 0.1), (1.0, 0.0, 0.0, 0.0))
    assert upside_down.flattened(np.array([[1.0, 2.0]])) == pytest.approx(np.array([[1.2, -2.0]]))


# ---- freshness ----


def test_a_robot_is_localized_while_both_parts_of_the_chain_are_fresh():
    feed = fed(transform("odom", "base_link", 0))
    assert not feed.localized(0, ROS)
    feed = fed(transform("map", "odom", 10), feed=feed)
    assert feed.localized(20 * MS, ROS)
    assert not feed.localized(600 * MS, ROS)  # the odometry stopped
    feed = fed(*(transform("odom", "base_link", ms) for ms in range(100, 4000, 100)), feed=feed)
    assert not feed.localized(3900 * MS, ROS)  # the localization stopped


def test_a_correction_that_is_fixed_never_gets_old():
    feed = fed(transform("map", "odom", 0, fixed=True), transform("odom", "base_link", 99_000))
    assert feed.localized(99_100 * MS, ROS)


def test_a_correction_stamped_ahead_makes_nothing_else_look_old():
    """AMCL stamps map -> odom a second into the future."""
    feed = RosFeed()
    for ms in range(0, 2000, 50):
        ahead = transform("map", "odom", ms, ahead_ms=1000)
        feed = fed(ahead, transform("odom", "base_link", ms), feed=feed)
    assert feed.localized(1960 * MS, ROS)


@given(st.lists(st.integers(0, 400), min_size=1, max_size=40))
def test_an_age_counts_from_the_promptest_message(delays_ms):
    clock = RosClock()
    for k, delay_ms in enumerate(delays_ms):
        sent_ms = 1000 * k
        stamp_ns, ros_ns = (sent_ms + delay_ms) * MS, sent_ms * MS - OFFSET_NS
        clock = clock.heard(stamp_ns, ros_ns)
        known = min(delays_ms[max(0, k - 29) : k + 1])
        age_ns = stamp_ns - clock.taken_ns(stamp_ns, ros_ns)
        assert 0 <= age_ns <= (delay_ms - min(delays_ms[: k + 1])) * MS
        assert age_ns >= (delay_ms - known) * MS


def test_a_clock_that_goes_back_for_every_source_is_believed_again():
    clock = RosClock().heard(0, 5_000_000 * MS, "scan").heard(0, 5_000_000 * MS, "odom")
    for ms in range(100, 100 + 10 * BACK, 10):
        assert clock.taken_ns(ms * MS, ms * MS) < 0  # old until then: the robot stands
        clock = clock.heard(ms * MS, ms * MS, "scan" if ms % 20 else "odom")
    assert clock.taken_ns(400 * MS, 390 * MS) == 390 * MS


@given(
    st.sampled_from([500, 800, 1200, 2000, 5000]),
    st.integers(0, 50),
    st.integers(1, 20),
    st.lists(st.integers(0, 30), min_size=60, max_size=60),
)
def test_a_source_that_gets_late_is_no_clock_that_went_back(late_ms, prompt_ms, period, jitter_ms):
    """Also if it comes more often than those that are on time; a queue keeps the order of its stamps."""
    clock, sent_ms = RosClock(), 0
    for k, more_ms in enumerate(jitter_ms):
        now_ms = 10_000 + 50 * k
        if k % period == 0:
            clock = clock.heard(now_ms * MS, (now_ms - prompt_ms) * MS - OFFSET_NS, "odom")
        delay_ms = 0 if k < 10 else late_ms + more_ms
        sent_ms = max(sent_ms, now_ms - prompt_ms - delay_ms)
        stamp_ns, ros_ns = now_ms * MS, sent_ms * MS - OFFSET_NS
        clock = clock.heard(stamp_ns, ros_ns, "scan")
        age_ns = stamp_ns - clock.taken_ns(stamp_ns, ros_ns)
        assert age_ns == (now_ms - prompt_ms - sent_ms) * MS


def test_a_lidar_that_alone_is_heard_may_get_late_too():
    """Its stamps fall behind, and never back."""
    clock = RosClock().heard(1000 * MS, 1000 * MS, "scan")
    for k in range(100):
        stamp_ns, ros_ns = (5000 + 100 * k) * MS, (1100 + 100 * k) * MS
        clock = clock.heard(stamp_ns, ros_ns, "scan")
        assert stamp_ns - clock.taken_ns(stamp_ns, ros_ns) == 3900 * MS


def test_drifting_clocks_do_not_age_what_is_new():
    clock, worst_ns = RosClock(), 0
    for second in range(3600):
        stamp_ns, ros_ns = second * 1000 * MS, round(second * 1000 * MS * 0.9999) + MS  # 100 ppm
        clock = clock.heard(stamp_ns, ros_ns)
        worst_ns = max(worst_ns, stamp_ns - clock.taken_ns(stamp_ns, ros_ns))
    assert worst_ns < 10 * MS


# ---- scans and speed ----


def test_a_scan_that_was_queued_is_as_old_as_its_stamp_says():
    feed = fed(transform("odom", "base_link", 0), transform("base_link", "laser", 0, fixed=True))
    _, points, taken_ns = with_scan(feed, scan(1000, [1.0, 2.0, 3.0], late_ms=700), "base_link")
    assert taken_ns == 300 * MS
    assert points == pytest.approx(np.array([[0.0, -1.0], [2.0, 0.0], [0.0, 3.0]]), abs=1e-6)


def test_no_return_too_near_and_too_far_are_no_points():
    feed = fed(transform("base_link", "laser", 0, fixed=True))
    nothing = [math.inf, math.nan, 0.05, 11.0, -1.0]
    _, points, _ = with_scan(feed, scan(0, nothing), "base_link")
    assert points is not None
    assert points.shape == (0, 2)


def test_a_scan_in_an_unknown_frame_is_no_scan():
    _, points, _ = with_scan(RosFeed(), scan(0, [1.0]), "base_link")
    assert points is None


def test_a_scan_gets_the_pose_it_was_taken_at():
    steps = (transform("odom", "base_link", ms, (ms / 1000, 0.0, ms / 500)) for ms in range(0, 501, 50))
    feed = fed(*steps)
    assert feed.odom_at(225 * MS) == pytest.approx((0.225, 0.0, 0.45))
    assert feed.odom_at(-5 * MS) == pytest.approx((0.0, 0.0, 0.0))
    assert feed.odom_at(900 * MS) == pytest.approx((0.5, 0.0, 1.0))


@given(st.floats(-1.0, 1.0), st.floats(-2.0, 2.0))
def test_speed_from_transforms_is_what_was_driven(v_mps, wz_radps):
    x = y = yaw = 0.0
    feed = RosFeed()
    for ms in range(0, 400, 20):
        feed = fed(transform("odom", "base_link", ms, (x, y, yaw)), feed=feed)
        middle = yaw + wz_radps * 0.01
        x, y, yaw = (
            x + v_mps * 0.02 * math.cos(middle),
            y + v_mps * 0.02 * math.sin(middle),
            yaw + wz_radps * 0.02,
        )
    assert feed.velocity == pytest.approx((v_mps, wz_radps), abs=0.02)


def test_a_measured_speed_wins_while_it_is_fresh():
    feed = with_odometry(fed(transform("odom", "base_link", 0)), OdometryReceived(0, -OFFSET_NS, 0.3, 0.1))
    assert feed.velocity == (0.3, 0.1)
    feed = fed(transform("odom", "base_link", 900), feed=feed)
    assert feed.velocity == (0.0, 0.0)


def test_a_localization_that_says_map_to_base_directly_is_understood():
    feed = fed(*(transform("map", "base_link", ms, (ms / 1000, 1.0, 0.0)) for ms in range(0, 300, 50)))
    assert feed.pose == pytest.approx((0.25, 1.0, 0.0))
    assert feed.velocity[0] == pytest.approx(1.0)


def test_here_is_the_identity():
    assert HERE.flat() == (0.0, 0.0, 0.0)
