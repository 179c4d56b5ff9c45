"""Laws of the physical world: distances, walls, contacts, rays, and equal runs from equal commands."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from recorded_data import data_folder
from sim_rooms import box_room

from hippomat_core.config import LidarConfig
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_logs.map_files import load_map
from hippomat_sim.lidar_rays import measure, poses_between
from hippomat_sim.walls import wall_boxes
from hippomat_sim.world import WALL, Body, World

Room = Callable[..., OccupancyGrid]
# At 1 m/s a substep is 5 mm; three robots jammed at that speed overlap by some 2 mm for a moment.
SQUEEZE_M = 4e-3
INSTANT = Body(accel_mps2=1000.0, turn_accel_radps2=1000.0)


@given(hnp.arrays(np.bool_, hnp.array_shapes(min_dims=2, max_dims=2, max_side=12)))
def test_wall_boxes_cover_the_occupied_cells_and_nothing_else(occupied: np.ndarray) -> None:
    grid = OccupancyGrid(np.where(occupied, 100, 0).astype(np.int8), 0.5, -1.0, 2.0)
    covered = np.zeros(occupied.shape, int)
    for x0, y0, x1, y1 in wall_boxes(grid):
        ix0, ix1 = round((x0 + 1.0) / 0.5), round((x1 + 1.0) / 0.5)
        iy0, iy1 = round((y0 - 2.0) / 0.5), round((y1 - 2.0) / 0.5)
        covered[iy0:iy1, ix0:ix1] += 1
    assert (covered == occupied).all()


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_a_straight_drive_goes_speed_times_time(make_room: Room, yaw: float) -> None:
    with World(make_room(8, 8), [(4.0, 4.0, yaw)], INSTANT) as world:
        world.command(0, 0.3, 0.0)
        for _ in range(500):
            world.step()
        travelled = world.poses[0, :2] - 4.0
        assert travelled == pytest.approx([1.5 * math.cos(yaw), 1.5 * math.sin(yaw)], abs=1e-4)
        assert world.contacts == []


def test_a_circle_closes_and_the_last_velocity_is_held_for_ever(make_room: Room) -> None:
    with World(make_room(8, 8), [(4.0, 4.0, 0.0)], INSTANT) as world:
        world.command(0, 0.5, 0.5 * math.pi)
        for _ in range(400):  # one turn in 4 s, without any further command
            world.step()
        assert world.poses[0] == pytest.approx([4.0, 4.0, 0.0], abs=2e-3)


def test_wheels_speed_up_within_their_acceleration(make_room: Room) -> None:
    with World(make_room(8, 8), [(4.0, 4.0, 0.0)], Body(accel_mps2=2.0, turn_accel_radps2=10.0)) as world:
        world.command(0, 0.5, -3.0)
        world.step()
        assert world.wheels[0] == pytest.approx([0.02, -0.1])
        for _ in range(100):
            world.step()
        assert world.wheels[0] == pytest.approx([0.5, -3.0])


@given(
    st.floats(-math.pi, math.pi),
    st.floats(0.2, 1.0),
    st.floats(-2.0, 2.0),
    st.integers(0, 1000),
)
@example(yaw=2.0, v=0.90625, wz=-1.0, seed=56)  # three robots jammed in a corner
@settings(max_examples=15, deadline=None)
def test_no_robot_penetrates_a_wall_or_another_robot(yaw: float, v: float, wz: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    with World(box_room(2.0, 1.5), [(0.5, 0.7, yaw), (1.2, 0.5, 0.0), (1.5, 1.1, 2.0)], Body()) as world:
        world.command(0, v, wz)
        for robot in (1, 2):
            world.command(robot, *rng.uniform([-0.5, -2], [0.5, 2]))
        for _ in range(500):
            world.step()
            x, y = world.poses[:, 0], world.poses[:, 1]
            gaps = [x.min(), y.min(), 2.0 - x.max(), 1.5 - y.max()]
            assert min(gaps) > 0.12 - SQUEEZE_M
            for a, b in ((0, 1), (0, 2), (1, 2)):
                assert math.hypot(x[a] - x[b], y[a] - y[b]) > 0.24 - SQUEEZE_M


def test_leaning_on_a_wall_is_one_contact_and_coming_back_is_another(room: OccupancyGrid) -> None:
    with World(room, [(3.7, 1.0, 0.0)], Body()) as world:
        for v, steps in ((0.3, 200), (-0.3, 200), (0.3, 300)):
            world.command(0, v, 0.0)
            for _ in range(steps):
                world.step()
        assert [(contact.robot, contact.other) for contact in world.contacts] == [(0, WALL), (0, WALL)]
        assert world.contacts[0].start_s == pytest.approx(0.18 / 0.3, abs=0.2)


def test_a_contact_names_both_robots_once(make_room: Room) -> None:
    with World(make_room(4, 4), [(1.0, 2.0, 0.0), (2.0, 2.0, math.pi)], Body()) as world:
        world.command(0, 0.2, 0.0)
        world.command(1, 0.2, 0.0)
        for _ in range(300):
            world.step()
        assert [(contact.robot, contact.other) for contact in world.contacts] == [(0, 1)]


def test_equal_commands_give_equal_trajectories_through_collisions() -> None:
    def run() -> np.ndarray:
        rng = np.random.default_rng(5)
        with World(box_room(2.0, 1.5), [(0.3, 0.7, 0.0), (1.0, 0.7, 1.0), (1.6, 0.7, 2.0)], Body()) as world:
            track = []
            for _ in range(300):
                for robot in range(3):
                    if rng.random() < 0.05:
                        world.command(robot, *rng.uniform([-0.5, -2], [0.5, 2]))
                world.step()
                track.append(world.poses.copy())
            assert world.contacts
            return np.array(track)

    assert np.array_equal(run(), run())


@given(st.floats(0.3, 3.7), st.floats(0.3, 2.7), st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi))
@settings(max_examples=20, deadline=None)
def test_the_lidar_measures_the_distance_to_the_wall(x: float, y: float, yaw: float, mounted: float) -> None:
    lidar = LidarConfig(yaw_rad=mounted, min_range_m=0.0)
    clockwise = np.linspace(0, 2 * math.pi, 37)
    with World(box_room(), [(x, y, yaw)], Body()) as world:
        ranges = measure(world, np.repeat(world.poses[None], 37, axis=0), clockwise, lidar)[:, 0]
    for angle, measured in zip(yaw + mounted - clockwise, ranges, strict=True):
        dx, dy = math.cos(angle), math.sin(angle)
        to_x = ((4.0 if dx > 0 else 0.0) - x) / dx if dx else math.inf
        to_y = ((3.0 if dy > 0 else 0.0) - y) / dy if dy else math.inf
        assert measured == pytest.approx(min(to_x, to_y), abs=1e-3)


def test_a_lidar_that_faces_backwards_has_the_wall_ahead_at_180_degrees(room: OccupancyGrid) -> None:
    with World(room, [(1.0, 1.5, 0.0)], Body()) as world:
        poses = np.repeat(world.poses[None], 4, axis=0)
        quarter_turns = np.array([0.0, 0.5, 1.0, 1.5]) * math.pi
        backwards = measure(world, poses, quarter_turns, LidarConfig(yaw_rad=math.pi, x_m=0.05))[:, 0]
        forwards = measure(world, poses, quarter_turns, LidarConfig(yaw_rad=0.0, x_m=0.05))[:, 0]
    assert backwards == pytest.approx([1.05, 1.5, 2.95, 1.5], abs=1e-6)
    assert forwards == pytest.approx([2.95, 1.5, 1.05, 1.5], abs=1e-6)


def test_clockwise_angles_find_a_robot_on_the_right_at_90_degrees(make_room: Room) -> None:
    with World(make_room(4, 4), [(2.0, 2.0, 0.0), (2.0, 1.0, 0.0)], Body()) as world:
        poses = world.poses[None, :1]
        right = measure(world, poses, np.array([math.pi / 2]), LidarConfig(yaw_rad=0.0))
    assert right[0, 0] == pytest.approx(1.0 - 0.12, abs=1e-3)


def test_what_is_nearer_than_the_lidars_least_range_is_no_return(room: OccupancyGrid) -> None:
    with World(room, [(0.13, 1.0, 0.0)], Body()) as world:
        near = measure(world, world.poses[None], np.array([math.pi]), LidarConfig(yaw_rad=0.0))
        assert np.isinf(near).all()


def test_poses_between_turn_the_short_way() -> None:
    middle = poses_between(np.array([[0.0, 0.0, 3.1]]), np.array([[1.0, 2.0, -3.1]]), np.array([0.5, 1.0]))
    assert middle[0, 0] == pytest.approx([0.5, 1.0, math.pi])
    assert middle[1, 0, 2] == pytest.approx(2 * math.pi - 3.1)


def test_the_turtlebot3_world_becomes_few_boxes() -> None:
    grid = load_map(data_folder() / "ros_maps" / "turtlebot3_world.yaml")
    assert len(wall_boxes(grid)) < 300  # 795 occupied cells
