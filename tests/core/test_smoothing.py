"""Smoothed paths: as safe as the footprint needs, judged by true distances, and never longer."""

from __future__ import annotations

import itertools
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.astar import path_length_m, shortest_path
from hippomat_core.planning.costmap import inflate
from hippomat_core.planning.feasibility import polyline_fault
from hippomat_core.planning.smoothing import in_sight, smooth
from hippomat_sim.maps.demo_room import draw_demo_room

SEEDS = st.integers(0, 2**32 - 1)


def length_m(points):
    return sum(math.dist(one, other) for one, other in itertools.pairwise(points.tolist()))


@given(SEEDS, st.sampled_from([0.0, 0.04, 0.08, 0.11]), st.sampled_from([0.02, 0.06, 0.15]))
@settings(max_examples=60, deadline=None)
def test_the_whole_swept_disc_stays_clear_and_the_way_gets_no_longer(seed, radius_m, share):
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((30, 34)) < share, 100, 0).astype(np.int8)
    costmap = inflate(OccupancyGrid(cells, 0.05, 0.0, 0.0), radius_m)
    if costmap.free.sum() < 2:
        return
    start, goal = (tuple(cell.tolist()) for cell in rng.choice(costmap.graph.cells, 2))
    path = shortest_path(costmap, start, goal)
    if path is None:
        return
    points = smooth(costmap, path)
    assert polyline_fault(cells == 100, 0.05, points, radius_m) == ""
    assert points[0].tolist() == list(costmap.grid.centre_of(*start))
    assert points[-1].tolist() == list(costmap.grid.centre_of(*goal))
    assert len(points) <= len(path)
    assert length_m(points) <= path_length_m(path, 0.05) + 1e-6


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_sight_is_mutual_and_turns_with_the_map(seed):
    rng = np.random.default_rng(seed)
    free = rng.random((12, 12)) > 0.1
    (ax, ay), (bx, by) = rng.integers(0, 12, (2, 2)).tolist()
    seen = in_sight(free, ax, ay, bx, by)
    assert seen == in_sight(free, bx, by, ax, ay)
    assert seen == in_sight(np.ascontiguousarray(free.T), ay, ax, by, bx)
    assert seen == in_sight(np.ascontiguousarray(free[:, ::-1]), 11 - ax, ay, 11 - bx, by)


def test_open_space_is_one_leg_and_a_wall_makes_corners():
    free = np.zeros((40, 40), np.int8)
    open_ = inflate(OccupancyGrid(free, 0.05, 0.0, 0.0), 0.1)
    assert len(smooth(open_, shortest_path(open_, (0, 0), (39, 17)))) == 2
    walled = free.copy()
    walled[20, :30] = 100
    costmap = inflate(OccupancyGrid(walled, 0.05, 0.0, 0.0), 0.1)
    path = shortest_path(costmap, (2, 2), (2, 38))
    points = smooth(costmap, path)
    assert 3 <= len(points) <= 6
    assert length_m(points) < 0.97 * path_length_m(path, 0.05)


def test_a_real_room_gets_shorter_ways_on_the_whole():
    costmap = inflate(draw_demo_room(), 0.17)
    rng = np.random.default_rng(4)
    before = after = 0.0
    for start, goal in rng.choice(costmap.graph.cells, (40, 2)).tolist():
        path = shortest_path(costmap, tuple(start), tuple(goal))
        if path is not None:
            points = smooth(costmap, path)
            assert polyline_fault(costmap.grid.cells == 100, 0.05, points - origin(costmap), 0.17) == ""
            before, after = before + path_length_m(path, 0.05), after + length_m(points)
    assert 0.90 * before < after < 0.985 * before


def origin(costmap):
    return np.array([costmap.grid.origin_x_m, costmap.grid.origin_y_m])


def test_the_checker_sees_what_lies_between_the_corners_of_a_leg():
    occupied = np.zeros((21, 21), bool)
    occupied[10, 10] = True  # its square is 0.50 .. 0.55 m
    leg = np.array([[0.0, 0.60], [1.0, 0.60]])
    assert polyline_fault(occupied, 0.05, leg, 0.05) == ""
    assert "passes cell (10, 10) at 0.0500 m" in polyline_fault(occupied, 0.05, leg, 0.051)
    through = np.array([[0.0, 0.0], [1.05, 1.05]])
    assert "at 0.0000 m" in polyline_fault(occupied, 0.05, through, 0.01)
