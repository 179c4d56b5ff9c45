"""Mapping: the front end, loops that close, and what a correction leaves alone."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from functools import cache
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scan_rooms import HALL, scan, walls_of

from hippomat_core.errors import ConfigError
from hippomat_core.maps.occupancy_grid import FREE, OCCUPIED, UNKNOWN
from hippomat_core.slam.final_pass import FinalSettings, final_pass
from hippomat_core.slam.gtsam_solver import solved_poses
from hippomat_core.slam.loop_closing import close_loops, is_due, solution_of
from hippomat_core.slam.mapper import Mapper, empty_mapper
from hippomat_core.slam.mapper_warm_up import warm_up_mapper
from hippomat_core.slam.pose_graph import NO_LINKS, Links, joined
from hippomat_core.slam.poses import composed, seen_from
from hippomat_core.slam.solution import Solution

RING = [
    ((-6.0, -4.0), (6.0, 4.0)),
    ((-4.0, -2.0), (4.0, 2.0)),
    ((-6.0, 1.0), (-5.6, 1.4)),
    ((1.0, 3.6), (1.9, 4.0)),
]


def round_the_block(laps=1.0, step_m=0.3):
    """(n, 3) true poses along the corridor around the inner block, starting at (0, -3) eastwards."""
    corners = np.array([(0.0, -3.0), (5.0, -3.0), (5.0, 3.0), (-5.0, 3.0), (-5.0, -3.0), (0.0, -3.0)])
    legs = np.diff(corners, axis=0)
    ends_m = np.concatenate([[0.0], np.cumsum(np.hypot(*legs.T))])
    along_m = np.arange(0.0, laps * ends_m[-1], step_m)
    leg = np.searchsorted(ends_m, along_m % ends_m[-1], side="right") - 1
    into = (along_m % ends_m[-1] - ends_m[leg]) / np.hypot(*legs[leg].T)
    xy = corners[leg] + into[:, None] * legs[leg]
    yaw = np.unwrap(np.arctan2(legs[leg, 1], legs[leg, 0]))
    smooth = np.convolve(np.pad(yaw, 4, mode="edge"), np.ones(9) / 9, mode="valid")
    return np.column_stack([xy, smooth])


def drifting(poses, drift_rad=0.01, seed=5):
    """Odometry: the true steps, each turned a little too far, with noise."""
    random = np.random.default_rng(seed)
    steps = seen_from(poses[:-1], poses[1:])
    steps[:, 2] += drift_rad + 0.003 * random.standard_normal(len(steps))
    steps[:, :2] += 0.01 * random.standard_normal((len(steps), 2))
    track = [np.array([2.0, 1.0, 0.5])]  # the odometry's frame is its own
    for step in steps:
        track.append(composed(track[-1], step))
    return np.array(track)


@cache
def mapped(laps=1.3):
    """The mapper after a drive, its outcomes, and the true poses in its frame. No loop was closed."""
    true = round_the_block(laps)
    odometry, walls, mapper, outcomes = drifting(true), walls_of(RING), empty_mapper(), []
    for k, pose in enumerate(true):
        points = scan(walls, pose, beams=180, seed=k, max_range_m=5.0)
        mapper, outcome = mapper.with_scan(points, odometry[k], k * 10**8)
        outcomes.append(outcome)
    return mapper, outcomes, seen_from(true[0], true)


def worst_m(poses, true):
    return np.hypot(*(poses[:, :2] - true[:, :2]).T).max()


def test_the_front_end_takes_most_of_the_odometrys_drift_away():
    mapper, outcomes, true = mapped()
    found = np.array([outcome.pose for outcome in outcomes])
    odometry = drifting(round_the_block(1.3))
    assert all(outcome.matched for outcome in outcomes)
    assert worst_m(seen_from(odometry[0], odometry), true) > 2.0
    assert worst_m(found, true) < 0.5
    assert np.array_equal(mapper.pose, found[-1])


def test_the_same_scans_give_the_same_bits():
    first, second = (mapped.__wrapped__(0.3)[0] for _ in range(2))
    assert first.graph.poses.tobytes() == second.graph.poses.tobytes()
    assert first.graph.steps.information.tobytes() == second.graph.steps.information.tobytes()
    assert first.evidence.log_odds.tobytes() == second.evidence.log_odds.tobytes()


def test_a_mapper_is_a_value():
    """The next scan changes nothing in the mapper that it was given to."""
    mapper, _, _ = mapped()
    before = (mapper.graph.poses.tobytes(), mapper.evidence.log_odds.tobytes(), len(mapper.graph))
    moved, _ = mapper.with_scan(
        scan(walls_of(RING), (0.0, -3.0, 0.0)), np.add(mapper.odometry, [0.5, 0.0, 0.0]), 0
    )
    assert len(moved.graph) == before[2] + 1
    assert (mapper.graph.poses.tobytes(), mapper.evidence.log_odds.tobytes(), len(mapper.graph)) == before


def test_a_robot_that_stands_makes_no_keyframes():
    mapper = empty_mapper()
    for k in range(5):
        points = scan(walls_of(HALL), (0.0, 0.0, 0.0), seed=k)
        mapper, outcome = mapper.with_scan(points, np.zeros(3), k)
        assert outcome.is_keyframe == (k == 0)
    assert len(mapper.graph) == 1


def test_an_outcome_hangs_on_its_keyframe():
    mapper, outcomes, _ = mapped()
    for outcome in outcomes:
        assert np.allclose(
            composed(mapper.graph.poses[outcome.keyframe], outcome.offset), outcome.pose, atol=1e-9
        )


def test_a_scan_of_nowhere_is_not_matched_and_leaves_odometry_to_say_where():
    mapper, _, _ = mapped()
    noise = np.random.default_rng(1).uniform(-30.0, 30.0, (200, 2))
    moved, outcome = mapper.with_scan(noise, composed(mapper.odometry, [0.1, 0.0, 0.2]), 0)
    assert not outcome.matched
    assert np.allclose(moved.pose, composed(mapper.pose, [0.1, 0.0, 0.2]))


def test_a_scan_without_returns_raises_nothing():
    mapper, outcome = empty_mapper().with_scan(np.zeros((0, 2)), np.zeros(3), 0)
    mapper, outcome = mapper.with_scan(np.zeros((0, 2)), np.array([1.0, 0.0, 0.0]), 1)
    assert not outcome.matched
    assert np.allclose(mapper.pose, (1.0, 0.0, 0.0))
    assert (mapper.grid().cells == UNKNOWN).all()


def test_without_odometry_the_scans_say_where():
    walls, mapper = walls_of(HALL), empty_mapper()
    true = np.array([(0.1 * k, 0.05 * k, 0.1 * k) for k in range(8)])
    for pose in true:
        mapper, outcome = mapper.with_scan(scan(walls, pose), None, 0)
        assert outcome.matched
    assert np.allclose(mapper.pose, true[-1], atol=0.03)


def test_the_map_has_the_walls_and_the_free_floor():
    mapper, _, _ = mapped(0.3)
    grid = mapper.grid()

    def cell(x_m, y_m):  # of the room's frame; the map begins at (0, -3)
        ix, iy = grid.cell_of(x_m, y_m + 3.0)
        return grid.cells[iy - 1 : iy + 2, ix - 1 : ix + 2]

    assert cell(0.5, -3.0).max() == FREE
    assert (cell(0.5, -4.0) == OCCUPIED).any()
    assert (cell(0.5, -2.0) == OCCUPIED).any()
    assert (cell(0.5, 0.0) == UNKNOWN).all()  # inside the block


gtsam = pytest.mark.skipif(find_spec("gtsam") is None, reason="gtsam is not installed")


def drifted(mapper: Mapper, turn_rad: float) -> Mapper:
    """The mapper as if each step had been measured with a turn too much."""
    motion = np.add(mapper.graph.steps.motion, [0.0, 0.0, turn_rad])
    poses = [mapper.graph.poses[0]]
    for step in motion:
        poses.append(composed(poses[-1], step))
    steps = replace(mapper.graph.steps, motion=motion)
    return replace(mapper, graph=replace(mapper.graph, steps=steps, poses=np.array(poses)))


@gtsam
def test_closing_a_loop_brings_the_robot_back_to_where_it_began():
    straight, outcomes, true = mapped()
    true = true[[outcome.is_keyframe for outcome in outcomes]]
    mapper = drifted(straight, 0.002)
    assert is_due(mapper.graph)
    closed = mapper.with_solution(close_loops(mapper.graph, mapper.epoch, mapper.settings))
    assert worst_m(mapper.graph.poses, true) > 1.0
    assert len(closed.graph.loops) > 5
    assert not is_due(closed.graph)
    assert worst_m(closed.graph.poses, true) < 0.4
    assert closed.epoch == mapper.epoch + 1


@gtsam
def test_no_loop_is_closed_where_a_match_could_slide():
    """Everything in a bare corridor looks alike: a link there would be a guess."""
    corridor, mapper = walls_of([((-40.0, -1.0), (40.0, 1.0))]), empty_mapper()
    for k, east_m in enumerate([*np.arange(0.0, 12.0, 0.3), *np.arange(12.0, 0.0, -0.3)]):
        points = scan(corridor, (east_m, 0.0, 0.0), beams=180, seed=k, max_range_m=5.0)
        mapper, _ = mapper.with_scan(points, np.array([east_m, 0.0, 0.0]), k)
    solution = close_loops(mapper.graph, mapper.epoch, mapper.settings)
    off_m = solution.poses[:, 0] - mapper.graph.poses[:, 0]
    assert np.abs(off_m).max() < 0.1


@gtsam
def test_the_final_pass_takes_noise_out_of_the_poses():
    angle = np.arange(24) * 0.2
    true = np.column_stack([1.5 * np.cos(angle) - 1.0, np.sin(angle) - 0.5, angle + math.pi / 2])
    mapper = empty_mapper()
    for k, pose in enumerate(true):
        mapper, _ = mapper.with_scan(scan(walls_of(HALL), pose, seed=k), pose, k)
    assert len(mapper.graph) == len(true)
    noise = np.random.default_rng(2).normal(0.0, [0.03, 0.03, 0.01], (len(true), 3))
    noise[0] = 0.0
    rough, done = replace(mapper.graph, poses=composed(mapper.graph.poses, noise)), []
    sharper = final_pass(rough, mapper.settings, FinalSettings(), lambda k, of: done.append((k, of)))
    true = seen_from(true[0], true)
    assert worst_m(rough.poses, true) > 0.05
    assert worst_m(sharper.poses, true) < 0.03
    assert done[-1] == (2 * len(true), 2 * len(true))


def shifted_solution(mapper: Mapper, known: int, shift) -> Solution:
    """A solution of the first `known` keyframes that moves them all by a pose."""
    graph = replace(
        mapper.graph,
        keyframes=mapper.graph.keyframes[:known],
        poses=composed(shift, mapper.graph.poses[:known]),
        searched=known,
    )
    return solution_of(graph, mapper.epoch + 1, mapper.settings)


@given(st.integers(1, 40), st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-3.0, 3.0)))
@settings(max_examples=15)
def test_what_was_seen_since_the_snapshot_keeps_its_place_beside_the_last_keyframe(known, shift):
    mapper, _, _ = mapped(0.3)
    known = min(known, len(mapper.graph))
    moved = mapper.with_solution(shifted_solution(mapper, known, np.array(shift)))
    assert len(moved.graph) == len(mapper.graph)
    expected = composed(np.array(shift), mapper.graph.poses)
    assert np.allclose(seen_from(expected, moved.graph.poses), 0.0, atol=1e-9)
    assert np.allclose(
        seen_from(moved.graph.poses[-1], moved.pose),
        seen_from(mapper.graph.poses[-1], mapper.pose),
        atol=1e-9,
    )


def test_after_a_correction_the_next_scan_is_matched_where_the_robot_now_is():
    true = round_the_block(0.3)
    mapper, _, _ = mapped(0.3)
    shift = np.array([3.0, -2.0, 1.0])
    moved = mapper.with_solution(shifted_solution(mapper, 5, shift))
    points = scan(walls_of(RING), true[-1], seed=99, beams=180, max_range_m=5.0)
    _, outcome = moved.with_scan(points, mapper.odometry, 0)
    assert outcome.matched
    assert outcome.score > 0.8
    assert np.allclose(outcome.pose, composed(shift, mapper.pose), atol=0.03)


def test_the_map_after_a_correction_is_that_of_all_scans():
    """The part that the solution brings and the part that was seen since."""
    mapper, _, _ = mapped(0.3)
    known = len(mapper.graph) - 4
    moved = mapper.with_solution(shifted_solution(mapper, known, np.zeros(3)))
    assert moved.grid() == mapper.grid()


def test_an_outdated_solution_changes_nothing():
    mapper, _, _ = mapped(0.3)
    newer = mapper.with_solution(shifted_solution(mapper, 5, np.zeros(3)))
    assert newer.with_solution(shifted_solution(mapper, 5, np.ones(3))) is newer


@gtsam
def test_a_wrong_loop_link_is_outvoted():
    """A corridor of poses, well-measured loops, and one link that claims something absurd."""
    count = 30
    true = np.column_stack([0.3 * np.arange(count), np.zeros(count), np.zeros(count)])
    information = np.broadcast_to(np.diag([1e4, 1e4, 1e4]), (count - 1, 3, 3))
    numbers = np.arange(count, dtype=np.int32)
    steps = Links(numbers[:-1], numbers[1:], seen_from(true[:-1], true[1:]), information)
    right = Links(numbers[:10], numbers[20:], seen_from(true[:10], true[20:]), information[:10])
    wrong = NO_LINKS.and_link(0, count - 1, np.array([0.5, 3.0, 2.0]), np.diag([1e4, 1e4, 1e4]))
    start = composed(true, np.array([0.05, -0.05, 0.02]))
    start[0] = true[0]
    solved = solved_poses(start, steps, joined([right, wrong]))
    assert worst_m(solved, true) < 0.05


def test_without_gtsam_the_error_names_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "gtsam", None)
    with pytest.raises(ConfigError, match=r"pip install 'hippomat\[slam\]'"):
        solved_poses(np.zeros((1, 3)), NO_LINKS, NO_LINKS)


def test_the_warm_up_maps():
    assert len(warm_up_mapper().graph) == 2
