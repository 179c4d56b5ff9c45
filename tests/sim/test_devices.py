"""The virtual base and lidar as state machines, without ports."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hippomat_core.wire import rplidar
from hippomat_core.wire.jetbot_base import Decoder, Feedback, decode_feedback, encode_velocity
from hippomat_sim.devices.virtual_base import OdometryErrors, VirtualBase
from hippomat_sim.devices.virtual_lidar import RangeErrors, VirtualLidar, sample_angles

EXACT = OdometryErrors(0.0, 0.0)


def drive(base: VirtualBase, v: float, wz: float, seconds: float, start_s: float = 0.0) -> list[Feedback]:
    frames: list[Feedback] = []
    decoder = Decoder()
    for tick in range(round(seconds * 100)):
        base.turn_wheels(v, wz, 0.01)
        data = base.feedback(start_s + (tick + 1) / 100 + 1e-9, v, wz)
        frames += [decode_feedback(frame) for frame in decoder.feed(data)]
    return frames


def test_feedback_comes_25_times_a_second_with_the_way_driven() -> None:
    frames = drive(VirtualBase(1, EXACT), 0.2, 0.0, 2.0)
    assert len(frames) == 50
    assert (frames[-1].odom_x_mm, frames[-1].odom_y_mm, frames[-1].odom_yaw_mrad) == (400, 0, 0)
    assert sum(frame.delta_x_mm for frame in frames) == 400
    assert frames[-1].wheels[:2] == (200, 200)


def test_odometry_turns_and_wraps_as_int16_does() -> None:
    base = VirtualBase(1, EXACT)
    assert drive(base, 0.0, 1.0, 4.0)[-1].odom_yaw_mrad == round(1000 * (4.0 - 2 * math.pi))
    drive(base, 0.0, -1.0, 4.0, 4.0)
    frames = drive(base, 10.0, 0.0, 4.0, 8.0)
    assert frames[-1].odom_x_mm == 40_000 - 65_536
    assert max(frame.odom_x_mm for frame in frames) > 32_000


def test_odometry_drifts_by_the_seed_and_not_otherwise() -> None:
    def after_10_m(seed: int) -> int:
        return drive(VirtualBase(seed), 0.5, 0.0, 20.0)[-1].odom_x_mm

    ways = [after_10_m(seed) for seed in range(12)]
    assert ways[0] == after_10_m(0)
    assert len(set(ways)) > 6
    assert max(abs(way - 10_000) for way in ways) < 100  # 5 sigma of 0.2 %


def test_the_last_velocity_is_held_and_noise_is_no_command() -> None:
    base = VirtualBase(1)
    frame = encode_velocity(0.15, -0.5)
    base.receive(frame[:4])
    base.receive(frame[4:] + b"\xaa\x55garbage")
    assert base.command == (0.15, -0.5)
    damaged = bytearray(encode_velocity(0.0, 0.0))
    damaged[-1] ^= 1
    base.receive(bytes(damaged))
    assert base.command == (0.15, -0.5)
    assert base.velocity_frames == 1


def test_the_lidar_answers_info_and_health_and_is_silent_until_it_is_told_to_scan() -> None:
    lidar = VirtualLidar(3)
    answers = lidar.receive(rplidar.request(rplidar.GET_INFO) + rplidar.request(rplidar.GET_HEALTH))
    info = rplidar.find_info(answers)
    assert info == lidar.info
    assert rplidar.find_health(answers) == rplidar.Health(0, 0)
    angles = sample_angles(0, 10)
    assert lidar.samples(angles, np.ones(10)) == b""
    assert lidar.receive(rplidar.request(rplidar.SCAN)) == rplidar.SCAN_DESCRIPTOR
    assert len(lidar.samples(angles, np.ones(10))) == 50
    lidar.receive(rplidar.request(rplidar.STOP))
    assert lidar.samples(angles, np.ones(10)) == b""


def test_sweeps_are_whole_turns_with_one_start_bit_and_the_ranges_put_in() -> None:
    lidar = VirtualLidar(3, RangeErrors(0.0, 0.0))
    lidar.receive(rplidar.request(rplidar.SCAN))
    decoder, sweeps = rplidar.SweepDecoder(), []
    for first in range(0, 2000, 40):
        angles = sample_angles(first, 40)
        ranges = np.where(angles < math.pi, 1.0 + angles, np.inf)
        sweeps += list(decoder.feed(lidar.samples(angles, ranges)))
    assert len(sweeps) == 5  # 5.5 turns a second; the last is not complete
    for sweep in sweeps:
        assert 363 <= len(sweep.angle_q6) <= 364
        assert (np.diff(sweep.angle_q6.astype(int)) > 0).all()
        radians = np.radians(sweep.angle_q6 / 64)
        near = sweep.distance_q2 > 0
        assert (near == (sweep.angle_q6 < 180 * 64)).all()
        assert sweep.distance_q2[near] / 4000 == pytest.approx(1.0 + radians[near], abs=1e-3)
    assert (decoder.skipped_bytes, decoder.bad_checksums) == (0, 0)
