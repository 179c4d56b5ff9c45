"""Standard ROS topics of our records: equal to their definitions, and never a wait for a compiler."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hippomat_core import messages as m
from hippomat_core.config import Config
from hippomat_core.wire.rplidar import Sweep, SweepDecoder, encode_scan_descriptor
from hippomat_logs.cdr_template import Template
from hippomat_logs.derived import DerivedTopics
from hippomat_logs.scan_kernel import SCAN_BINS, nearest_by_degree
from hippomat_logs.schema import DERIVED, MessageStore, blank

STORE = MessageStore()
TIMES = st.integers(0, 10**9 * (1 << 31) - 1)  # what ROS can say
SWEEPS = st.integers(0, 60).flatmap(
    lambda n: st.tuples(
        arrays(np.uint8, n, elements=st.integers(0, 63)),
        arrays(np.uint16, n, elements=st.integers(0, 0x7FFF) | st.integers(0, 400)),
        arrays(np.uint16, n, elements=st.just(0) | st.integers(0, 0xFFFF)),
    )
)


def decoded(topic: str, data: bytes) -> Any:
    return STORE.decode_standard(data, DERIVED[topic])


@given(sweep=SWEEPS, t=TIMES)
def test_a_scan_holds_the_nearest_return_of_every_degree(sweep: tuple[np.ndarray, ...], t: int) -> None:
    quality, angle_q6, distance_q2 = sweep
    ranges, intensities = np.full(SCAN_BINS, np.inf, np.float32), np.zeros(SCAN_BINS, np.float32)
    for one_quality, angle, distance in zip(*(one.tolist() for one in sweep), strict=True):
        if distance:
            degree = -((angle + 32) // 64) % SCAN_BINS
            ranges[degree] = min(ranges[degree], np.float32(distance) / np.float32(4000))
            intensities[degree] = one_quality
    views = DerivedTopics(STORE, Config())
    for _ in range(2):  # nothing of the sweep before may remain
        ((topic, data),) = views.of(m.ScanReceived(1, quality, angle_q6, distance_q2), t)
    scan = decoded(topic, data)
    assert (scan.header.stamp.sec, scan.header.stamp.nanosec) == divmod(t, 10**9)
    assert (scan.header.frame_id, scan.angle_min) == ("lidar", 0.0)
    np.testing.assert_array_equal(scan.ranges, ranges)
    np.testing.assert_array_equal(scan.intensities, intensities)
    ((_, empty),) = views.of(m.ScanReceived(1, quality[:0], angle_q6[:0], distance_q2[:0]), t)
    assert np.isinf(decoded(topic, empty).ranges).all()


def test_a_robot_waits_for_no_compiler_once_it_records() -> None:
    views = DerivedTopics(STORE, Config())
    before = list(nearest_by_degree.signatures)
    returns = np.arange(50)
    sent = Sweep(*(returns.astype(kind) for kind in (np.uint8, np.uint16, np.uint16)))
    sweep = next(SweepDecoder().feed(encode_scan_descriptor() + 2 * sent.encode()))
    views.of(m.ScanReceived(1, sweep.quality, sweep.angle_q6, sweep.distance_q2), 1)
    assert nearest_by_degree.signatures == before


@given(
    pose=st.tuples(*[st.floats(-100, 100)] * 3),
    moved=st.lists(st.tuples(*[st.integers(-500, 500)] * 3), max_size=5),
    t=TIMES,
)
def test_a_pose_is_where_its_transforms_lead_and_the_odometry_is_one_of_them(
    pose: tuple[float, float, float], moved: list[tuple[int, int, int]], t: int
) -> None:
    views = DerivedTopics(STORE, Config(), prefix="robot03/")
    for dx, dy, dyaw in moved:
        views.of(
            dataclasses.replace(blank(m.BaseFeedback), delta_x_mm=dx, delta_y_mm=dy, delta_yaw_mrad=dyaw), t
        )
    said = dict(views.of(m.PoseEstimated(*pose, 0.25, -0.5, "slam"), t))
    tf, odometry = decoded("/tf", said["/tf"]), decoded("/odom", said["/odom"])
    to_odom, to_base = tf.transforms
    assert (to_odom.header.frame_id, to_odom.child_frame_id) == ("map", "robot03/odom")
    assert (to_base.header.frame_id, to_base.child_frame_id) == ("robot03/odom", "robot03/base_link")
    for header in (to_odom.header, to_base.header, odometry.header):
        assert (header.stamp.sec, header.stamp.nanosec) == divmod(t, 10**9)
    assert _matrix(to_odom.transform) @ _matrix(to_base.transform) == pytest.approx(_planar(*pose), abs=1e-9)
    place = odometry.pose.pose
    assert (place.position.x, place.position.y) == (
        to_base.transform.translation.x,
        to_base.transform.translation.y,
    )
    assert place.orientation == to_base.transform.rotation
    assert (odometry.twist.twist.linear.x, odometry.twist.twist.angular.z) == (0.25, -0.5)


def _planar(x: float, y: float, yaw: float) -> np.ndarray:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])


def _matrix(transform: Any) -> np.ndarray:
    move, turn = transform.translation, transform.rotation
    assert (move.z, turn.x, turn.y) == (0.0, 0.0, 0.0)
    return _planar(move.x, move.y, 2 * math.atan2(turn.z, turn.w))


def test_a_template_names_paths_that_it_would_spoil() -> None:
    fields, bounds = STORE.fields(DERIVED["/scan"]), dict.fromkeys(("range_min", "range_max"), 1.0)
    scan = STORE.standard(DERIVED["/scan"])
    header = STORE.standard("std_msgs/msg/Header")(
        STORE.standard("builtin_interfaces/msg/Time")(0, 0), "lidar"
    )
    three = np.zeros(3, np.float32)
    data = STORE.encode_standard(
        scan(header, 0.0, 1.0, 0.1, 0.0, 0.0, **bounds, ranges=three, intensities=three), DERIVED["/scan"]
    )
    with pytest.raises(ValueError, match=r"header\.stamp\.sec lies before"):
        Template(fields, data, ("header.stamp.nanosec", "header.stamp.sec"))
    template = Template(fields, data, ("header.stamp.sec", "range_max"))
    template.array("ranges")[:] = 7.0
    filled = decoded("/scan", template.fill(5, 9.0))
    assert (filled.header.stamp.sec, filled.range_max, filled.ranges.tolist()) == (5, 9.0, [7.0] * 3)
