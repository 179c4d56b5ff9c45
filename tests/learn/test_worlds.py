"""Random worlds: what every world of a pool promises, and what is said of settings that cannot be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from world_samples import SMALL

from hippomat_core.errors import ConfigError
from hippomat_core.planning.field3d import UNREACHED, distance_field_3d
from hippomat_sim.learn.settings import UAV, UGV, WorldSettings
from hippomat_sim.learn.worlds import checked, make_world

CROWDED = replace(SMALL, size_m=(20, 16, 8), obstacles=45)


def rows(cells):
    return {tuple(cell) for cell in cells.tolist()}


@pytest.fixture(params=[(SMALL, 0), (SMALL, 2), (CROWDED, 1), (WorldSettings(), 3)], ids=str, scope="module")
def case(request):
    settings, index = request.param
    return settings, make_world(settings, 0, index)


def test_every_free_cell_of_a_class_is_reached_from_its_every_place(case):
    _, world = case
    for vehicle in (UGV, UAV):
        space = world.spaces[vehicle]
        field = distance_field_3d(space, tuple(world.starts[vehicle, 0].tolist()))
        np.testing.assert_array_equal(field != UNREACHED, space.free)


def test_places_are_free_distinct_cells(case):
    settings, world = case
    ground, air = world.spaces
    assert world.sites.shape == (settings.sites, 3)
    assert world.starts.shape == (2, settings.starts, 3)
    assert all(air.is_free(cell) for cell in rows(world.sites))
    assert all(ground.is_free(cell) for cell in rows(world.starts[UGV]))
    assert all(air.is_free(cell) for cell in rows(world.starts[UAV]))
    for starts in world.starts:
        assert len(rows(starts) | rows(world.sites)) == settings.starts + settings.sites


def test_the_last_sites_are_in_the_air_and_the_others_where_ugvs_drive(case):
    settings, world = case
    ground = world.spaces[UGV]
    landed = settings.sites - settings.airborne_sites
    assert all(ground.is_free(cell) for cell in rows(world.sites[:landed]))
    assert (world.sites[landed:, 2] > 0).all()


def test_ugvs_drive_where_uavs_fly_too(case):
    _, world = case
    ground, air = world.spaces
    assert (air.free[0] >= ground.free[0]).all()
    assert not air.free.all()  # there are obstacles


def test_boxes_stand_on_the_ground_with_varied_footprint_and_height():
    heights = np.count_nonzero(~make_world(WorldSettings(), 0, 0).spaces[UAV].free, axis=0)
    free = make_world(WorldSettings(), 0, 0).spaces[UAV].free
    for layer in range(free.shape[0]):
        np.testing.assert_array_equal(free[layer], heights <= layer)
    assert len(np.unique(heights)) > 10
    assert heights[heights > 0].min() >= WorldSettings().obstacle_height_m[0]


def test_same_seed_same_world_and_any_other_key_another():
    def cells(settings, split, index):
        world = make_world(settings, split, index)
        return world.spaces[UAV].free.tobytes() + world.sites.tobytes() + world.starts.tobytes()

    keys = [(SMALL, 0, 0), (SMALL, 0, 1), (SMALL, 1, 0), (replace(SMALL, seed=8), 0, 0)]
    assert cells(*keys[0]) == cells(*keys[0])
    assert len({cells(*key) for key in keys}) == len(keys)


def test_a_world_without_obstacles_or_air_is_a_field():
    world = make_world(replace(SMALL, size_m=(9, 7, 1), obstacles=0, airborne_sites=0), 0, 0)
    assert world.spaces[UGV].free.shape == (1, 7, 9)
    assert world.spaces[UGV].free.all()
    np.testing.assert_array_equal(world.spaces[UAV].free, world.spaces[UGV].free)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"airborne_sites": 9}, "airborne_sites = 9: at most sites = 8"),
        ({"airborne_sites": -1}, "airborne_sites = -1: must be at least 0"),
        ({"size_m": (12, 12, 1)}, r"size_m = \(12, 12, 1\) has no layer above the ground"),
        ({"size_m": (12, 0, 6)}, "three lengths of at least 1 m"),
        ({"size_m": (12, 12)}, "three lengths of at least 1 m"),
        ({"sites": 0, "airborne_sites": 0}, "sites = 0: must be at least 1"),
        ({"starts": 0}, "starts = 0: must be at least 1"),
        ({"worlds": 0}, "worlds = 0: must be at least 1"),
        ({"obstacles": -1}, "obstacles = -1: must be at least 0"),
        ({"ugv_speed_mps": 0.0}, "ugv_speed_mps = 0.0: must be above 0"),
        ({"uav_speed_mps": float("nan")}, "uav_speed_mps = nan: must be above 0"),
        ({"obstacle_side_m": (0, 3)}, r"obstacle_side_m = \(0, 3\): give two lengths"),
        ({"obstacle_height_m": (4, 3)}, r"obstacle_height_m = \(4, 3\): give two lengths"),
    ],
)
def test_settings_that_cannot_be_are_named(changes, said):
    with pytest.raises(ConfigError, match=said) as error:
        checked(replace(SMALL, **changes))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"starts": 200},
        {"sites": 150},
        {"sites": 800, "airborne_sites": 795},
        {"obstacles": 900},  # not one free cell
        {"size_m": (12, 12, 2), "sites": 200, "airborne_sites": 150},
    ],
    ids=str,
)
def test_no_room_is_said_with_what_there_is_and_what_to_do(changes):
    with pytest.raises(
        ConfigError, match=r"world 0 of seed 7 has \d+ connected free cells.* no room for"
    ) as error:
        make_world(replace(SMALL, **changes), 0, 0)
    assert "enlarge size_m" in str(error.value)
    assert "\n" not in str(error.value)
