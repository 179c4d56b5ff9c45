"""Dead reckoning from the base's wrapping counters."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hippomat_core.messages import BaseFeedback
from hippomat_core.slam.odometry import Odometry, moved


def feedback(stamp_ns, x_mm, y_mm, yaw_mrad):
    def int16(value):
        return (value + 0x8000) % 0x10000 - 0x8000

    three, four = np.zeros(3, np.int16), np.zeros(4, np.int16)
    return BaseFeedback(
        stamp_ns, three, three, three, int16(x_mm), int16(y_mm), int16(yaw_mrad), 0, 0, 0, four, 0
    )


def driven(start, poses):
    odometry = start
    for k, pose in enumerate(poses):
        odometry = moved(odometry, feedback(k * 40_000_000, *pose))
    return odometry


def test_the_first_frame_only_sets_the_reference():
    odometry = driven(Odometry(1.0, 2.0, 0.5), [(700, -300, 900)])
    assert (odometry.x_m, odometry.y_m, odometry.yaw_rad) == (1.0, 2.0, 0.5)


def test_a_drive_of_one_hundred_metres_passes_the_int16_wrap():
    odometry = driven(Odometry(0.0, 0.0, 0.0), [(mm, 0, 0) for mm in range(0, 100_001, 8)])
    assert math.isclose(odometry.x_m, 100.0, abs_tol=1e-9)


def test_driving_forward_follows_the_start_direction_on_the_map():
    odometry = driven(Odometry(1.0, 1.0, math.pi / 2), [(0, 0, 0), (100, 0, 0), (200, 0, 0)])
    assert math.isclose(odometry.x_m, 1.0, abs_tol=1e-12)
    assert math.isclose(odometry.y_m, 1.2)


def test_a_jump_of_the_counters_moves_nothing_and_is_counted():
    odometry = driven(Odometry(0.0, 0.0, 0.0), [(3000, 0, 0), (3010, 0, 0), (0, 0, 0), (10, 0, 0)])
    assert math.isclose(odometry.x_m, 0.02)
    assert odometry.jumps == 1


def test_a_base_that_restarts_near_where_it_began_does_not_turn_the_pose():
    odometry = driven(Odometry(0.0, 0.0, 0.3), [(100, 50, 2000), (100, 50, 2000), (0, 0, 0), (0, 0, 20)])
    assert odometry.jumps == 1
    assert (odometry.x_m, odometry.y_m) == (0.0, 0.0)
    assert math.isclose(odometry.yaw_rad, 0.32)


def test_a_turn_while_frames_were_missing_is_no_jump():
    odometry = driven(Odometry(0.0, 0.0, 0.0), [(0, 0, 0)])
    odometry = moved(odometry, feedback(1_000_000_000, 0, 0, 1500))
    assert (odometry.jumps, odometry.yaw_rad) == (0, 1.5)


@given(
    st.lists(st.tuples(st.integers(-300, 300), st.integers(-300, 300), st.integers(-500, 500)), max_size=40)
)
def test_a_way_there_and_back_ends_where_it_began(steps):
    way = list(np.cumsum([(0, 0, 0), *steps], axis=0).tolist())
    odometry = driven(Odometry(0.3, -0.2, 0.7), way + way[::-1])
    # The step is laid along the heading at its start, so a retraced curve closes to first order only.
    turned = sum(abs(dyaw) for _, _, dyaw in steps) / 1000
    length_m = sum(math.hypot(dx, dy) for dx, dy, _ in steps) / 1000
    assert math.hypot(odometry.x_m - 0.3, odometry.y_m + 0.2) <= turned * length_m + 1e-9
    assert abs(math.remainder(odometry.yaw_rad - 0.7, math.tau)) < 1e-9
