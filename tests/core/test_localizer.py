"""Localization: what is deskewed is exact, what is found is where the robot is, what is stated is honest."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from fleet_world import room
from hypothesis import given, settings
from hypothesis import strategies as st
from lidar_world import SAMPLES, SWEEP_NS, LidarWorld, flat, ranges

from hippomat_core.config import LidarConfig, SlamConfig
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import AlarmRaised, BaseFeedback, ScanReceived, Tick
from hippomat_core.planning.costmap import inflate
from hippomat_core.slam.localizer import LOCALIZED, LOST, Hunt, Seen, first_localizer, saved_map, with_sweep
from hippomat_core.slam.masking import masked
from hippomat_core.slam.odometry import Odometry, moved
from hippomat_core.slam.pose2 import apart, between, compose, inverse
from hippomat_core.slam.poses import placed
from hippomat_core.slam.relocalize import begun
from hippomat_core.slam.scan_fit import scan_fit
from hippomat_core.slam.steady_clock import SteadyClock
from hippomat_core.slam.sweep import SAMPLE_NS, deskewed
from hippomat_core.slam.tracking import at_start, carried_on
from hippomat_core.slam.warm_up import warm_up

FLAT = flat()
SAVED = saved_map(inflate(FLAT, 0.17), 0.12)
LIDAR = LidarConfig(x_m=0.03, yaw_rad=math.pi)
angles = st.floats(-math.pi, math.pi)
poses = st.tuples(st.floats(-5, 5), st.floats(-5, 5), angles)


def returns(pose, grid=FLAT, beams=180):
    """(n, 2) [m] of a robot that stands, its lidar on its centre."""
    bearing = np.arange(beams) * math.tau / beams
    range_m = ranges(grid, np.tile(pose, (beams, 1)), bearing)
    kept = np.isfinite(range_m)
    return (range_m[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1))[kept]


@given(a=poses, b=poses)
def test_poses_compose_and_invert(a, b):
    assert apart(compose(a, between(a, b)), b) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert apart(compose(a, inverse(a)), (0.0, 0.0, 0.0)) == pytest.approx((0.0, 0.0), abs=1e-9)


# ---- sweeps -------------------------------------------------------------------------------------


def skewed_sweep(place, v_mps, wz_radps, end_ns):
    """A sweep of a point cloud `place` (n, 2) [m, odom frame], point k seen at sample k's own time."""
    sample_ns = SWEEP_NS / SAMPLES
    taken_s = (end_ns - (SAMPLES - 1 - np.arange(SAMPLES)) * sample_ns) / 1e9
    yaw = wz_radps * taken_s
    arc = v_mps / wz_radps
    x, y = arc * np.sin(yaw), arc * (1.0 - np.cos(yaw))
    dx, dy = place[:, 0] - x, place[:, 1] - y
    base_x = np.cos(yaw) * dx + np.sin(yaw) * dy - LIDAR.x_m
    base_y = -np.sin(yaw) * dx + np.cos(yaw) * dy
    range_m, bearing = np.hypot(base_x, base_y), np.arctan2(base_y, base_x)
    clockwise = np.degrees(LIDAR.yaw_rad - bearing) % 360.0
    distance = np.rint(range_m * 4000).astype(np.uint16)
    angle = np.floor(clockwise * 64).astype(np.uint16)
    return ScanReceived(end_ns, np.full(SAMPLES, 15, np.uint8), angle, distance)


@settings(deadline=None, max_examples=40)
@given(v_mps=st.floats(0.05, 0.5), wz_radps=st.floats(0.1, 1.5), seed=st.integers(0, 99))
def test_a_sweep_is_seen_as_from_one_place_however_the_robot_moved(v_mps, wz_radps, seed):
    rng = np.random.default_rng(seed)
    bearing = rng.uniform(0, math.tau, SAMPLES)
    place = rng.uniform(1.0, 3.0, SAMPLES)[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    end_ns = 1_000_000_000
    trail = []
    for stamp_ns in range(end_ns - 400_000_000, end_ns + 1, 20_000_000):
        yaw = wz_radps * stamp_ns / 1e9
        arc = v_mps / wz_radps
        trail.append((stamp_ns, arc * math.sin(yaw), arc * (1.0 - math.cos(yaw)), yaw))
    odometry = Odometry(*trail[-1][1:], stamp_ns=end_ns, clock=SteadyClock(4e7, end_ns), trail=tuple(trail))
    clock = SteadyClock(SWEEP_NS / SAMPLES, end_ns)
    points, pose, at_ns = deskewed(skewed_sweep(place, v_mps, wz_radps, end_ns), clock, odometry, LIDAR)
    assert at_ns == end_ns
    assert pose == pytest.approx(trail[-1][1:])
    # An angle is cut to 1/64 degree, a way between two odometry poses to a straight line.
    assert np.abs(placed(points, pose) - place).max() < 0.004


@given(
    late_ns=st.lists(st.integers(0, 15_000_000), min_size=60, max_size=60),
    sample_ns=st.floats(300_000.0, 600_000.0),
)
def test_the_end_of_a_sweep_is_known_better_than_its_bytes_come(late_ns, sample_ns):
    clock, count = SteadyClock(SAMPLE_NS), 360
    for k, late in enumerate(late_ns):
        clock = clock.after(round((k + 1) * count * sample_ns) + late, count)
    true_ns = len(late_ns) * count * sample_ns
    assert min(late_ns) - 2_000_000 <= clock.end_ns - true_ns <= max(late_ns) + 1
    assert clock.period_ns == pytest.approx(sample_ns, rel=0.05)


def test_a_reader_that_slept_still_knows_when_sweeps_ended():
    clock, period_ns = SteadyClock(SAMPLE_NS), 180_000_000
    for k in range(20):
        clock = clock.after(k * period_ns, 360)
    woken_ns = 20 * period_ns + 300_000_000  # the sweep of then, and the next, are read at once
    clock = clock.after(woken_ns, 360)
    assert abs(clock.end_ns - 20 * period_ns) < 5_000_000
    assert abs(clock.after(woken_ns, 360).end_ns - 21 * period_ns) < 5_000_000


def test_after_a_gap_the_clock_believes_what_it_reads():
    clock, stamp_ns = SteadyClock(SAMPLE_NS), 0
    for k in range(30):
        stamp_ns = k * 180_000_000 + 9_000_000_000 * (k >= 20)
        clock = clock.after(stamp_ns, 360)
    assert abs(clock.end_ns - stamp_ns) < 5_000_000


@given(steps=st.lists(st.tuples(st.integers(-20, 20), st.integers(-60, 60)), min_size=1, max_size=40))
def test_the_trail_ends_where_the_odometry_is(steps):
    odometry, x, yaw = Odometry(1.0, 2.0, 0.5), 0, 0
    zeros, wheels = np.zeros(3, np.int16), np.zeros(4, np.int16)
    for k, (way, turn) in enumerate(steps):
        x, yaw = x + way, yaw + turn
        stamp_ns = (k + 1) * 40_000_000
        odometry = moved(odometry, BaseFeedback(stamp_ns, zeros, zeros, zeros, x, 0, yaw, 0, 0, 0, wheels, 0))
    east, north, turned = odometry.poses_at(np.array([float(odometry.stamp_ns)]))
    assert apart((east[0], north[0], turned[0]), odometry.pose) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert all(odometry.stamp_ns - pose[0] <= 500_000_000 for pose in odometry.trail)


# ---- a scan and a map ---------------------------------------------------------------------------


def test_a_scan_fits_where_it_was_taken_and_not_elsewhere():
    pose = (2.0, 2.6, 0.4)
    points = returns(pose)
    assert scan_fit(SAVED.costmap, points, pose, (0.0, 0.0)).score > 0.97
    for wrong in ((2.8, 2.6, 0.4), (2.0, 2.6, 1.2), (4.8, 1.0, 0.4)):
        assert scan_fit(SAVED.costmap, points, wrong, (0.0, 0.0)).score < SlamConfig().score_min


@given(share=st.floats(0.0, 0.5), seed=st.integers(0, 20))
def test_people_in_half_of_the_view_do_not_make_a_scan_unfit(share, seed):
    pose = (2.0, 2.6, 0.4)
    points = returns(pose)
    blocked = np.random.default_rng(seed).permutation(len(points))[: int(share * len(points))]
    points[blocked] *= 0.5
    assert scan_fit(SAVED.costmap, points, pose, (0.0, 0.0)).score > SlamConfig().score_min


def test_a_handful_of_returns_is_no_evidence():
    pose = (2.0, 2.6, 0.4)
    assert scan_fit(SAVED.costmap, returns(pose)[:10], pose, (0.0, 0.0)).score == 0.0


@settings(deadline=None, max_examples=25)
@given(
    off=st.tuples(st.floats(-0.14, 0.14), st.floats(-0.14, 0.14), st.floats(-0.17, 0.17)),
    pose=st.sampled_from([(2.0, 2.6, 0.4), (4.6, 1.2, -2.0), (1.0, 4.2, 3.0)]),
)
def test_the_localizer_converges_from_a_fifth_of_a_metre_and_ten_degrees(off, pose):
    place = first_localizer(SAVED, LIDAR, SlamConfig(), tuple(np.add(pose, off)), True, 0)
    seen = Seen(returns(pose), (0.0, 0.0, 0.0))
    place = replace(place, odom=seen.odom)
    for k in range(4):
        place = with_sweep(place, seen, k * SWEEP_NS)
        assert np.linalg.eigvalsh(place.estimate.stated).min() > 0.0
    assert place.phase == LOCALIZED
    away_m, turn_rad = apart(compose(place.map_from_odom, seen.odom), pose)
    assert away_m < 0.04
    assert turn_rad < 0.02


@given(steps=st.lists(st.tuples(st.floats(-0.2, 0.2), st.floats(-1.0, 1.0)), max_size=20))
def test_odometry_alone_makes_the_pose_less_sure_and_its_covariance_stays_one(steps):
    estimate, odom = at_start((1.0, 2.0, 0.3), 0.02, 0.01), (0.0, 0.0, 0.0)
    for way_m, turn_rad in steps:
        then = compose(odom, (way_m, 0.0, turn_rad))
        grown = carried_on(estimate, odom, then, SlamConfig())
        assert np.linalg.det(grown.covariance) >= np.linalg.det(estimate.covariance) * (1 - 1e-9)
        assert np.linalg.eigvalsh(grown.covariance).min() > 0.0
        estimate, odom = grown, then


@given(peers=st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), max_size=4), pose=poses)
def test_masking_takes_returns_near_peers_and_no_others(peers, pose):
    rng = np.random.default_rng(7)
    points = rng.uniform(-3, 3, (60, 2))
    at = np.array(peers).reshape(-1, 2)
    left = masked(points, pose, at, 0.12)
    in_map = placed(points, pose)
    near = (np.hypot(*(in_map[:, None] - at[None]).transpose(2, 0, 1)) <= 0.27).any(axis=1)
    assert len(left) == len(points) - near.sum()
    assert {tuple(p) for p in left} == {tuple(p) for p in points[~near]}


# ---- the robot ----------------------------------------------------------------------------------


def wander(world, seed, turns=12):
    """Drive about where there is room."""
    rng = np.random.default_rng(seed)
    costmap = world.state.ground.costmap
    for _ in range(turns):
        v_mps, wz_radps = rng.uniform(0.05, 0.25), rng.uniform(-1.5, 1.5)
        ahead = compose(world.pose, (v_mps * 0.8, 0.0, wz_radps * 0.8))
        free = costmap.is_free(costmap.grid.cell_of(*ahead[:2]))
        world.drive(0.8, v_mps if free else 0.0, wz_radps)
    return world


@pytest.fixture(scope="module")
def wandered():
    """Twenty seconds of a robot whose wheels are off by three per cent, two people in its view."""
    warm_up()
    world = LidarWorld(FLAT, (2.0, 2.5, 1.0), (2.06, 2.46, 1.05), seed=3, wheel_scale=(1.03, 0.97))
    world.things = [(4.6, 2.6, 0.2), (0.9, 0.9, 0.15)]
    return wander(world.drive(1.0), seed=3, turns=24)


def test_a_robot_that_starts_beside_its_mark_finds_its_pose_and_keeps_it(wandered):
    assert wandered.localized
    assert wandered.error_m < 0.05
    errors = [math.dist((one.x_m, one.y_m), true[:2]) for one, true in wandered.found[3:]]
    assert max(errors) < 0.08


def test_the_true_pose_lies_inside_the_stated_ellipse_as_often_as_stated(wandered):
    inside = []
    for one, true in wandered.found:
        if one.phase == LOCALIZED:
            off = np.array([one.x_m - true[0], one.y_m - true[1]])
            covariance = one.covariance.reshape(3, 3)[:2, :2]
            inside.append(float(off @ np.linalg.solve(covariance, off)) < 5.991)
    assert len(inside) > 80
    assert np.mean(inside) > 0.9


def test_equal_events_give_equal_effects_bit_for_bit(wandered):
    again = LidarWorld(FLAT, (2.0, 2.5, 1.0), (2.06, 2.46, 1.05), seed=3, wheel_scale=(1.03, 0.97))
    again.things = wandered.things
    wander(again.drive(1.0), seed=3, turns=24)
    assert [repr(effect) for effect in again.effects] == [repr(effect) for effect in wandered.effects]


def test_nobody_moves_before_the_scan_was_compared_with_the_map():
    world = LidarWorld(FLAT, (2.0, 2.5, 1.0), (2.0, 2.5, 1.0))
    world.drive(0.2)
    assert not world.localized
    assert dict(world.state.faults).keys() >= {"not_localized"}
    world.drive(0.8)
    assert world.localized
    assert "not_localized" not in dict(world.state.faults)


def test_a_robot_that_was_carried_says_so_stops_and_finds_itself_again():
    world = LidarWorld(FLAT, (2.0, 2.5, 1.0), (2.0, 2.5, 1.0)).drive(5.0)
    assert world.localized
    world.carry((4.6, 4.0, -2.0))
    world.drive(2.5)
    assert "not_localized" in dict(world.state.faults)
    text = next(e.text for e in world.effects if getattr(e, "code", "") == "not_localized")
    assert "has not fitted the map" in text
    world.drive(6.0)
    assert world.localized
    assert world.error_m < 0.05


def test_nothing_of_where_a_robot_believed_to_be_outlives_its_being_lost():
    world = LidarWorld(FLAT, (2.0, 2.5, 1.0), (2.0, 2.5, 1.0)).drive(4.0, 0.1)
    assert world.localized
    assert world.state.recovery.trail
    navigator = replace(world.state.navigator, heard=True, marks=((2.0, 2.5, 10**18),))
    world.state = replace(world.state, navigator=navigator)
    world.carry((4.6, 4.0, -2.0))
    world.drive(8.5)
    assert world.localized
    assert all(math.dist(place, world.pose[:2]) < 0.3 for place in world.state.recovery.trail)
    assert not world.state.navigator.heard
    assert not world.state.navigator.marks
    assert world.state.placed_ns > 4 * 10**9


def test_a_robot_that_searches_in_vain_says_so_after_the_first_search_and_not_after_every_one():
    world = LidarWorld(FLAT, (2.0, 2.5, 1.0), (2.0, 2.5, 1.0)).drive(5.0)
    world.carry((4.6, 4.0, -2.0))
    world.drive(2.0)
    assert world.state.place.phase == LOST
    seen = Seen(np.zeros((0, 2)), (0.0, 0.0, 0.0))
    for score in (0.3, 0.4, 0.5):  # of the best place that the search found
        hunt = Hunt(seen, begun(SAVED.pyramid, seen.points), (), ((score, (1.0, 1.0, 0.0)),))
        world.state = replace(world.state, place=replace(world.state.place, hunt=hunt))
        world.feed(Tick(world.now_ns))
    raised = [e.text for e in world.effects if isinstance(e, AlarmRaised) and e.code == "not_localized"]
    assert len(raised) == 2, raised
    assert "looking for the robot" in raised[0]
    assert "best score 0.30" in raised[1]


def test_without_a_start_pose_a_robot_is_found_in_the_whole_map():
    world = LidarWorld(FLAT, (4.6, 1.2, 2.0), None).drive(5.0)
    assert world.localized
    assert world.error_m < 0.05


def test_a_wrong_start_pose_is_noticed_and_put_right():
    world = LidarWorld(FLAT, (4.6, 1.2, 2.0), (1.0, 4.2, 0.0))
    world.drive(1.5)
    assert not world.localized
    world.drive(6.0)
    assert world.localized
    assert world.error_m < 0.05


def half_turned(pose, side_m):
    return side_m - pose[0], side_m - pose[1], pose[2] + math.pi


def test_in_a_room_that_looks_alike_from_two_places_a_robot_does_not_guess():
    square = room(5.0)
    world = LidarWorld(square, (1.2, 1.5, 0.3), None).drive(8.0)
    assert not world.localized
    assert "places alike" in world.state.place.why


def test_there_the_start_pose_decides_which_of_them_it_is():
    square, pose = room(5.0), (1.2, 1.5, 0.3)
    world = LidarWorld(square, pose, (1.25, 1.45, 0.35)).drive(2.0)
    assert world.localized
    assert world.error_m < 0.05


def test_a_robot_on_the_wrong_map_never_believes_a_pose():
    world = LidarWorld(FLAT, (2.0, 2.5, 1.0), (2.0, 2.5, 1.0), told=flat(4.2, 3.4)).drive(10.0)
    assert not any(one.phase == LOCALIZED for one, _ in world.found)
    assert "nowhere" in world.state.place.why


def test_the_guard_sees_the_same_scan_whatever_the_robot_believes_of_its_place():
    here = LidarWorld(FLAT, (2.0, 2.5, 1.0), (2.0, 2.5, 1.0), seed=5).drive(3.0, 0.1, 0.4)
    lost = LidarWorld(FLAT, (2.0, 2.5, 1.0), (2.0, 2.5, 1.0), seed=5, told=flat(4.2, 3.4)).drive(
        3.0, 0.1, 0.4
    )
    assert here.localized
    assert not lost.localized
    assert np.array_equal(here.state.scan.points, lost.state.scan.points)
    assert here.state.scan.pose == lost.state.scan.pose


def test_along_a_bare_corridor_the_pose_is_stated_to_be_unsure():
    cells = np.zeros((60, 1200), np.int8)
    cells[:20] = cells[40:] = 100
    corridor = OccupancyGrid(cells, 0.05, 0.0, 0.0)
    world = LidarWorld(corridor, (30.0, 1.5, 0.0), (30.0, 1.5, 0.0), slam=SlamConfig(lost_radius_m=5.0))
    world.drive(2.0)
    before = world.found[-1][0].covariance.reshape(3, 3)
    world.drive(8.0, 0.25)
    after = world.found[-1][0].covariance.reshape(3, 3)
    assert after[0, 0] > before[0, 0]
    assert after[0, 0] > 4.0 * after[1, 1]
    off_m = abs(world.found[-1][0].x_m - world.found[-1][1][0])
    assert off_m < 3.0 * math.sqrt(after[0, 0])
