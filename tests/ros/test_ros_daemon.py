"""The real daemon with ROS for map, pose, lidar and base; a stand-in speaks rosbridge over a websocket."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

from host_devices import wait_until
from ros_robot import RosRobot, driving_ros_robot

from hippomat_core.messages import (
    BASE,
    RADIO,
    ROS,
    Drive,
    LaserScanReceived,
    MapReceived,
    PortLost,
    PortOpened,
    PoseEstimated,
)
from hippomat_logs.reader import open_runs, read_records
from hippomat_logs.replay import OK, ReplayOptions, replay_run
from hippomat_logs.ros.dialect import ROS1

RADIUS_M = 0.12


def stopped(robot: RosRobot) -> list[Any]:
    """Everything in the log of a robot that is stopped as asked."""
    robot.process.send_signal(signal.SIGTERM)
    assert robot.process.wait(10.0) == 0, robot.said()
    (log,) = robot.log.iterdir()
    return [message for *_, message in read_records(log)]


def test_a_robot_of_ros_drives_stops_with_zeros_and_its_run_is_reproduced(tmp_path: Path) -> None:
    with driving_ros_robot(tmp_path) as robot:
        assert wait_until(lambda: robot.moved_m() > 0.15, 20.0), robot.said()
        messages = stopped(robot)
        last = robot.bridge.commands("/cmd_vel")[-3:]
    assert [(twist["linear"]["x"], twist["angular"]["z"]) for twist in last] == [(0.0, 0.0)] * 3
    assert {m.source for m in messages if isinstance(m, PoseEstimated)} >= {"ros"}
    assert any(isinstance(m, Drive) and m.reason == "follow" for m in messages)
    assert any(isinstance(m, LaserScanReceived) for m in messages)
    assert [m.epoch for m in messages if isinstance(m, MapReceived)] == [1]
    assert {m.port for m in messages if isinstance(m, PortOpened)} == {RADIO, BASE, ROS}
    (run,) = open_runs([robot.log])
    report = replay_run(run, ReplayOptions(levels=("L0", "L1", "L2", "daemon")))
    assert [(result.level, result.status) for result in report.results] == [
        (level, OK) for level in ("L0", "L1", "L2", "daemon")
    ], report.results
    (bytes_level,) = (result for result in report.results if result.level == "L1")
    assert "events from ROS have no bytes to compare" in bytes_level.detail


def test_whatever_fails_the_robot_stands_and_drives_on_when_it_is_back(tmp_path: Path) -> None:
    with driving_ros_robot(tmp_path, ros=ROS1) as robot:
        robot.process.send_signal(signal.SIGSTOP)  # a daemon that hangs
        assert wait_until(robot.stands, 5.0)
        robot.process.send_signal(signal.SIGCONT)
        assert wait_until(robot.drives, 20.0), robot.said()
        robot.bridge.stop()
        assert wait_until(lambda: robot.said().count("was lost") == 2), robot.said()
        assert wait_until(robot.stands, 5.0)
        robot.bridge.start()
        assert wait_until(robot.drives, 30.0), robot.said()
        robot.localizes = False
        assert wait_until(lambda: "is too old: does localization (amcl) still run?" in robot.said(), 15.0)
        assert wait_until(robot.stands, 5.0)
        robot.localizes = True
        assert wait_until(robot.drives, 20.0), robot.said()
        messages = stopped(robot)
    assert {m.port for m in messages if isinstance(m, PortLost)} == {BASE, ROS}
    assert [m.epoch for m in messages if isinstance(m, MapReceived)] == [1]  # the same map came again


def test_a_robot_stops_before_what_only_its_scan_shows_and_is_stopped_when_killed(
    tmp_path: Path,
) -> None:
    with driving_ros_robot(tmp_path) as robot:
        assert wait_until(lambda: robot.moved_m() > 0.1, 20.0), robot.said()
        robot.wall_m = robot.moved_m() + 0.35
        assert wait_until(lambda: robot.speed() == 0.0, 10.0), robot.said()
        assert robot.moved_m() + RADIUS_M < robot.wall_m
        robot.wall_m = 3.0
        assert wait_until(robot.drives, 20.0), robot.said()
        robot.process.kill()
        assert wait_until(lambda: robot.bridge.heard[-1][2]["linear"]["x"] == 0.0, 5.0)
