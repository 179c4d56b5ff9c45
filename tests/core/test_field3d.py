"""The 3D distance field against numbers by hand, a graph built cell by cell, and the planner's own field."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.costmap import inflate
from hippomat_core.planning.distance_field import distance_field
from hippomat_core.planning.field3d import (
    DIAGONAL,
    SPACE_DIAGONAL,
    STEPS_3D,
    STRAIGHT,
    UNREACHED,
    cell_space,
    distance_field_3d,
    way_down,
)

LENGTHS = {1: STRAIGHT, 2: DIAGONAL, 3: SPACE_DIAGONAL}
grids = arrays(np.bool_, st.tuples(*(st.integers(1, 5) for _ in range(3))), elements=st.booleans())


def spanned(cell, step):
    """Every cell of the box between a cell and the end of a step."""
    return itertools.product(*({at, at + by} for at, by in zip(cell, step, strict=True)))


def is_open(free, cell):
    inside = all(0 <= at < side for at, side in zip(cell, free.shape[::-1], strict=True))
    return inside and bool(free[cell[2], cell[1], cell[0]])


def oracle(free, goal):
    """Dijkstra over edges that are looked at one by one; (Z, Y, X) float64, inf without a way."""
    cells = [tuple(int(at) for at in cell[::-1]) for cell in np.argwhere(free)]
    number = {cell: index for index, cell in enumerate(cells)}
    field = np.full(free.shape, np.inf)
    if goal not in number:
        return field
    edges = [
        (number[cell], number[tuple(np.add(cell, step))], LENGTHS[3 - step.count(0)])
        for cell in cells
        for step in STEPS_3D
        if all(is_open(free, between) for between in spanned(cell, step))
    ]
    tails, heads, weights = zip(*edges, strict=True) if edges else ((), (), ())
    graph = csr_matrix((np.array(weights, float), (tails, heads)), shape=(len(cells), len(cells)))
    for cell, steps in zip(cells, dijkstra(graph, indices=number[goal]), strict=True):
        field[cell[::-1]] = steps
    return field


def test_steps_are_the_26_neighbours_and_lengths_are_their_square_roots():
    assert sorted(STEPS_3D) == sorted(s for s in itertools.product((-1, 0, 1), repeat=3) if any(s))
    assert pytest.approx(np.sqrt(2), rel=1e-7) == DIAGONAL / STRAIGHT
    assert pytest.approx(np.sqrt(3), rel=1e-7) == SPACE_DIAGONAL / STRAIGHT


def test_open_space_costs_the_octile_distance():
    field = distance_field_3d(cell_space(np.ones((4, 5, 6), np.bool_)), (0, 0, 0))
    assert field[0, 0, 0] == 0
    assert field[0, 0, 5] == 5 * STRAIGHT
    assert field[0, 4, 4] == 4 * DIAGONAL
    assert field[3, 3, 3] == 3 * SPACE_DIAGONAL
    assert field[1, 3, 5] == SPACE_DIAGONAL + 2 * DIAGONAL + 2 * STRAIGHT


def test_one_closed_cell_of_the_spanned_box_forbids_the_diagonal():
    free = np.ones((2, 2, 2), np.bool_)
    free[0, 0, 1] = False
    field = distance_field_3d(cell_space(free), (0, 0, 0))
    assert field[1, 1, 1] == STRAIGHT + DIAGONAL  # up or aside first
    assert field[1, 0, 1] == 2 * STRAIGHT
    assert field[0, 1, 1] == 2 * STRAIGHT
    assert field[0, 0, 1] == UNREACHED


@pytest.mark.parametrize("goal", [(2, 0, 0), (0, 0, 0), (-1, 0, 0), (0, 3, 0), (0, 0, 1)])
def test_goal_outside_or_in_an_obstacle_is_reached_from_nowhere(goal):
    free = np.ones((1, 3, 3), np.bool_)
    free[0, 0, [0, 2]] = False
    space = cell_space(free)
    assert (distance_field_3d(space, goal) == UNREACHED).all()
    assert len(way_down(space, distance_field_3d(space, goal), (1, 1, 0))) == 0


@given(free=grids, data=st.data())
@settings(max_examples=150, deadline=None)
def test_field_equals_dijkstra_on_the_graph_of_single_cells(free, data):
    layers, height, width = free.shape
    sides = (width, height, layers)
    goal = data.draw(st.tuples(*(st.integers(0, side - 1) for side in sides)), label="goal")
    found = distance_field_3d(cell_space(free), goal).astype(np.float64)
    found[found == UNREACHED] = np.inf
    np.testing.assert_array_equal(found, oracle(free, goal))


@given(free=grids, data=st.data())
@settings(max_examples=100, deadline=None)
def test_way_down_takes_allowed_steps_that_add_up_to_the_field(free, data):
    cells = [tuple(int(at) for at in cell[::-1]) for cell in np.argwhere(free)]
    if not cells:
        return
    goal, start = data.draw(st.sampled_from(cells)), data.draw(st.sampled_from(cells))
    space = cell_space(free)
    field = distance_field_3d(space, goal)
    way = [tuple(cell) for cell in way_down(space, field, start).tolist()]
    length = int(field[start[::-1]])
    if length == UNREACHED:
        assert way == []
        return
    assert way[0] == start
    assert way[-1] == goal
    steps = [tuple(np.subtract(b, a).tolist()) for a, b in itertools.pairwise(way)]
    assert all(is_open(free, cell) for at, by in zip(way, steps, strict=False) for cell in spanned(at, by))
    assert sum(LENGTHS[3 - step.count(0)] for step in steps) == length


def test_way_there_is_as_long_as_the_way_back_in_a_large_space():
    free = np.random.default_rng(3).random((12, 30, 30)) > 0.35
    space = cell_space(free)
    cells = [tuple(int(at) for at in cell[::-1]) for cell in np.argwhere(free)[::701]]
    fields = [distance_field_3d(space, cell) for cell in cells]
    table = np.array([[field[cell[::-1]] for cell in cells] for field in fields])
    np.testing.assert_array_equal(table, table.T)


def test_one_layer_is_the_planners_ground():
    occupied = np.random.default_rng(5).random((30, 40)) < 0.25
    occupied[0, 0] = False
    grid = OccupancyGrid(np.where(occupied, 100, 0).astype(np.int8), 1.0, 0.0, 0.0)
    costmap = inflate(grid, 0.0)
    expected = distance_field(costmap, (0, 0))
    found = distance_field_3d(cell_space(costmap.free[None]), (0, 0, 0))[0]
    np.testing.assert_array_equal(found == UNREACHED, np.isinf(expected))
    reached = np.isfinite(expected)
    np.testing.assert_allclose(found[reached] / STRAIGHT, expected[reached], rtol=1e-6)


def test_field_of_another_space_is_refused():
    field = distance_field_3d(cell_space(np.ones((1, 3, 3), np.bool_)), (0, 0, 0))
    walled = np.ones((1, 3, 3), np.bool_)
    walled[0, :, 1] = False
    with pytest.raises(ValueError, match="does not belong to this space"):
        way_down(cell_space(walled), field, (2, 2, 0))
