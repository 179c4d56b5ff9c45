"""Where the robots really were: a motion-capture system's CSV, or the simulator's truth.npz.

CSV: a header with time_s, robot, x_m, y_m and, where it is known, yaw_rad; other columns are ignored. One
line per robot and moment, in any order. Its clock and its frame are its own. Knows files, not logs.
"""

from __future__ import annotations

import csv
import math
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import HippomatError

Floats = NDArray[np.float64]
REQUIRED = ("time_s", "robot", "x_m", "y_m")
YAW = "yaw_rad"
CLOCKS = ("clock_ahead_ns", "clock_drift_ppb")


@dataclass(frozen=True, slots=True)
class Track:
    """One body's way: times ascending, poses x [m], y [m], yaw [rad, unwrapped; nan: not known]."""

    time_s: Floats  # (T,)
    poses: Floats  # (T, 3)

    def at(self, time_s: Floats) -> Floats:
        """(n, 3) in between; the first and last pose beyond the ends."""
        return np.stack([np.interp(time_s, self.time_s, self.poses[:, k]) for k in range(3)], axis=1)


@dataclass(frozen=True, slots=True)
class Truth:
    """Tracks by robot. simulated: time_s is the world's clock, and the frame is the map's."""

    tracks: dict[int, Track]
    simulated: bool = False
    clocks: dict[int, tuple[int, int]] = field(default_factory=dict)
    # robot -> ns by which its monotonic clock was ahead at the world's 0, parts in 10^9 by which it was fast

    def world_s(self, robot: int, own_ns: NDArray[np.int64]) -> Floats:
        """(n,) the world's clock at these times of the robot's monotonic one."""
        ahead_ns, drift_ppb = self.clocks.get(robot, (0, 0))
        return (own_ns - ahead_ns) / 1e9 / (1.0 + drift_ppb / 1e9)


def read_truth(path: Path) -> Truth:
    """Raises HippomatError naming file, line, column and value."""
    if not path.is_file():
        raise HippomatError(f"{path}: no such file; --truth takes a CSV of motion capture or a truth.npz")
    return _read_npz(path) if path.suffix == ".npz" else _read_csv(path)


def _read_npz(path: Path) -> Truth:
    try:
        with np.load(path) as file:
            time_s, poses = file["stamp_ns"] / 1e9, np.asarray(file["poses"], np.float64)
            wrong = [file[name].tolist() for name in CLOCKS if name in file]  # absent: all clocks were right
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise HippomatError(f"{path}: is no truth.npz of hippomat-sim: {error}") from None
    if poses.ndim != 3 or poses.shape[2] != 3 or len(time_s) != len(poses) or len(poses) < 2:
        raise HippomatError(f"{path}: is no truth.npz of hippomat-sim: poses of shape {poses.shape}")
    tracks = {k: _track(time_s, poses[:, k]) for k in range(poses.shape[1])}
    clocks = dict(enumerate(zip(*wrong, strict=True))) if len(wrong) == len(CLOCKS) else {}
    return Truth(tracks, True, clocks)


def _read_csv(path: Path) -> Truth:
    rows: dict[int, list[tuple[float, float, float, float]]] = {}
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        reader = csv.DictReader(file, skipinitialspace=True)
        columns = [name.strip() for name in reader.fieldnames or ()]
        reader.fieldnames = columns
        missing = [name for name in REQUIRED if name not in columns]
        if missing:
            raise HippomatError(
                f"{path}: has no column {', '.join(missing)} in its first line; it needs "
                f"{', '.join(REQUIRED)} and may have {YAW} (docs/metrics.md)"
            )
        for row in reader:
            where = f"{path}, line {reader.line_num}"
            values = [_value(row, name, where) for name in REQUIRED]
            yaw_rad = _value(row, YAW, where) if YAW in columns else math.nan
            rows.setdefault(_robot(values[1], where), []).append((values[0], values[2], values[3], yaw_rad))
    tracks = {}
    for robot, told in rows.items():
        table = np.array(sorted(told), np.float64)
        table = table[np.concatenate([[True], np.diff(table[:, 0]) > 0.0])]
        if len(table) >= 2:
            tracks[robot] = _track(table[:, 0], table[:, 1:])
    if not tracks:
        raise HippomatError(f"{path}: holds no robot at two moments or more")
    return Truth(tracks)


def _value(row: dict[str, str | None], name: str, where: str) -> float:
    text = row.get(name)
    try:
        value = float(text or "")
    except ValueError:
        raise HippomatError(f"{where}: {name} = {text!r} is no number; leave lost moments out") from None
    if not math.isfinite(value):
        raise HippomatError(f"{where}: {name} = {text!r} is not finite; leave lost moments out")
    return value


def _robot(value: float, where: str) -> int:
    if value != int(value) or not 0 <= value < 64:
        raise HippomatError(f"{where}: robot = {value:g} is no robot's id (0 .. 63)")
    return int(value)


def _track(time_s: Floats, poses: Floats) -> Track:
    return Track(time_s, np.column_stack([poses[:, :2], np.unwrap(poses[:, 2])]))
