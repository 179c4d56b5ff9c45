"""A robot whose ROS is a stand-in: map_server, amcl, a lidar's and a base's driver, all behind rosbridge."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from host_devices import Radio, plugged, wait_until
from host_process import DAEMON

from hippomat_core.maps.map_event import map_event
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import LaserScanReceived, OdometryReceived, TransformReceived
from hippomat_logs.ros.dialect import MAP, ODOMETRY, ROS2, SCAN, TF
from hippomat_logs.ros.fake_rosbridge import FakeRosbridge

AHEAD_NS = 1_000_000_000  # amcl's transform_tolerance
DRIVER_S = 0.5  # the base stops by itself when it hears nothing for so long


def room() -> OccupancyGrid:
    """An empty room of 8 m with its centre at the origin."""
    cells = np.zeros((80, 80), np.int8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    return OccupancyGrid(cells, 0.1, -4.0, -4.0)


class RosRobot(threading.Thread):
    """It starts 0.5 m right of the map's origin; its odometry starts at zero, as a base's does."""

    def __init__(self, directory: Path, bridge: FakeRosbridge, *more: str) -> None:
        super().__init__(name="ros", daemon=True)
        self.directory, self.bridge = directory, bridge
        self.radio = Radio(directory / "radio", robot=0)
        self.output, self.log = directory / "output.txt", directory / "runs"
        config = directory / "hippomat.toml"
        config.write_text("[fleet]\nsize = 1\ntask_slots = 3\nturnover = 'on_completion'\n")
        self.options = [
            *("--port", str(self.radio.link), "--ros", bridge.url, "--config", str(config)),
            *("--robot", "0", "--log", str(self.log), *more),
        ]
        self.process: subprocess.Popen[bytes] = None  # type: ignore[assignment]
        self.localizes = True
        self.wall_m = 3.0  # radius of a round wall about where it started
        self.odom = [0.0, 0.0, 0.0]
        self._ended = threading.Event()

    # ---- the daemon ----

    def run_daemon(self) -> None:
        with self.output.open("ab") as output:
            self.process = subprocess.Popen(
                [*DAEMON, *self.options], stdout=output, stderr=output, start_new_session=True
            )

    def said(self) -> str:
        return self.output.read_text()

    def speed(self) -> float:
        """Forward, as commanded last, and zero where the base's driver has given up on commands."""
        return self._command()[0]

    def drives(self) -> bool:
        return self._command() != (0.0, 0.0)

    def stands(self) -> bool:
        return not self.drives()

    def moved_m(self) -> float:
        return math.hypot(self.odom[0], self.odom[1])

    def _command(self) -> tuple[float, float]:
        if not self.bridge.heard:
            return 0.0, 0.0
        at_s, _, twist = self.bridge.heard[-1]
        if time.monotonic() - at_s > DRIVER_S:
            return 0.0, 0.0
        return twist["linear"]["x"], twist["angular"]["z"]

    # ---- ROS ----

    def run(self) -> None:
        say, k = self.bridge.say_event, 0
        say("/tf_static", self._transform("base_footprint", "base_link", (0.0, 0.0, 0.0), True))
        say("/tf_static", self._transform("base_link", "laser", (0.05, 0.0, math.pi), True))
        while not self._ended.wait(0.02):
            k += 1
            v, wz = self._command()
            x, y, yaw = self.odom
            self.odom = [x + v * 0.02 * math.cos(yaw), y + v * 0.02 * math.sin(yaw), yaw + wz * 0.02]
            say("/tf", self._transform("odom", "base_footprint", tuple(self.odom), False))
            say("/odom", OdometryReceived(0, time.time_ns(), v, wz))
            if k % 5 == 0:
                say("/scan", self._scan())
                if self.localizes:
                    say("/tf", self._transform("map", "odom", (0.5, 0.0, 0.0), False, AHEAD_NS))

    def _transform(self, parent, child, pose, fixed, ahead_ns=0) -> TransformReceived:
        x, y, yaw = pose
        turn = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        return TransformReceived(0, time.time_ns() + ahead_ns, parent, child, fixed, x, y, 0.0, *turn)

    def _scan(self) -> LaserScanReceived:
        step = math.radians(1.0)
        x, y, yaw = self.odom
        x, y = x + 0.05 * math.cos(yaw), y + 0.05 * math.sin(yaw)  # the lidar, which looks backwards
        rays = yaw + step * np.arange(360)
        along = x * np.cos(rays) + y * np.sin(rays)
        walls = -along + np.sqrt(np.maximum(along**2 - (x * x + y * y - self.wall_m**2), 0.0))
        return LaserScanReceived(
            0, time.time_ns(), "laser", -math.pi, step, 0.0, 0.05, 12.0, walls.astype(np.float32)
        )

    def close(self) -> None:
        self._ended.set()
        self.join()


@contextlib.contextmanager
def ros_robot(directory: Path, *more: str, ros: int = ROS2) -> Iterator[RosRobot]:
    """A robot whose daemon is not started yet; everything has ended afterwards."""
    with FakeRosbridge(ros) as bridge:
        for name, kind in (("/tf", TF), ("/scan", SCAN), ("/odom", ODOMETRY)):
            bridge.topic(name, kind)
        for name, kind in (("/map", MAP), ("/tf_static", TF)):
            bridge.topic(name, kind, latched=True)
        bridge.say_event("/map", map_event(room()))
        robot = RosRobot(directory, bridge, *more)
        with plugged(robot.radio):
            robot.start()
            try:
                yield robot
            finally:
                robot.close()
                if robot.process is not None and robot.process.poll() is None:
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(robot.process.pid, signal.SIGCONT)
                    robot.process.kill()
                    robot.process.wait()


@contextlib.contextmanager
def driving_ros_robot(directory: Path, *more: str, ros: int = ROS2) -> Iterator[RosRobot]:
    """A robot whose daemon drives it to a task."""
    with ros_robot(directory, *more, ros=ros) as robot:
        robot.run_daemon()
        assert wait_until(robot.drives, 90.0), robot.said()
        yield robot
