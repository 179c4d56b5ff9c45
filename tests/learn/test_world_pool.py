"""The pool: travel times against their definition, robots under way, and the copy on disk."""

from __future__ import annotations

import hashlib
import io
import pickle
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console
from world_samples import SMALL

from hippomat_core.allocation.quantise import quantise
from hippomat_core.errors import ConfigError
from hippomat_core.planning.field3d import STRAIGHT, cell_space, distance_field_3d
from hippomat_sim.learn import world_cache
from hippomat_sim.learn.pool_bar import make_pool_shown
from hippomat_sim.learn.recent import Recent
from hippomat_sim.learn.settings import UAV, UGV
from hippomat_sim.learn.travel_times import UNREACHABLE_MS
from hippomat_sim.learn.world_picture import draw_world, obstacle_heights
from hippomat_sim.learn.world_pool import make_pool

V, S = SMALL.starts, SMALL.sites
SPEEDS_MPS = {UGV: SMALL.ugv_speed_mps, UAV: SMALL.uav_speed_mps}


@pytest.fixture(scope="module")
def pool():
    return make_pool(SMALL, cache=False)


def test_shapes_and_types_are_the_promised_ones(pool):
    worlds, (width, height, layers) = SMALL.worlds, SMALL.size_m
    assert (pool.travel_ms.shape, pool.travel_ms.dtype) == ((worlds, 2, V + S, S), np.uint16)
    assert (pool.places_cell.shape, pool.places_cell.dtype) == ((worlds, 2, V + S, 3), np.int16)
    assert pool.free.shape == (worlds, layers, height, width)
    assert pool.ground.shape == (worlds, height, width)
    assert pool.airborne.tolist() == [[False] * 5 + [True] * 3] * worlds
    np.testing.assert_array_equal(pool.places_cell[:, UGV, V:], pool.places_cell[:, UAV, V:])


def test_travel_time_is_the_shortest_way_over_the_speed(pool):
    world = 1
    for vehicle, free in ((UGV, pool.ground[world][None]), (UAV, pool.free[world])):
        for place in range(V + S):
            cell = tuple(pool.places_cell[world, vehicle, place].tolist())
            field = distance_field_3d(cell_space(free), cell)  # from the place; the pool's are from the sites
            for site in range(S):
                ix, iy, iz = pool.places_cell[world, vehicle, V + site]
                found = int(pool.travel_ms[world, vehicle, place, site])
                if vehicle == UGV and (pool.airborne[world, site] or cell[2] > 0):
                    assert found == UNREACHABLE_MS
                else:
                    metres = field[iz, iy, ix] / STRAIGHT
                    assert found == pytest.approx(1000 * metres / SPEEDS_MPS[vehicle], abs=0.501)


def test_only_uavs_reach_the_airborne_sites(pool):
    reached = pool.travel_ms != UNREACHABLE_MS
    assert reached[:, UAV].all()
    np.testing.assert_array_equal(reached[:, UGV, :V].all(axis=1), ~pool.airborne)
    np.testing.assert_array_equal(reached[:, UGV, :V].any(axis=1), ~pool.airborne)


def test_ways_between_sites_are_as_long_back_and_uavs_never_fly_further_than_ugvs_drive(pool):
    between = pool.travel_ms[:, :, V:]
    np.testing.assert_array_equal(between, between.transpose(0, 1, 3, 2))
    assert (np.diagonal(between[:, UAV], axis1=1, axis2=2) == 0).all()
    landed = int((~pool.airborne[0]).sum())
    driven_m = between[:, UGV, :landed, :landed] * SMALL.ugv_speed_mps
    flown_m = between[:, UAV, :landed, :landed] * SMALL.uav_speed_mps
    assert (flown_m <= driven_m + SMALL.uav_speed_mps).all()  # of one millisecond's rounding


def test_codes_are_those_that_a_robot_broadcasts(pool):
    longest_ms = int(pool.travel_ms[pool.travel_ms != UNREACHABLE_MS].max())
    assert pool.c_max_s - 1 < longest_ms / 1000 <= pool.c_max_s
    assert pool.c_max_s == round(pool.c_max_s)
    times = pool.travel_ms[0, UGV]
    costs_s = np.where(times == UNREACHABLE_MS, np.inf, times / 1000.0)
    np.testing.assert_array_equal(pool.code_of_ms[times], quantise(costs_s, pool.c_max_s))
    assert pool.code_of_ms[UNREACHABLE_MS] == 255
    assert (pool.code_of_ms[:UNREACHABLE_MS] < 255).all()


def test_row_from_a_place_is_its_row_of_travel_times(pool):
    for vehicle in (UGV, UAV):
        for place in range(V + S):
            row = pool.row_from(2, vehicle, pool.places_cell[2, vehicle, place])
            assert row.dtype == np.uint16
            np.testing.assert_array_equal(row, pool.travel_ms[2, vehicle, place])


@pytest.mark.parametrize("vehicle", [UGV, UAV])
def test_a_robot_under_way_has_left_what_it_has_not_yet_gone(pool, vehicle):
    half_step_ms = np.sqrt(3) / 2 * 1000 / SPEEDS_MPS[vehicle] + 2  # of rounding
    free = pool.ground[0][None] if vehicle == UGV else pool.free[0]
    for place, site in [(0, 0), (3, 4), (V + 1, 2), (9, 1)]:
        whole_ms = int(pool.travel_ms[0, vehicle, place, site])
        for elapsed_ms in range(0, whole_ms + 1, 37):
            cell = pool.cell_along(0, vehicle, place, site, elapsed_ms)
            assert free[cell[2], cell[1], cell[0]]
            left_ms = int(pool.row_from(0, vehicle, cell)[site])
            assert abs(whole_ms - elapsed_ms - left_ms) <= half_step_ms


def test_a_way_begins_at_the_place_ends_at_the_site_and_can_be_taken_up_again(pool):
    whole_ms = int(pool.travel_ms[0, UAV, 4, 6])
    begin, end = pool.places_cell[0, UAV, 4], pool.places_cell[0, UAV, V + 6]
    np.testing.assert_array_equal(pool.cell_along(0, UAV, 4, 6, 0), begin)
    for late_ms in (0, 1, 10_000):
        np.testing.assert_array_equal(pool.cell_along(0, UAV, 4, 6, whole_ms + late_ms), end)
    middle = pool.cell_along(0, UAV, 4, 6, whole_ms // 2)
    left_ms = int(pool.row_from(0, UAV, middle)[6])
    np.testing.assert_array_equal(pool.cell_on_way(0, UAV, middle, 6, left_ms), end)


def test_a_ugv_has_no_way_to_an_airborne_site(pool):
    with pytest.raises(ValueError, match="no way for class 0"):
        pool.cell_along(0, UGV, 0, S - 1, 100)


def test_pools_are_the_same_on_every_machine(pool):
    contents = pool.travel_ms.astype("<u2").tobytes() + pool.places_cell.astype("<i2").tobytes()
    assert hashlib.sha256(contents).hexdigest()[:16] == "4c7e5ae32a362f6d"


def test_train_and_test_pools_share_no_world(pool):
    other = make_pool(SMALL, "test", cache=False)
    assert other.hash != pool.hash
    worlds = {world.tobytes() for world in pool.free}
    assert not worlds & {world.tobytes() for world in other.free}


def test_a_pool_survives_pickling(pool):
    copy = pickle.loads(pickle.dumps(pool))
    assert copy.hash == pool.hash
    np.testing.assert_array_equal(
        copy.cell_along(0, UAV, 1, 1, 700), make_pool(SMALL, cache=False).cell_along(0, UAV, 1, 1, 700)
    )


def test_unknown_split_and_ways_too_long_for_a_pool_are_refused():
    with pytest.raises(ConfigError, match="split = 'validation': must be one of train, test"):
        make_pool(SMALL, "validation", cache=False)
    with pytest.raises(ConfigError, match=r"a way of \d+ s, a pool holds up to 65 s.* than 0.1 m/s"):
        make_pool(replace(SMALL, ugv_speed_mps=0.1), cache=False)


def counted():
    calls: list[tuple[int, int]] = []
    return calls, lambda done, total: calls.append((done, total))


def test_the_second_time_a_pool_comes_from_the_disk(tmp_path, pool):
    calls, progress = counted()
    first = make_pool(SMALL, progress=progress, cache=tmp_path / "deep" / "er")
    total = SMALL.worlds * 2 * S
    assert calls == [(done, total) for done in range(1, total + 1)]
    second = make_pool(SMALL, progress=progress, cache=tmp_path / "deep" / "er")
    assert len(calls) == total
    assert first.hash == second.hash == pool.hash
    np.testing.assert_array_equal(second.travel_ms, pool.travel_ms)
    np.testing.assert_array_equal(second.code_of_ms, pool.code_of_ms)
    assert len(list((tmp_path / "deep" / "er").iterdir())) == 1  # and nothing half-written


@pytest.mark.parametrize(
    "damage",
    [
        lambda _: b"",
        lambda _: b"not a pool",
        lambda data: data[: len(data) // 2],
        lambda data: data[:-1],
        lambda data: data[:1000] + bytes([data[1000] ^ 1]) + data[1001:],
        lambda data: data + b"\0",
    ],
    ids=["empty", "foreign", "half", "short", "one bit", "long"],
)
def test_a_damaged_file_is_made_again(tmp_path, pool, damage):
    make_pool(SMALL, cache=tmp_path)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    calls, progress = counted()
    assert make_pool(SMALL, progress=progress, cache=tmp_path).hash == pool.hash
    assert calls
    assert file.read_bytes() == whole


def test_every_setting_and_split_has_its_own_file(tmp_path):
    for settings, split in [(SMALL, "train"), (SMALL, "test"), (replace(SMALL, uav_speed_mps=6.0), "train")]:
        make_pool(settings, split, cache=tmp_path)
    assert len(list(tmp_path.iterdir())) == 3


def test_a_disk_that_refuses_costs_a_warning_and_not_the_pool(tmp_path, pool):
    (tmp_path / "file").touch()
    with pytest.warns(UserWarning, match="cannot be kept in"):
        assert make_pool(SMALL, cache=tmp_path / "file" / "worlds").hash == pool.hash


def test_the_users_own_cache_is_the_default(tmp_path, monkeypatch, pool):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if not world_cache.user_directory().is_relative_to(tmp_path):
        pytest.skip("this system has another variable for caches")
    assert make_pool(SMALL).hash == pool.hash
    assert len(list(world_cache.user_directory().iterdir())) == 1


def test_the_bar_is_shown_only_while_a_pool_is_prepared(tmp_path, pool):
    for shown in (True, False):
        text = io.StringIO()
        console = Console(file=text, force_terminal=True, width=80)
        assert make_pool_shown(SMALL, "train", console, cache=tmp_path).hash == pool.hash
        assert ("train worlds" in text.getvalue()) == shown


def test_recent_values_are_kept_and_the_oldest_goes_first():
    made: list[int] = []
    recent: Recent[int, int] = Recent(2)

    def get(key: int) -> int:
        return recent.get(key, lambda: made.append(key) or key * 10)

    assert [get(key) for key in (1, 2, 1, 3, 1, 2)] == [10, 20, 10, 30, 10, 20]
    assert made == [1, 2, 3, 2]
    assert len(recent) == 2


def test_a_picture_of_a_world_is_drawn(tmp_path, pool):
    draw_world(pool, 0, tmp_path / "world.png")
    assert (tmp_path / "world.png").read_bytes().startswith(b"\x89PNG")
    free = np.ones((4, 1, 3), np.bool_)
    free[:3, 0, 1] = False
    assert obstacle_heights(free).tolist() == [[0, 3, 0]]
