"""However the daemon ends, the base stops: it holds its last velocity for ever, as the real one may."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from host_devices import wait_until
from host_process import Robot, driving_robot

from hippomat_core.messages import BASE, LIDAR
from hippomat_core.wire import rplidar
from hippomat_core.wire.jetbot_base import encode_velocity
from hippomat_logs.reader import read_records
from hippomat_logs.records import SerialRecord

LATEST_S = 0.3


def stopped_after(robot: Robot, from_s: float) -> float:
    """How long after `from_s` the base was given its last velocity that is not zero [s]."""
    assert wait_until(robot.stands, 5.0)
    time.sleep(0.3)
    last = max((at for at, v, wz in robot.base.velocities if (v, wz) != (0.0, 0.0)), default=from_s)
    return last - from_s


def test_kill_9_of_the_daemon_stops_the_base(tmp_path: Path) -> None:
    with driving_robot(tmp_path) as robot:
        assert robot.process is not None
        killed_s = time.monotonic()
        os.kill(robot.process.pid, signal.SIGKILL)
        assert stopped_after(robot, killed_s) < LATEST_S


def test_a_stopped_daemon_stops_the_base_and_a_continued_one_drives_on(tmp_path: Path) -> None:
    with driving_robot(tmp_path) as robot:
        assert robot.process is not None
        paused_s = time.monotonic()
        os.kill(robot.process.pid, signal.SIGSTOP)
        assert stopped_after(robot, paused_s) < LATEST_S
        os.kill(robot.process.pid, signal.SIGCONT)
        assert wait_until(robot.drives), robot.said()
        told = "the motor guard stopped the base: no command for"
        assert wait_until(lambda: told in robot.said(), 5.0), robot.said()


def test_sigterm_stops_motors_then_lidar_then_finishes_the_log(tmp_path: Path) -> None:
    with driving_robot(tmp_path) as robot:
        assert robot.process is not None
        robot.process.terminate()
        assert robot.process.wait(10.0) == 0
        assert robot.stands()
        assert not robot.lidar.scanning
        zero_s = next(at for at, v, wz in reversed(robot.base.velocities) if (v, wz) != (0.0, 0.0))
        stop_s = robot.lidar.received[-1][0]
        assert robot.lidar.received[-1][1] == rplidar.request(rplidar.STOP)
        assert zero_s < stop_s
        assert "Traceback" not in robot.said()
        (log,) = robot.log.iterdir()
        assert log.suffix == ".mcap"
        records = [record for *_, record in read_records(log)]
        writes = [record for record in records if isinstance(record, SerialRecord) and record.direction == 1]
        assert (writes[-2].port, bytes(writes[-2].data)) == (BASE, encode_velocity(0.0, 0.0))
        assert (writes[-1].port, bytes(writes[-1].data)) == (LIDAR, rplidar.request(rplidar.STOP))


def test_a_dead_guard_stops_the_base_and_is_replaced(tmp_path: Path) -> None:
    with driving_robot(tmp_path) as robot:
        guard = guard_pid(robot)
        killed_s = time.monotonic()
        os.kill(guard, signal.SIGKILL)
        assert wait_until(lambda: "was lost" in robot.said()), robot.said()
        zeros = [at for at, v, wz in robot.base.velocities if at > killed_s and (v, wz) == (0.0, 0.0)]
        assert wait_until(lambda: guard_pid(robot) not in (guard, 0))
        assert zeros
        resumed_s = time.monotonic()
        assert wait_until(lambda: any(at > resumed_s and v for at, v, _ in robot.base.velocities)), (
            robot.said()
        )


def guard_pid(robot: Robot) -> int:
    """The daemon's child, 0 if there is none just now."""
    assert robot.process is not None
    children = Path(f"/proc/{robot.process.pid}/task/{robot.process.pid}/children").read_text().split()
    return int(children[0]) if children else 0
