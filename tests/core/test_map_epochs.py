"""A new map under a driving robot: what still holds is kept, the rest is planned anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fleet_world import TICK_NS, FleetWorld, map_event, room

from hippomat_core.config import FleetConfig
from hippomat_core.planning.distance_field import distance_field
from hippomat_core.step import step


@pytest.fixture(scope="module")
def driving():
    """The state of a robot on its way, with fields of eight tasks; never changed by a test."""
    world = FleetWorld(2, seed=3, fleet=FleetConfig(task_slots=8, allocator="hungarian"))
    for _ in range(60 * 20):
        world.tick()
        for body in world.bodies:
            nav = body.state.navigator
            if nav.path is not None and len(nav.path) - nav.cursor > 20:
                return body.state
    raise AssertionError("nobody drove far enough")


def with_map(state, grid):
    return step(state, map_event(grid, state.odometry.stamp_ns + TICK_NS, epoch=2))[0]


def occupied_at(state, cells, side=2):
    """The room with a crate of side x side cells at each of the cells."""
    grid = state.ground.costmap.grid
    changed = grid.cells.copy()
    for ix, iy in cells:
        changed[iy : iy + side, ix : ix + side] = 100
    return replace(grid, cells=changed)


def test_an_equal_map_keeps_every_field_and_the_path_being_driven(driving):
    after = with_map(driving, room())
    assert after.ground.epoch == 2
    assert after.fields.by_task == driving.fields.by_task
    assert len(after.fields.by_task) >= 8
    assert after.navigator is driving.navigator
    assert after.outcome is driving.outcome


def test_a_crate_on_the_path_voids_it_and_the_fields_that_it_changes(driving):
    nav = driving.navigator
    after = with_map(driving, occupied_at(driving, [nav.path[len(nav.path) - 4]]))
    assert after.navigator.path is None
    assert after.outcome is None
    assert after.navigator.destination == nav.destination
    assert len(after.fields.by_task) < len(driving.fields.by_task)


def test_what_a_small_change_elsewhere_leaves_right_is_kept(driving):
    """A box in the corner, where no robot fits anyway, changes no free cell: everything stays."""
    after = with_map(driving, occupied_at(driving, [(1, 1)], side=1))
    assert (after.ground.costmap.grid.cells != driving.ground.costmap.grid.cells).any()
    assert after.fields.by_task == driving.fields.by_task
    assert after.navigator.path is driving.navigator.path


def test_kept_fields_are_those_that_would_be_computed_anew(driving):
    costmap = driving.ground.costmap
    free = np.argwhere(costmap.free)[:, ::-1]
    for cell in free[np.random.default_rng(1).choice(len(free), 6)]:
        after = with_map(driving, occupied_at(driving, [cell]))
        for key, field in driving.fields.by_task.items():
            anew = distance_field(after.ground.costmap, field.goal)
            assert (key in after.fields.by_task) == np.array_equal(anew.nodes, field.nodes)


def test_a_map_on_another_grid_voids_everything(driving):
    moved = replace(room(), origin_x_m=-0.05)
    after = with_map(driving, moved)
    assert not after.fields.by_task
    assert after.navigator.path is None
