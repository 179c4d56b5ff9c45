"""Start the real daemon for a replay: recorded configuration and map as files, fake ports, a log of its own.

Knows hippomat-host's command line and nothing of what is inside it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hippomat_core import messages as m
from hippomat_core.config import Config, config_to_dict
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_logs.manifest import recorded_threads
from hippomat_logs.map_files import save_map
from hippomat_logs.reader import Run

FLAGS = {m.RADIO: "--port", m.BASE: "--base", m.LIDAR: "--lidar"}
END_S = 20.0


def to_toml(config: Config) -> str:
    """hippomat.toml with every value written out."""
    lines: list[str] = []
    for section, values in config_to_dict(config).items():
        lines.append(f"[{section}]")
        lines += [f"{key} = {_toml_value(value)}" for key, value in values.items()]
    return "\n".join(lines) + "\n"


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str | tuple):
        return json.dumps(value)  # TOML's basic strings escape as JSON's do, and its arrays look the same
    return repr(value)


def daemon_command(run: Run, directory: Path, paths: dict[int, str]) -> list[str]:
    """The command line that runs the daemon as it ran.

    Writes its configuration, map and policy into `directory`.
    """
    config = run.config
    if run.policy:
        policy = directory / "policy.safetensors"
        policy.write_bytes(run.policy)
        config = replace(config, fleet=replace(config.fleet, policy=str(policy.resolve())))
    settings = directory / "hippomat.toml"
    settings.write_text(to_toml(config), encoding="utf-8")
    command = [sys.executable, "-m", "hippomat_host"]
    for port, flag in FLAGS.items():
        if port in paths:
            command += [flag, paths[port]]
    command += ["--config", str(settings)]
    grid = recorded_map(run)
    if grid is not None:
        save_map(grid, directory / "map.yaml")
        command += ["--map", str(directory / "map.yaml")]
    return command


def recorded_map(run: Run) -> OccupancyGrid | None:
    """The run's first map."""
    for record in run.records_in_order((m.MapReceived,)):
        received = record.message
        if isinstance(received, m.MapReceived):
            cells = np.array(received.cells, np.int8).reshape(received.height, received.width)
            origin = received.origin_x_m, received.origin_y_m
            return OccupancyGrid(cells, received.resolution_m, *origin)
    return None


class DaemonProcess:
    """The daemon and what it says, as a context; it is not left behind."""

    def __init__(self, command: list[str], run: Run, directory: Path) -> None:
        self._output = directory / "daemon.out"
        environment = {**os.environ, **recorded_threads(run.manifest)}
        with self._output.open("wb") as out:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT, env=environment
            )

    @property
    def exit_code(self) -> int | None:
        return self._process.poll()

    def wait(self) -> int | None:
        """Its exit code, None if it does not end."""
        try:
            return self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            return None

    def last_words(self) -> str:
        lines = self._output.read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"

    def __enter__(self) -> DaemonProcess:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.terminate()
            if self.wait() is None:
                self._process.kill()
                self._process.wait()
