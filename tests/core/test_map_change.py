"""What a new map leaves standing: exactly the fields that are the same and the paths that may be driven."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hippomat_core.planning.astar import plane_path
from hippomat_core.planning.distance_field import field_to
from hippomat_core.planning.feasibility import path_fault
from hippomat_core.planning.field3d import cell_space
from hippomat_core.planning.field_cache import Fields
from hippomat_core.planning.graph import UNREACHED, cell_plane
from hippomat_core.planning.map_change import changed_nodes, path_holds

SEEDS = st.integers(0, 2**32 - 1)


def changed(free, rng, count):
    """`count` cells turned over."""
    other = free.copy()
    places = rng.integers(0, free.size, count)
    other.ravel()[places] ^= True
    return other


@pytest.mark.parametrize(("space_of", "shape"), [(cell_plane, (14, 17)), (cell_space, (4, 6, 7))])
@given(seed=SEEDS, share=st.sampled_from([0.1, 0.3, 0.5]), count=st.integers(0, 4))
@settings(max_examples=150, deadline=None)
def test_a_field_is_kept_exactly_where_it_equals_the_one_computed_anew(space_of, shape, seed, share, count):
    rng = np.random.default_rng(seed)
    free = rng.random(shape) >= share
    old, new = space_of(free), space_of(changed(free, rng, count))
    goals = {(slot, 1): tuple(rng.integers(0, shape[::-1]).tolist()) for slot in range(6)}
    fields = Fields({}).with_goals(old, goals, 1.0)
    kept = fields.with_space(old, new).by_task
    for key, goal in goals.items():
        same = np.array_equal(field_to(new, goal, 1.0).nodes, fields.by_task[key].nodes)
        assert (key in kept) == same


def test_a_change_in_one_room_keeps_the_fields_of_the_other():
    free = np.ones((20, 41), bool)
    free[:, 20] = False
    old = cell_plane(free)
    goals = {(0, 0): (5, 5), (1, 0): (30, 5)}
    fields = Fields({}).with_goals(old, goals, 0.05)
    free = free.copy()
    free[10, 30] = False
    assert list(fields.with_space(old, cell_plane(free)).by_task) == [(0, 0)]


def test_a_freed_cell_that_shortens_nothing_but_itself_is_a_change_too():
    free = np.ones((5, 5), bool)
    free[2, 2] = False
    old, new = cell_plane(free), cell_plane(np.ones((5, 5), bool))
    fields = Fields({}).with_goals(old, {(0, 0): (0, 2)}, 1.0)
    assert fields.by_task[0, 0].units[2, 2] == UNREACHED
    assert not fields.with_space(old, new).by_task


def test_equal_maps_change_nothing_and_another_size_keeps_nothing():
    old, other = cell_plane(np.ones((4, 5), bool)), cell_plane(np.ones((5, 4), bool))
    fields = Fields({}).with_goals(old, {(0, 0): (1, 1)}, 1.0)
    assert not len(changed_nodes(old, cell_plane(np.ones((4, 5), bool))))
    assert fields.with_space(old, old).by_task == fields.by_task
    assert not fields.with_space(old, other).by_task


@given(SEEDS, st.sampled_from([0.1, 0.3]), st.integers(0, 6))
@settings(max_examples=150, deadline=None)
def test_a_path_is_kept_exactly_where_the_checker_finds_no_fault(seed, share, count):
    rng = np.random.default_rng(seed)
    free = rng.random((14, 17)) >= share
    start, goal = (tuple(cell.tolist()) for cell in rng.choice(np.argwhere(free)[:, ::-1], 2))
    path = plane_path(cell_plane(free), start, goal)
    if path is not None:
        now = changed(free, rng, count)
        assert path_holds(cell_plane(now), path) == (path_fault(now, path, start, goal) == "")


def test_the_matrix_is_the_fields_looked_up():
    free = np.random.default_rng(2).random((5, 8, 9)) >= 0.2
    space = cell_space(free)
    goals = {(slot, 3): (slot, slot, slot % 5) for slot in range(7)}
    fields = Fields({}).with_goals(space, goals, 1.0)
    places = [(0, 0, 0), (8, 7, 4), (3, 2, 1)]
    matrix = fields.matrix(list(goals), np.array([space.node_of(place) for place in places]))
    expected = [[fields.by_task[key].units[place[::-1]] for key in goals] for place in places]
    assert matrix.tolist() == expected
