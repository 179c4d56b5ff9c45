"""The whole way of a STOP: laptop, dongle, air, the robot's radio, its daemon, its motors."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest
from commands_run import run
from host_devices import wait_until
from host_process import robot_in
from real_radios import KEY, a_dongle, a_fleet, desk

Capture = pytest.CaptureFixture[str]


def test_stop_from_a_laptop_stops_the_motors_of_a_robot_and_resume_lets_it_drive_on(
    tmp_path: Path, capsys: Capture
) -> None:
    (tmp_path / "air").mkdir()
    memories = [*a_fleet(1, key=KEY), a_dongle(key=KEY)]
    with desk(tmp_path / "air", memories, loss=0.3) as radios, robot_in(tmp_path) as robot:
        at = robot.options.index("--port") + 1
        robot.options[at] = str(radios.path(0))
        process = robot.start()
        assert wait_until(robot.drives, 30.0), robot.said()
        for _ in range(2):
            begun_s = time.monotonic()
            ended = run(capsys, "stop", "--port", radios.path(1), "--reason", "test")
            assert ended.code == 0, ended
            assert "robot 0 shows STOP" in ended.out
            assert robot.stands()
            moved_s = max(at_s for at_s, v, wz in robot.base.velocities if (v, wz) != (0.0, 0.0))
            assert moved_s - begun_s < 1.5  # the 5 s are for who does not show it
            ended = run(capsys, "resume", "--port", radios.path(1))
            assert ended.code == 0, ended
            assert wait_until(robot.drives, 20.0), robot.said()
        process.send_signal(signal.SIGINT)
        assert process.wait(10.0) == 0
    assert "alarm stop" in robot.said()
    assert "cleared stop" in robot.said()
