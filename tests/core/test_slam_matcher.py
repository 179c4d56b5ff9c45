"""Scan matching: laws on made-up rooms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scan_rooms import CORRIDOR, HALL, in_map, scan, walls_of

from hippomat_core.errors import MapError
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.slam.likelihood_field import field_of_grid, field_of_points
from hippomat_core.slam.matcher import Search, Trust, match

WALLS = walls_of(HALL)
SEEN_FROM = [(0.0, 0.0, 0.0), (-1.0, 0.5, 0.4), (2.2, -0.8, -1.0), (1.5, 2.0, 2.0)]
FIELD = field_of_points(
    np.concatenate([in_map(scan(WALLS, pose, seed=k), pose) for k, pose in enumerate(SEEN_FROM)])
)
offset = st.tuples(st.floats(-0.25, 0.25), st.floats(-0.25, 0.25), st.floats(-0.2, 0.2))
place = st.tuples(st.floats(-1.5, 0.5), st.floats(-1.0, 1.0), st.floats(-3.0, 3.0))


def error_of(found, true):
    return np.hypot(found[0] - true[0], found[1] - true[1]), abs(math.remainder(found[2] - true[2], math.tau))


@given(place, offset, st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_a_match_recovers_the_pose_from_a_wrong_guess(true, wrong, seed):
    found = match(FIELD, scan(WALLS, true, seed=seed), np.add(true, wrong))
    apart_m, turned_rad = error_of(found.pose, true)
    assert apart_m < 0.02
    assert turned_rad < math.radians(0.6)
    assert found.score > 0.75
    assert found.inside > 0.99


@given(place, st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_the_score_falls_with_displacement(true, seed):
    points = scan(WALLS, true, seed=seed)
    fixed = Search(xy_m=0.0, yaw_rad=0.0)
    scores = [
        match(FIELD, points, (true[0] + shift, true[1], true[2]), fixed).score for shift in (0.0, 0.6, 1.5)
    ]
    assert scores[0] > scores[1] + 0.1 > scores[2]


@given(place, offset, st.floats(-20.0, 20.0))
@settings(max_examples=20)
def test_where_the_map_lies_does_not_matter(true, wrong, east):
    """The same room in a map frame that is moved by whole cells gives the same pose, moved alike."""
    points = scan(WALLS, true)
    moved = (round(east / 0.05) * 0.05, 1.0)
    cloud = np.concatenate([in_map(scan(WALLS, p, seed=k), p) for k, p in enumerate(SEEN_FROM)])
    guess = np.add(true, wrong)
    here = match(FIELD, points, guess)
    there = match(field_of_points(cloud + moved), points, np.add(guess, [*moved, 0.0]))
    assert np.allclose(there.pose[:2] - moved, here.pose[:2], atol=5e-3)
    assert error_of(there.pose, here.pose)[1] < 2e-3


def corridor_cloud():
    """Seen from many places: the few far returns of a single sweep would look like features."""
    places = [(east, 0.1 * math.sin(9.0 * east), 0.02 * east) for east in np.linspace(-1.0, 1.0, 21)]
    corridor = walls_of(CORRIDOR)
    return np.concatenate([in_map(scan(corridor, p, seed=k), p) for k, p in enumerate(places)])


def test_information_is_strong_in_a_room():
    pose = (0.0, 0.0, 0.3)
    assert np.linalg.eigvalsh(match(FIELD, scan(WALLS, pose), pose).information).min() > 1e3


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3, 0.8, 1.3])
def test_information_is_weak_along_a_corridor_and_only_there(yaw_rad):
    """The weak direction is the corridor's, whatever the axes of the field are."""
    turned = (0.0, 0.0, yaw_rad)
    field = field_of_points(in_map(corridor_cloud(), turned))
    points = scan(walls_of(CORRIDOR), (0.0, 0.0, 0.0), seed=50, max_range_m=6.0)
    information = match(field, points, turned).information
    along, across = (math.cos(yaw_rad), math.sin(yaw_rad)), (-math.sin(yaw_rad), math.cos(yaw_rad))
    assert np.linalg.eigvalsh(information).min() > 0.0
    assert np.dot(across, information[:2, :2] @ across) > 5e3
    assert np.dot(along, information[:2, :2] @ along) < 0.05 * np.dot(across, information[:2, :2] @ across)


@given(place, st.integers(0, 1000))
@settings(max_examples=20)
def test_information_is_honest(true, seed):
    """Errors measured in the stated standard deviations: none is beyond five of them in a rich room."""
    found = match(FIELD, scan(WALLS, true, seed=seed), true)
    error = found.pose - np.asarray(true)
    error[2] = math.remainder(error[2], math.tau)
    assert error @ found.information @ error < 25.0


def test_equal_arguments_give_equal_bits():
    points = scan(WALLS, (0.3, 0.2, 0.1))
    first, second = (match(FIELD, points, (0.2, 0.1, 0.0)) for _ in range(2))
    assert first.pose.tobytes() == second.pose.tobytes()
    assert first.information.tobytes() == second.information.tobytes()


def test_the_search_finds_the_best_grid_pose():
    """Branch and bound gives what looking at every pose gives."""
    points = scan(WALLS, (0.3, -0.2, 0.1), beams=60)
    step = math.radians(2.0)
    found = match(FIELD, points, (0.1, 0.0, 0.0), Search(xy_m=0.35, yaw_rad=5 * step, yaw_step_rad=step))
    fixed = Search(xy_m=0.0, yaw_rad=0.0)
    best = max(
        match(FIELD, points, (0.1 + 0.05 * i, 0.05 * j, k * step), fixed).score
        for i in range(-7, 8)
        for j in range(-7, 8)
        for k in range(-5, 6)
    )
    assert found.score >= best - 1e-3


def test_of_equal_poses_the_guess_is_kept():
    """Along a bare corridor nothing tells where; the match stays where the odometry said."""
    wall = np.stack([np.arange(-400, 401) * 0.05 + 0.025, np.full(801, 1.025)], axis=1)
    field = field_of_points(np.concatenate([wall, wall - [0.0, 2.0]]))
    points = np.stack([np.arange(-40, 41) * 0.05, np.full(81, 1.0)], axis=1)
    found = match(field, np.concatenate([points, points - [0.0, 2.0]]), (0.025, 0.125, 0.0))
    assert abs(found.pose[0] - 0.025) < 1e-6
    assert abs(found.pose[1] - 0.025) < 1e-3


@given(place, offset, st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_a_guess_is_left_as_far_as_it_is_not_trusted(true, wrong, seed):
    points, guess = scan(WALLS, true, seed=seed), np.add(true, wrong)
    alone = match(FIELD, points, guess)
    doubted = match(FIELD, points, guess, trust=Trust(100.0, 100.0))
    believed = match(FIELD, points, guess, trust=Trust(1e-4, 1e-4))
    for found, expected in ((doubted.pose, alone.pose), (believed.pose, guess)):
        off = found - expected
        assert np.allclose(off[:2], 0.0, atol=2e-3)
        assert abs(math.remainder(off[2], math.tau)) < 2e-3  # -3.1 and 3.18 rad are one yaw


@given(place, st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_the_search_finds_the_best_pose_of_a_trusted_guess_too(true, seed):
    """Fit less the pull to the guess, in units of a log likelihood, against looking at every pose."""
    points, trust = scan(WALLS, true, beams=60, seed=seed), Trust(0.05, 0.1)
    guess, fixed = np.add(true, [0.2, -0.15, 0.0]), Search(xy_m=0.0, yaw_rad=0.0)
    worth = len(points) * (FIELD.sigma_m / 0.03) ** 2 / 10.0

    def gain(pose, score):
        return score * worth - 0.5 * (((pose - guess) ** 2) * trust.information).sum()

    found = match(FIELD, points, guess, Search(xy_m=0.3, yaw_rad=0.0), trust)
    others = [np.add(guess, [0.05 * i, 0.05 * j, 0.0]) for i in range(-6, 7) for j in range(-6, 7)]
    best = max(
        gain(m.pose, m.score)
        for m in (match(FIELD, points, pose, fixed, Trust(1e-4, 1e-4)) for pose in others)
    )
    assert gain(found.pose, found.score) >= best - 0.05 * worth / 10.0


def test_without_points_the_guess_comes_back_unmatched():
    found = match(FIELD, np.zeros((0, 2)), (0.5, 0.25, 0.1))
    assert (found.score, found.inside) == (0.0, 0.0)
    assert np.allclose(found.pose, (0.5, 0.25, 0.1))
    assert np.linalg.eigvalsh(found.information).min() > 0.0


def test_points_off_the_field_score_nothing_and_raise_nothing():
    found = match(FIELD, scan(WALLS, (0.0, 0.0, 0.0)), (500.0, -300.0, 0.0))
    assert (found.score, found.inside) == (0.0, 0.0)


def test_the_field_of_a_map_is_that_of_its_occupied_cells():
    cells = np.full((60, 80), -1, np.int8)
    cells[10:50, 5] = 100
    cells[10, 5:70] = 70
    cells[20:30, 20:30] = 0
    cells[40, 40] = 64  # below map_server's threshold
    grid = OccupancyGrid(cells, 0.05, -1.0, 2.0)
    field = field_of_grid(grid)
    assert field.values.shape == cells.shape
    assert (field.values[10:50, 5] == 1.0).all()
    assert field.values[40, 40] == 0.0
    assert np.allclose(field.values[30, 7], math.exp(-0.5 * (2 * 0.05 / field.sigma_m) ** 2), atol=1e-6)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_the_field_is_the_distance_to_the_nearest_point(seed):
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (12, 2))
    field = field_of_points(points, 0.05, 0.1, bounds=(-1.0, -1.0, 1.0, 1.0))
    assert field.values.shape == (40, 40)
    iy, ix = np.mgrid[0:40, 0:40]
    centres = np.stack([field.origin_x_m + (ix + 0.5) * 0.05, field.origin_y_m + (iy + 0.5) * 0.05], axis=-1)
    nearest = np.linalg.norm(centres[:, :, None] - points, axis=-1).min(axis=-1)
    expected = np.where(nearest < 0.3, np.exp(-0.5 * (nearest / 0.1) ** 2), 0.0)
    assert np.abs(field.values - expected).max() < 0.012  # what is cut off at three sigmas


def test_a_field_beyond_memory_is_refused_with_the_remedy():
    with pytest.raises(MapError, match=r"too large .* limit the range"):
        field_of_points(np.array([[0.0, 0.0], [1e6, 1e6]]))
