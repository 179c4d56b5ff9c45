"""Evidence of free and occupied cells from rays."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hippomat_core.maps.occupancy_grid import FREE, OCCUPIED, UNKNOWN
from hippomat_core.slam.poses import composed, placed, placed_together, seen_from, turned_information
from hippomat_core.slam.ray_cast import HIT, MISS, Lidar, no_evidence, with_scans

NONE = no_evidence(0.1)
pose = st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.floats(-3.1, 3.1)).map(np.array)


def cast(points, at=(0.05, 0.05, 0.0), lidar=None, before=NONE):
    return with_scans(before, [np.array(points, np.float64)], np.array([at]), lidar or Lidar())


def at(evidence, x_m, y_m):
    ix, iy = evidence.grid().cell_of(x_m, y_m)
    return int(evidence.log_odds[iy, ix])


def test_a_ray_frees_what_it_crosses_and_fills_where_it_ends():
    evidence = cast([(1.0, 0.0)])
    assert [at(evidence, 0.05 + 0.1 * k, 0.05) for k in range(12)] == [MISS] * 10 + [HIT, 0]
    grid = evidence.grid()
    assert {int(value) for value in np.unique(grid.cells)} == {UNKNOWN, FREE, OCCUPIED}
    assert np.count_nonzero(grid.cells == OCCUPIED) == 1
    assert np.count_nonzero(grid.cells == FREE) == 10


def within_cells(points):
    """True where no coordinate lies so near a cell's edge that rounding decides."""
    return bool((np.abs(points / 0.1 - np.round(points / 0.1)) > 1e-6).all())


@given(pose, st.lists(st.tuples(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0)), min_size=1, max_size=20))
@settings(max_examples=50)
def test_every_return_is_occupied_and_every_ray_is_unbroken(start, points):
    hits = placed(np.array(points), start)
    assume(within_cells(hits) and within_cells(start[:2]))
    evidence = with_scans(NONE, [np.array(points)], start[None, :], Lidar())
    assert all(at(evidence, x_m, y_m) == HIT for x_m, y_m in hits)
    one = with_scans(NONE, [np.array(points[:1])], start[None, :], Lidar())
    steps = np.abs(np.floor(hits[0] / 0.1) - np.floor(start[:2] / 0.1)).sum()
    assert np.count_nonzero(one.log_odds) == steps + 1


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_the_order_of_the_scans_changes_nothing(seed):
    random = np.random.default_rng(seed)
    scans = [random.uniform(-4.0, 4.0, (20, 2)) for _ in range(4)]
    poses = random.uniform(-2.0, 2.0, (4, 3))
    together = with_scans(NONE, scans, poses, Lidar())
    backwards = with_scans(NONE, scans[::-1], poses[::-1], Lidar())
    one_by_one = NONE
    for points, where in zip(scans, poses, strict=True):
        one_by_one = with_scans(one_by_one, [points], where[None, :], Lidar())
    assert together.grid() == backwards.grid() == one_by_one.grid()
    assert together.log_odds.tobytes() == backwards.log_odds.tobytes()


def test_a_return_in_a_cell_outweighs_rays_of_the_same_scan_that_pass():
    evidence = cast([(1.0, 0.0), (2.0, 0.0), (3.0, 0.0)])
    assert at(evidence, 1.05, 0.05) == HIT


def test_far_returns_only_free_the_way():
    evidence = cast([(5.0, 0.0)], lidar=Lidar(max_range_m=2.0))
    assert at(evidence, 1.95, 0.05) == MISS
    assert at(evidence, 5.05, 0.05) == 0
    assert not (evidence.grid().cells == OCCUPIED).any()


def test_rays_start_at_the_lidar():
    evidence = cast([(1.0, 0.5)], lidar=Lidar(x_m=0.0, y_m=0.5))
    assert at(evidence, 0.55, 0.55) == MISS
    assert at(evidence, 0.05, 0.05) == 0


def test_somebody_who_walked_away_is_forgotten():
    evidence = cast([(1.0, 0.0)])
    for _ in range(3):
        evidence = cast([(2.0, 0.0)], before=evidence)
    ix, iy = evidence.grid().cell_of(1.05, 0.05)
    assert evidence.grid().cells[iy, ix] == FREE


def test_adding_scans_leaves_the_evidence_before_as_it_was():
    before = cast([(1.0, 0.0)])
    kept = before.log_odds.copy()
    cast([(1.0, 0.0)], before=before)
    assert np.array_equal(before.log_odds, kept)


@given(pose, pose)
def test_a_pose_seen_from_another_leads_back_to_it(first, second):
    assert np.allclose(composed(first, seen_from(first, second))[:2], second[:2])


@given(pose, pose)
def test_clouds_are_placed_alike_one_by_one_and_together(first, second):
    clouds = [np.array([[1.0, 2.0], [3.0, -1.0]]), np.array([[0.5, 0.0]])]
    together = placed_together(clouds, np.stack([first, second]))
    assert np.allclose(together, np.concatenate([placed(clouds[0], first), placed(clouds[1], second)]))


@given(st.floats(-3.0, 3.0))
def test_turned_information_tells_the_same_of_the_turned_error(yaw_rad):
    information = np.array([[4.0, 1.0, 0.3], [1.0, 3.0, 0.2], [0.3, 0.2, 2.0]])
    error = np.array([0.3, -0.4, 0.1])
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    seen = np.array([c * error[0] + s * error[1], -s * error[0] + c * error[1], error[2]])
    turned = turned_information(information, yaw_rad)
    assert math.isclose(seen @ turned @ seen, error @ information @ error, rel_tol=1e-9)
