"""Costmap, distance fields and paths: laws on random maps, and the published optimal lengths."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.astar import path_length_m, shortest_path
from hippomat_core.planning.costmap import inflate, nearest_free, reachable
from hippomat_core.planning.distance_field import distance_at, distance_field
from hippomat_core.planning.feasibility import path_fault
from hippomat_sim.maps.demo_room import draw_demo_room

SEEDS = st.integers(0, 2**32 - 1)


def random_grid(seed: int, side: int = 16, share: float = 0.25) -> OccupancyGrid:
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((side, side + 3)) < share, 100, 0).astype(np.int8)
    cells[rng.random(cells.shape) < 0.05] = -1
    return OccupancyGrid(cells, 0.05, -0.4, 0.3)


@given(SEEDS)
@settings(max_examples=25, deadline=None)
def test_clearance_is_the_distance_to_the_nearest_occupied_square(seed: int) -> None:
    grid = random_grid(seed, 9, 0.1)
    clearance_m = inflate(grid, 0.1).clearance_m
    occupied = np.argwhere(grid.cells == 100)
    for iy, ix in np.ndindex(grid.cells.shape):
        offsets = np.maximum(np.abs(occupied - (iy, ix)) - 0.5, 0.0) * grid.resolution_m
        inside = grid.cells[iy, ix] == 100
        expected = 0.0 if inside else float(np.min(np.hypot(*offsets.T))) if len(occupied) else None
        if expected is not None:
            assert clearance_m[iy, ix] == pytest.approx(expected, abs=1e-6)


def test_inflation_keeps_the_radius_from_walls_and_never_enters_the_unknown() -> None:
    grid = draw_demo_room()
    costmap = inflate(grid, 0.17)
    assert (costmap.clearance_m[costmap.free] >= 0.17).all()
    assert (grid.cells[costmap.free] == 0).all()
    holes = grid.cells.copy()
    holes[40:44, 40:44] = -1
    unknown = OccupancyGrid(holes, grid.resolution_m, grid.origin_x_m, grid.origin_y_m)
    assert not inflate(unknown, 0.17).free[40:44, 40:44].any()
    assert inflate(unknown, 0.17, allow_unknown=True).free[40:44, 40:44].all()


@given(SEEDS, st.floats(0.0, 0.3), st.floats(0.0, 0.1))
@settings(max_examples=60, deadline=None)
def test_a_larger_radius_and_more_obstacles_only_ever_take_free_cells_away(
    seed: int, radius_m: float, more_m: float
) -> None:
    grid = random_grid(seed, 16, 0.08)
    rng = np.random.default_rng(seed)
    cells = grid.cells.copy()
    cells[rng.random(cells.shape) < 0.05] = 100
    fuller = OccupancyGrid(cells, grid.resolution_m, grid.origin_x_m, grid.origin_y_m)
    costmap = inflate(grid, radius_m)
    for other in (inflate(grid, radius_m + more_m), inflate(fuller, radius_m)):
        assert not (other.free & ~costmap.free).any()
        known = (costmap.cost < 255) & (other.cost < 255)
        assert (other.cost >= costmap.cost)[known].all()


def test_costs_are_nav2s() -> None:
    cells = np.zeros((1, 40), np.int8)
    cells[0, 0], cells[0, 39] = 100, -1
    cost = inflate(OccupancyGrid(cells, 0.05, 0.0, 0.0), 0.175, scaling=10.0).cost[0]
    assert (cost[0], cost[39]) == (254, 255)
    assert (cost[1:4] == 253).all()  # nearer than the radius
    assert cost[4] == 252  # clearance 0.175: at the radius
    assert cost[6] == round(252 * math.exp(-10.0 * 0.1))


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_a_path_is_feasible_and_as_long_as_the_field_says(seed: int) -> None:
    costmap = inflate(random_grid(seed), 0.02)
    rng = np.random.default_rng(seed)
    start, goal = ((int(c[0]), int(c[1])) for c in rng.choice(costmap.graph.cells, 2))
    field = distance_field(costmap, goal)
    for guide in (None, field):
        path = shortest_path(costmap, start, goal, field=guide)
        if path is None:
            assert math.isinf(field[start[1], start[0]])
        else:
            assert path_fault(costmap.free, path, start, goal) == ""
            assert path_length_m(path, 0.05) == pytest.approx(field[start[1], start[0]], rel=1e-12)
    assert (reachable(costmap, *costmap.grid.centre_of(*goal)) == np.isfinite(field)).all()


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_a_path_around_blocked_cells_is_shortest_among_those_left(seed: int) -> None:
    grid = random_grid(seed)
    costmap = inflate(grid, 0.02)
    rng = np.random.default_rng(seed)
    start, goal = ((int(c[0]), int(c[1])) for c in rng.choice(costmap.graph.cells, 2))
    blocked = rng.random(costmap.free.shape) < 0.2
    blocked[start[1], start[0]] = blocked[goal[1], goal[0]] = False
    left = np.where(costmap.free & ~blocked, 0, 100).astype(np.int8)
    rest = inflate(OccupancyGrid(left, 0.05, grid.origin_x_m, grid.origin_y_m), 0.02)
    expected = distance_field(rest, goal)[start[1], start[0]]
    path = shortest_path(costmap, start, goal, blocked, distance_field(costmap, goal))
    if path is None:
        assert math.isinf(expected)
    else:
        assert path_fault(costmap.free & ~blocked, path, start, goal) == ""
        assert path_length_m(path, 0.05) == pytest.approx(expected, rel=1e-12)


def test_equal_questions_get_equal_paths_and_a_blocked_goal_none() -> None:
    costmap = inflate(draw_demo_room(), 0.17)
    first, second = (shortest_path(costmap, (10, 20), (80, 90)) for _ in range(2))
    assert first is not None
    assert np.array_equal(first, second)
    blocked = np.zeros(costmap.free.shape, bool)
    blocked[90, 80] = True
    assert shortest_path(costmap, (10, 20), (80, 90), blocked) is None
    assert shortest_path(costmap, (0, 0), (80, 90)) is None


def test_the_checker_names_what_is_wrong_with_a_path() -> None:
    free = np.ones((4, 4), bool)
    free[1, 1] = False
    faults = {
        "not free": [(0, 1), (1, 1)],
        "not neighbours": [(0, 0), (2, 0)],
        "cuts a corner": [(0, 1), (1, 2)],
        "outside the map": [(0, 0), (-1, 0)],
    }
    for fault, cells in faults.items():
        assert fault in path_fault(free, np.array(cells, np.int32), cells[0], cells[-1])
    assert "empty" in path_fault(free, np.zeros((0, 2), np.int32), (0, 0), (0, 0))
    assert "not from" in path_fault(free, np.array([[0, 0]], np.int32), (0, 0), (1, 0))


def test_a_robot_slightly_too_near_a_wall_still_has_a_cell_and_a_cost() -> None:
    costmap = inflate(draw_demo_room(), 0.17)
    x_m, y_m = 2.45, 0.0  # 5 cm from the wall
    cell = nearest_free(costmap, x_m, y_m)
    assert cell is not None
    assert costmap.is_free(cell)
    field = distance_field(costmap, costmap.grid.cell_of(2.0, 0.0))
    assert distance_at(costmap, field, x_m, y_m) == pytest.approx(0.45, abs=0.08)
    assert nearest_free(costmap, 9.0, 9.0) is None
    assert math.isinf(distance_at(costmap, field, 9.0, 9.0))
