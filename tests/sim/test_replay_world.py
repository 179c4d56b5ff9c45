"""The world that replay level L3 drives recorded commands in."""

from __future__ import annotations

import math
from collections.abc import Iterator
from importlib.metadata import entry_points

import pytest
from sim_rooms import box_room

from hippomat_core.config import Config
from hippomat_core.messages import MapReceived
from hippomat_sim.replay_world import PyBulletReplayWorld


@pytest.fixture
def world() -> Iterator[PyBulletReplayWorld]:
    grid = box_room()
    received = MapReceived(
        0, 1, grid.width, grid.height, grid.resolution_m, -0.05, -0.05, grid.cells.ravel().copy()
    )
    world = PyBulletReplayWorld(Config(), received)
    yield world
    world.close()


def test_it_is_offered_to_replay_by_name() -> None:
    (entry,) = entry_points(group="hippomat.replay_worlds", name="pybullet")
    assert entry.load() is PyBulletReplayWorld


def test_commands_hold_until_the_next_and_the_last_one_not_after_zero_is_the_motion_at_zero(
    world: PyBulletReplayWorld,
) -> None:
    poses = world.drive((1.0, 1.0, 0.0), [(-0.3, 0.2, 0.0), (2.0, 0.0, 0.0)], [0.0, 1.0, 2.0, 4.0])
    assert poses[0] == (1.0, 1.0, 0.0)
    assert [x for x, _, _ in poses] == pytest.approx([1.0, 1.2, 1.4, 1.41], abs=2e-3)


def test_every_window_starts_where_it_is_told_and_walls_still_stand(world: PyBulletReplayWorld) -> None:
    into_the_wall = world.drive((3.0, 1.5, 0.0), [(0.0, 0.5, 0.0)], [5.0])
    assert into_the_wall[0][0] == pytest.approx(4.0 - 0.12, abs=1e-3)
    again = world.drive((1.0, 1.5, math.pi / 2), [(0.0, 0.2, 0.0)], [0.0, 1.0])
    assert again[0] == pytest.approx((1.0, 1.5, math.pi / 2))
    assert again[1] == pytest.approx((1.0, 1.7, math.pi / 2), abs=5e-3)


def test_equal_windows_give_equal_poses(world: PyBulletReplayWorld) -> None:
    def window() -> list[tuple[float, float, float]]:
        return world.drive((1.0, 1.0, 0.3), [(0.0, 0.2, 1.0), (1.0, 0.3, -1.0)], [0.5, 1.0, 3.0])

    assert window() == window()
