"""The real daemon as a process of its own, with three devices on pseudo-terminals."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from host_devices import Base, Lidar, Radio, plugged, wait_until

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.wire.frames import STATE
from hippomat_logs.map_files import save_map

DAEMON = [sys.executable, "-m", "hippomat_host"]


def hippomat_host(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run `hippomat-host` to its end."""
    command = [*DAEMON, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=cwd, check=False)


class Robot:
    """Devices in a directory, and the daemon on them. A fleet of one: it claims and drives by itself."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.radio = Radio(directory / "radio", robot=0)
        self.base = Base(directory / "base")
        self.lidar = Lidar(directory / "lidar")
        self.output = directory / "output.txt"
        self.log = directory / "runs"
        config = directory / "hippomat.toml"
        config.write_text(
            "[fleet]\nsize = 1\ntask_slots = 3\nturnover = 'on_completion'\n"  # its lidar sees no map
            "[slam]\nmode = 'odometry'\n"
        )
        self.options = [
            *("--port", str(self.radio.link), "--base", str(self.base.link), "--lidar", str(self.lidar.link)),
            *("--config", str(config), "--map", str(write_room(directory)), "--log", str(self.log)),
            *("--robot", "0", "--start", "0,0,0"),
        ]
        self.process: subprocess.Popen[bytes] | None = None

    def start(self, *more: str) -> subprocess.Popen[bytes]:
        with self.output.open("ab") as output:
            self.process = subprocess.Popen(
                [*DAEMON, *self.options, *more], stdout=output, stderr=output, start_new_session=True
            )
        return self.process

    def said(self) -> str:
        return self.output.read_text()

    def drives(self) -> bool:
        return self.base.moving()

    def stands(self) -> bool:
        return not self.base.moving()

    def sends_states(self) -> bool:
        return any(body.kind == STATE for body in self.radio.bodies)


@contextlib.contextmanager
def robot_in(directory: Path) -> Iterator[Robot]:
    """A robot whose daemon is not started yet; everything has ended afterwards."""
    robot = Robot(directory)
    with plugged(robot.radio, robot.base, robot.lidar):
        try:
            yield robot
        finally:
            if robot.process is not None and robot.process.poll() is None:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(robot.process.pid, signal.SIGCONT)
                robot.process.kill()
                robot.process.wait()


@contextlib.contextmanager
def driving_robot(directory: Path) -> Iterator[Robot]:
    """A robot whose daemon drives it to a task."""
    with robot_in(directory) as robot:
        robot.start()
        assert wait_until(robot.drives, 30.0), robot.said()
        yield robot


def write_room(directory: Path) -> Path:
    """An empty room of 8 m with its centre at the origin."""
    cells = np.zeros((80, 80), dtype=np.int8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    path = directory / "room.yaml"
    save_map(OccupancyGrid(cells, 0.1, -4.0, -4.0), path)
    return path
