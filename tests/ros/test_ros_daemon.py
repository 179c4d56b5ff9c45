"""The real daemon with ROS for map, pose, lidar and base; a stand-in speaks rosbridge over a websocket."""

from __future__ import annotations

import signal
from pathlib import Path

from host_devices import wait_until
from ros_robot import driving_ros_robot, ros_robot

from hippomat_core.messages import BASE, ROS, Drive, MapReceived, PortLost, PortOpened, PoseEstimated
from hippomat_logs.reader import read_records


def test_a_robot_of_ros_drives_to_its_task_and_is_stopped_with_zeros(tmp_path: Path) -> None:
    with driving_ros_robot(tmp_path) as robot:
        assert wait_until(lambda: robot.moved_m() > 0.3, 20.0), robot.said()
        robot.process.send_signal(signal.SIGTERM)
        assert robot.process.wait(10.0) == 0
        last = robot.bridge.commands("/cmd_vel")[-3:]
        assert [(twist["linear"]["x"], twist["angular"]["z"]) for twist in last] == [(0.0, 0.0)] * 3
        (log,) = robot.log.iterdir()
        messages = [message for *_, message in read_records(log)]
        assert {m.source for m in messages if isinstance(m, PoseEstimated)} >= {"ros"}
        assert any(isinstance(m, Drive) and m.reason == "follow" for m in messages)
        assert [m.epoch for m in messages if isinstance(m, MapReceived)] == [1]
        assert {m.port for m in messages if isinstance(m, PortOpened)} == {0, BASE, ROS}


def test_a_robot_whose_rosbridge_restarts_stands_and_drives_on(tmp_path: Path) -> None:
    with driving_ros_robot(tmp_path) as robot:
        robot.bridge.stop()
        assert wait_until(lambda: "was lost" in robot.said()), robot.said()
        robot.bridge.heard.clear()
        robot.bridge.start()
        assert wait_until(robot.drives, 30.0), robot.said()
        robot.process.send_signal(signal.SIGTERM)
        assert robot.process.wait(10.0) == 0
        (log,) = robot.log.iterdir()
        messages = [message for *_, message in read_records(log)]
        assert {m.port for m in messages if isinstance(m, PortLost)} == {BASE, ROS}
        assert [m.epoch for m in messages if isinstance(m, MapReceived)] == [1]  # the same map came again


def test_a_frozen_daemon_is_replaced_by_zeros(tmp_path: Path) -> None:
    with driving_ros_robot(tmp_path) as robot:
        robot.process.send_signal(signal.SIGSTOP)
        assert wait_until(robot.stands, 5.0)
        robot.process.send_signal(signal.SIGCONT)
        assert wait_until(robot.drives, 20.0), robot.said()


def test_a_killed_daemon_leaves_zeros_behind(tmp_path: Path) -> None:
    with driving_ros_robot(tmp_path) as robot:
        robot.process.kill()
        assert wait_until(robot.stands, 5.0)


def test_a_robot_stops_when_its_localization_dies_and_says_so(tmp_path: Path) -> None:
    with driving_ros_robot(tmp_path) as robot:
        robot.localizes = False
        assert wait_until(lambda: "alarm not_localized" in robot.said(), 15.0), robot.said()
        assert wait_until(robot.stands, 5.0)
        assert "is too old: does localization (amcl) still run?" in robot.said()


def test_a_robot_stops_before_what_only_its_scan_shows(tmp_path: Path) -> None:
    with driving_ros_robot(tmp_path) as robot:
        robot.wall_m = 0.2
        assert wait_until(lambda: robot.speed() == 0.0, 10.0), robot.said()


def test_nothing_moves_without_a_map(tmp_path: Path) -> None:
    with ros_robot(tmp_path, with_map=False) as robot:
        robot.run_daemon()
        assert wait_until(lambda: "no map from ROS yet (/map)" in robot.said(), 30.0), robot.said()
        assert robot.stands()
