"""The core's door with ROS behind base, lidar, map and pose: what it refuses, and what its alarms say."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from ros_samples import MS, scan, transform

from hippomat_core.config import Config, FleetConfig, RobotConfig, RosConfig, config_from_dict
from hippomat_core.control.follower import Motion
from hippomat_core.control.nav_state import Navigator, NavOutcome
from hippomat_core.control.recovery import BACK_UP, CLEAR, TURN, Recovery, Standstill
from hippomat_core.errors import ConfigError
from hippomat_core.maps.map_event import map_event
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import (
    BASE,
    LIDAR,
    ROS,
    AlarmCleared,
    AlarmRaised,
    Drive,
    PortLost,
    PortOpened,
    PoseEstimated,
    ScanReceived,
    Started,
    Tick,
)
from hippomat_core.step import initial_state, step
from hippomat_core.unsticking import unstuck

CONFIG = Config(
    fleet=FleetConfig(size=1, allocator="hungarian"),
    robot=RobotConfig(id=0),
    ros=RosConfig(url="ws://x", odom_topic=""),
)


def room(side: int = 80) -> OccupancyGrid:
    cells = np.zeros((side, side), np.int8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    return OccupancyGrid(cells, 0.1, -side / 20, -side / 20)


class Robot:
    """The core, and what came of the events it was given."""

    def __init__(self, config: Config = CONFIG) -> None:
        self.state = initial_state(config)
        self.effects: list = []
        self.give(Started(0), PortOpened(0, ROS, "rosbridge"), PortOpened(0, BASE, "rosbridge /cmd_vel"))

    def give(self, *events) -> list:
        new = []
        for event in events:
            self.state, effects = step(self.state, event)
            new += effects
        self.effects += new
        return new

    def lives(self, from_ms: int, to_ms: int, *, correction=True, scans=True, late_ms: float = 0.0) -> list:
        """ROS as usual: odometry and ticks at 20 Hz, corrections and scans at 10 Hz."""
        new = []
        for ms in range(from_ms, to_ms, 50):
            new += self.give(transform("odom", "base_link", ms, (1.0, 0.0, 0.0)))
            if ms % 100 == 0 and correction:
                new += self.give(transform("map", "odom", ms, ahead_ms=1000))
            if ms % 100 == 0 and scans:
                full = scan(ms, [2.0] * 360, late_ms=late_ms, low=-math.pi, step=math.pi / 180)
                new += self.give(full)
            new += self.give(Tick(ms * MS + 1))
        return new

    def faults(self) -> set[str]:
        return {code for code, _ in self.state.faults}


def mount() -> object:
    return transform("base_link", "laser", 0, fixed=True)


def running() -> Robot:
    robot = Robot()
    robot.give(map_event(room(), 0, 1), mount())
    robot.lives(0, 5000)
    return robot


def alarms(effects) -> dict[str, str]:
    return {effect.code: effect.text for effect in effects if isinstance(effect, AlarmRaised)}


def test_with_everything_from_ros_nothing_is_missing_but_the_radio():
    robot = running()
    assert robot.faults() == {"radio_lost"}
    pose = [effect for effect in robot.effects if isinstance(effect, PoseEstimated)][-1]
    assert (pose.x_m, pose.y_m, pose.source) == (1.0, 0.0, "ros")
    assert robot.state.moved_ns == 4950 * MS  # what the guard takes for the age of what it knows of motion


@pytest.mark.parametrize(
    ("missing", "code", "said"),
    [
        ({"correction": False}, "not_localized", "too old: does localization"),
        ({"scans": False}, "lidar_lost", "no fresh scan from ROS (/scan)"),
        ({"late_ms": 900.0}, "lidar_lost", "no fresh scan"),
    ],
)
def test_what_gets_old_stops_the_robot_and_is_named(missing, code, said):
    robot = running()
    new = robot.lives(5000, 9500, **missing)
    assert code in robot.faults()
    assert said in alarms(new)[code]
    assert [effect for effect in new if isinstance(effect, Drive)][-1].v_mps == 0.0
    new = robot.lives(9500, 11_000)
    assert code not in robot.faults()
    assert AlarmCleared(code) in new


@pytest.mark.parametrize("late_ms", [800.0, 1200.0, 2000.0, 5000.0])
def test_a_scan_is_as_late_as_it_is_while_the_transforms_are_prompt(late_ms):
    robot = running()
    new = robot.lives(5000, 15_000, late_ms=late_ms)
    assert {"radio_lost", "lidar_lost"} == robot.faults()
    assert 14_900 * MS - robot.state.scan.stamp_ns == late_ms * MS
    assert {effect.v_mps for effect in new if isinstance(effect, Drive)} == {0.0}


@pytest.mark.parametrize("ranges", [[math.nan] * 360, [-math.inf] * 360, []])
def test_a_lidar_whose_rays_come_to_no_result_is_lost(ranges):
    robot = running()
    last = robot.state.scan
    for ms in range(5000, 9000, 50):
        robot.lives(ms, ms + 50, scans=False)
        robot.give(scan(ms, ranges, low=-math.pi, step=math.pi / 180))
    assert robot.state.scan is last
    assert "lidar_lost" in robot.faults()


@pytest.mark.parametrize("nothing", [math.inf, 99.0])
def test_a_lidar_that_sees_nothing_far_and_wide_is_not_lost(nothing):
    robot = running()
    robot.give(scan(5000, [nothing] * 360, low=-math.pi, step=math.pi / 180))
    assert (robot.state.scan.stamp_ns, len(robot.state.scan.points)) == (5000 * MS, 0)
    assert robot.state.scan.whole


@pytest.mark.parametrize(("seen_deg", "whole"), [(180, False), (270, False), (344, False), (346, True)])
def test_a_scan_knows_whether_it_looked_all_round(seen_deg, whole):
    robot = running()
    low = math.radians(90 - seen_deg / 2)
    robot.give(scan(5000, [2.0] * (seen_deg + 1), low=low, step=math.pi / 180))
    assert robot.state.scan.whole == whole
    blinded = [2.0] * seen_deg + [math.nan] * (361 - seen_deg)  # the same, said in another way
    robot.give(scan(5100, blinded, low=low, step=math.pi / 180))
    assert robot.state.scan.whole == whole


@pytest.mark.parametrize(("seen_deg", "tries"), [(359, BACK_UP), (180, TURN)])
def test_a_stuck_robot_backs_up_only_where_its_lidar_looks(seen_deg, tries):
    robot, goal = running(), (3.0, 0.0)
    robot.give(scan(5000, [2.0] * (seen_deg + 1), low=math.radians(-seen_deg / 2), step=math.pi / 180))
    still = Standstill(anchor=(1.0, 0.0, 0.0), stalled_s=100.0)
    stuck = Recovery(stamp_ns=5000 * MS, goal=goal, tried=CLEAR, still=still, stuck_at=(1.0, 0.0))
    state, navigator = replace(robot.state, recovery=stuck), replace(Navigator(), destination=goal)
    outcome = NavOutcome(0.0, 0.0, "hold", None, np.zeros((1, 2), np.int64), False, False, -1, 2.0)
    state, _, _ = unstuck(state, 5050 * MS, Motion(1.0, 0.0, 0.0), (), navigator, outcome, [])
    assert state.recovery.step == tries


def test_a_base_that_says_nothing_is_lost_although_ros_is_there():
    robot = running()
    new = robot.give(*(Tick(ms * MS) for ms in range(5000, 7000, 50)))
    assert {"base_lost", "not_localized", "lidar_lost"} <= robot.faults()
    assert "does the base's driver run?" in alarms(new)["base_lost"]


def test_the_alarm_of_a_missing_pose_names_the_missing_link():
    robot = Robot()
    robot.give(map_event(room(), 0, 1))
    said = alarms(robot.give(*(Tick(ms * MS) for ms in range(0, 5000, 50))))
    assert "ROS says nothing of frame 'base_link'" in said["not_localized"]
    robot = Robot()
    robot.give(map_event(room(), 0, 1))
    said = alarms(robot.lives(0, 5000, correction=False))
    assert "no way from 'map' to 'odom'" in said["not_localized"]


def test_a_lost_bridge_takes_its_lidar_along_and_a_new_one_brings_it_back():
    robot = running()
    robot.give(PortLost(5000 * MS, ROS, "rosbridge hung up"))
    assert robot.state.scan is None
    assert not robot.state.ports[LIDAR]
    robot.give(PortOpened(5100 * MS, ROS, "rosbridge"), mount())
    robot.lives(5100, 6000)
    assert robot.faults() == {"radio_lost"}


def test_a_scan_whose_mount_is_unknown_is_said_once_and_taken_back():
    robot = Robot()
    robot.give(map_event(room(), 0, 1))
    said = alarms(robot.lives(0, 3000))
    assert "publish it (static_transform_publisher)" in said["scan_frame"]
    assert "lidar_lost" in robot.faults()
    robot.give(mount())
    assert AlarmCleared("scan_frame") in robot.lives(3000, 3500)


def test_a_map_that_cannot_be_used_is_refused_and_the_one_before_holds():
    robot = running()
    held = robot.state.ground
    said = alarms(robot.give(map_event(room(3), 5000 * MS, 2)))
    assert "the map from ROS is not used" in said["map_refused"]
    assert robot.state.ground is held
    robot.give(map_event(room(100), 5001 * MS, 3))
    assert robot.state.ground is not None
    assert robot.state.ground.epoch == 3


def test_a_jump_of_the_localization_does_not_move_what_the_guard_sees():
    robot = running()
    seen = robot.state.scan.points
    robot.give(transform("map", "odom", 5000, (0.4, -0.3, 0.2), ahead_ms=1000))
    assert robot.state.pose == pytest.approx((0.4 + math.cos(0.2), -0.3 + math.sin(0.2), 0.2))
    assert robot.state.steady_pose == pytest.approx((1.0, 0.0, 0.0))
    robot.give(scan(5050, [2.0] * 360, low=-math.pi, step=math.pi / 180))
    assert robot.state.scan.points == pytest.approx(seen)


@pytest.mark.parametrize(("x_m", "forgotten"), [(0.1, False), (2.0, True)])
def test_only_where_localization_puts_the_robot_elsewhere_it_forgets_the_places_it_passed(x_m, forgotten):
    robot = running()
    passed = Recovery(trail=((9.0, 9.0),))
    robot.state = replace(robot.state, recovery=passed)
    robot.give(transform("map", "odom", 5000, (x_m, 0.0, 0.0), ahead_ms=1000))
    assert (robot.state.recovery is not passed) == forgotten
    assert (robot.state.placed_ns == 5000 * MS) == forgotten


def test_a_restart_of_the_odometry_is_said_and_its_scan_not_used():
    robot = running()
    said = alarms(robot.give(transform("odom", "base_link", 5000, (-3.0, 0.0, 0.0))))
    assert "the odometry from ROS jumped" in said["odometry_jump"]
    assert robot.state.scan is None
    assert robot.state.velocity == (0.0, 0.0)
    assert not alarms(robot.lives(9000, 10_000)).keys() & {"odometry_jump"}  # it may have driven


def test_a_serial_lidars_scan_is_not_used_across_the_coming_of_a_pose_from_ros():
    robot = Robot(replace(CONFIG, ros=replace(CONFIG.ros, lidar=False)))
    quality = np.full(360, 40, np.uint8)
    angles = np.arange(360, dtype=np.uint16) * 64
    sweep = ScanReceived(MS, quality, angles, np.full(360, 4000, np.uint16))
    robot.give(PortOpened(0, LIDAR, "RPLIDAR"), sweep)
    assert robot.state.scan is not None
    robot.give(transform("odom", "base_link", 1, (1.0, 0.0, 0.0)), transform("map", "odom", 1))
    assert robot.state.scan is None
    robot.give(sweep)
    assert robot.state.scan is not None


def test_settings_that_cannot_work_are_refused_by_name():
    with pytest.raises(ConfigError, match=r"\[ros\] url = 'localhost:9090' is no rosbridge address"):
        config_from_dict({"ros": {"url": "localhost:9090"}})
    with pytest.raises(ConfigError, match=r"base = true needs pose = true"):
        config_from_dict({"ros": {"url": "ws://x", "pose": False}})
    assert not config_from_dict({"ros": {"pose": False}}).ros.localizes


def test_roles_that_ros_does_not_have_are_not_taken_from_it():
    ros = replace(CONFIG.ros, lidar=False, map=False, base=False, pose=False)
    robot = Robot(replace(CONFIG, ros=ros))
    robot.give(PortOpened(0, LIDAR, "RPLIDAR"), PortLost(1, ROS, "gone"))
    assert robot.state.ports[LIDAR]
    assert robot.state.external_pose is None
