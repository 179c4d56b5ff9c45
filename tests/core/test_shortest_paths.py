"""The kernels of the planner against graphs built edge by edge, and against each other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse.csgraph import dijkstra

from hippomat_core.planning import buckets
from hippomat_core.planning.astar import path_length_m, plane_path
from hippomat_core.planning.astar3d import shortest_path_3d
from hippomat_core.planning.distance_field import field_to, plane_field
from hippomat_core.planning.feasibility import path_fault, path_fault_3d
from hippomat_core.planning.field3d import cell_space, distance_field_3d
from hippomat_core.planning.graph import (
    DIAGONAL,
    LONGEST,
    LONGEST_RUN,
    SPACE_DIAGONAL,
    STRAIGHT,
    UNREACHED,
    cell_plane,
)
from hippomat_core.planning.jump_search import jump_search
from hippomat_sim.bench.plan_peers import step_graph

SEEDS = st.integers(0, 2**32 - 1)
SHARES = st.sampled_from([0.0, 0.05, 0.15, 0.3, 0.45])


def random_free(seed, share, side=24):
    rng = np.random.default_rng(seed)
    return rng.random((side, side + 5)) >= share


def two_cells(free, seed):
    cells = np.argwhere(free)[:, ::-1]
    start, goal = np.random.default_rng(seed).choice(cells, 2)
    return tuple(start.tolist()), tuple(goal.tolist())


def oracle(free, goal):
    """(H, W) float64 in units, by Dijkstra on the explicit graph; its edges are rounded to the units."""
    number, graph = step_graph(free)
    graph.data = np.where(graph.data == 1.0, STRAIGHT, DIAGONAL).astype(np.float64)
    field = np.full(free.shape, np.inf)
    field[free] = dijkstra(graph, directed=False, indices=int(number[goal[1], goal[0]]))
    return field


def length_of(path):
    return round(path_length_m(path, 1.0) * STRAIGHT)


@given(SEEDS, SHARES)
@settings(max_examples=80, deadline=None)
def test_the_field_is_dijkstras_on_the_explicit_graph(seed, share):
    free = random_free(seed, share)
    goal, _ = two_cells(free, seed)
    found = field_to(cell_plane(free), goal, 1.0).units.astype(float)
    found[found == UNREACHED] = np.inf
    np.testing.assert_array_equal(found, oracle(free, goal))


@given(SEEDS, SHARES, st.booleans())
@settings(max_examples=80, deadline=None)
def test_every_search_finds_a_feasible_path_of_exactly_the_shortest_length(seed, share, guided):
    free = random_free(seed, share)
    plane = cell_plane(free)
    goal, _ = two_cells(free, seed)
    field, to_go = oracle(free, goal), plane_field(plane, goal) if guided else None
    for ix, iy in np.argwhere(free)[:: 1 + len(np.argwhere(free)) // 40, ::-1].tolist():
        path = plane_path(plane, (ix, iy), goal, None, to_go)
        if path is None:
            assert np.isinf(field[iy, ix])
        else:
            assert path_fault(free, path, (ix, iy), goal) == ""
            assert length_of(path) == field[iy, ix]


@given(SEEDS, SHARES, SHARES)
@settings(max_examples=80, deadline=None)
def test_blocked_cells_are_avoided_at_the_least_length_with_and_without_a_field(seed, share, more):
    free = random_free(seed, share)
    start, goal = two_cells(free, seed)
    blocked = np.random.default_rng(seed + 1).random(free.shape) < more
    blocked[goal[1], goal[0]] = False
    left = free & ~blocked
    left[start[1], start[0]] = True  # a robot may stand on a blocked cell, and passes it
    expected = oracle(left, goal)[start[1], start[0]]
    plane = cell_plane(free)
    for to_go in (None, plane_field(plane, goal)):
        path = plane_path(plane, start, goal, blocked, to_go)
        if path is None:
            assert np.isinf(expected)
        else:
            assert path_fault(left, path, start, goal) == ""
            assert length_of(path) == expected


@given(SEEDS, SHARES)
@settings(max_examples=50, deadline=None)
def test_a_search_leaves_nothing_behind_that_another_could_find(seed, share):
    free = random_free(seed, share)
    plane, start, goal = cell_plane(free), *two_cells(free, seed)
    first = plane_path(plane, start, goal)
    plane_path(plane, *two_cells(free, seed + 1))
    plane_path(plane, goal, start, None, plane_field(plane, start))
    assert not plane.so_far.any()
    again, fresh = plane_path(plane, start, goal), plane_path(cell_plane(free), start, goal)
    assert (first is None) == (again is None) == (fresh is None)
    if first is not None:
        np.testing.assert_array_equal(first, again)
        np.testing.assert_array_equal(first, fresh)


def test_a_search_without_room_says_so_and_leaves_the_scratch_clean():
    plane = cell_plane(random_free(1, 0.3, 40))
    origin, target = plane.node_of((0, 0)), plane.node_of((40, 39))
    entries = np.empty((2, 4), np.int32)
    with pytest.raises(MemoryError, match="more cells wait"):
        jump_search(
            plane.steps_out, plane.offsets, plane.runs, origin, target, plane.so_far, plane.came, entries
        )
    assert not plane.so_far.any()


def test_a_start_or_goal_that_is_not_free_or_outside_has_no_path():
    free = np.ones((3, 4), bool)
    free[1, 1] = False
    plane = cell_plane(free)
    for start, goal in (
        ((1, 1), (0, 0)),
        ((0, 0), (1, 1)),
        ((1, 1), (1, 1)),
        ((0, 0), (4, 0)),
        ((-1, 0), (0, 0)),
    ):
        assert plane_path(plane, start, goal) is None
    assert plane_path(plane, (2, 2), (2, 2)).tolist() == [[2, 2]]


def test_a_run_longer_than_16_bits_and_a_way_longer_than_32_bits_are_handled():
    corridor = cell_plane(np.ones((1, LONGEST_RUN + 1000), bool))
    assert len(plane_path(corridor, (0, 0), (LONGEST_RUN + 900, 0))) == LONGEST_RUN + 901
    # A boustrophedon of 150,000 cells: too long for 32 bits, so there is no way, and no wrong one either.
    snake = np.zeros((199, 1500), bool)
    snake[::2] = True
    snake[1::4, -1] = snake[3::4, 0] = True
    plane = cell_plane(snake)
    field = field_to(plane, (0, 0), 1.0).units
    assert field[198, 700] == UNREACHED
    assert field[field != UNREACHED].max() <= LONGEST
    assert plane_path(plane, (0, 0), (700, 198)) is None
    assert length_of(plane_path(plane, (0, 0), (700, 100))) == field[100, 700]


@given(
    arrays(np.bool_, st.tuples(*(st.integers(1, 6) for _ in range(3))), elements=st.integers(0, 3).map(bool)),
    SEEDS,
)
@settings(max_examples=60, deadline=None)
def test_a_path_in_the_air_is_feasible_and_as_long_as_the_field_says(free, seed):
    cells = [tuple(cell) for cell in np.argwhere(free)[:, ::-1].tolist()]
    if not cells:
        return
    rng = np.random.default_rng(seed)
    start, goal = cells[rng.integers(len(cells))], cells[rng.integers(len(cells))]
    space = cell_space(free)
    path = shortest_path_3d(space, start, goal)
    left = distance_field_3d(space, goal)[start[::-1]]
    if len(path) == 0:
        assert left == UNREACHED
        return
    assert path_fault_3d(free, path, start, goal) == ""
    lengths = np.array([0, STRAIGHT, DIAGONAL, SPACE_DIAGONAL])
    assert lengths[np.abs(np.diff(path, axis=0)).sum(axis=1)].sum() == left


def test_buckets_are_no_wider_than_the_least_growth_of_a_total():
    """What the octile distance leaves of a step's length, for every step at every place, is 0 or that."""
    places = np.stack(np.meshgrid(np.arange(-9, 10), np.arange(-9, 10)), axis=-1).reshape(-1, 2)

    def octile(d):
        d = np.abs(d)
        return STRAIGHT * d.max(axis=1) + (DIAGONAL - STRAIGHT) * d.min(axis=1)

    growths = set()
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1), (-1, 0), (0, -1), (-1, -1), (-1, 1)):
        length = DIAGONAL if dx and dy else STRAIGHT
        growths |= set((length + octile(np.add(places, (dx, dy))) - octile(places)).tolist())
    assert min(growths) == 0
    assert min(growths - {0}) == buckets.BUCKET
