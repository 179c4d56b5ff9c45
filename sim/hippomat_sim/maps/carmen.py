"""Lidar logs in CARMEN's text format (Radish data sets): lines in, scans out. Opens files, draws nothing.

A scan is a line `FLASER n range*n x y yaw odom_x odom_y odom_yaw ipc_time host logger_time`; other lines are
skipped. Ranges run counter-clockwise from -90 degrees, a degree apart for 180 and half a degree for 361.
In "corrected" logs both poses were replaced by a SLAM program's: they are no odometry.
"""

from __future__ import annotations

import gzip
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import ConfigError

NO_RETURN_M = 80.0  # a SICK reports 81.83 or 81.91 m where nothing came back
BEFORE, AFTER = 2, 9  # fields around the ranges
ODOM_FIELDS = 10


@dataclass(frozen=True, slots=True, eq=False)
class CarmenScan:
    """One FLASER line."""

    stamp_s: float  # logger time
    points: NDArray[np.float64]  # (n, 2) [m] returns in the laser's frame: x forward, y left
    pose: NDArray[np.float64]  # (3,) x [m], y [m], yaw [rad] as the log has it


@dataclass(frozen=True, slots=True, eq=False)
class CarmenLog:
    """The scans, and every stamped pose (FLASER and ODOM lines), in file order."""

    scans: tuple[CarmenScan, ...]
    stamps_s: NDArray[np.float64]  # (m,) logger time; neither sorted nor unique in real logs
    poses: NDArray[np.float64]  # (m, 3) x [m], y [m], yaw [rad]
    of_scan: NDArray[np.bool_]  # (m,) True for FLASER lines


def read_carmen(path: Path) -> CarmenLog:
    """A .log or .log.gz; ConfigError names file and line. ODOM lines without a stamp (0) are skipped."""
    scans: list[CarmenScan] = []
    rows: list[tuple[float, ...]] = []
    for number, line in enumerate(_lines(path), 1):
        try:
            if line.startswith("FLASER "):
                scans.append(_scan(line))
                rows.append((1.0, scans[-1].stamp_s, *scans[-1].pose))
            elif line.startswith("ODOM "):
                rows.append((0.0, *_odometry(line)))
        except (ValueError, IndexError) as error:
            raise ConfigError(f"log {path}, line {number}: {error}") from None
    if not scans:
        raise ConfigError(f"log {path}: has no FLASER line; a CARMEN log is needed")
    table = np.array(rows)
    table = table[(table[:, 0] == 1.0) | (table[:, 1] > 0.0)]
    return CarmenLog(tuple(scans), table[:, 1], table[:, 2:], table[:, 0] == 1.0)


def _lines(path: Path) -> Iterator[str]:
    try:
        with gzip.open(path, "rt") if path.suffix == ".gz" else path.open() as file:
            yield from file
    except (OSError, EOFError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"log {path}: cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from None


def _scan(line: str) -> CarmenScan:
    words = line.split()
    count = int(words[1])
    if len(words) != BEFORE + count + AFTER:
        raise ValueError(f"{count} ranges make {BEFORE + count + AFTER} fields, found {len(words)}")
    ranges_m = np.array(words[BEFORE : BEFORE + count], np.float64)
    pose = np.array(words[BEFORE + count : BEFORE + count + 3], np.float64)
    stamp_s = float(words[-1])
    if not (np.isfinite(ranges_m).all() and np.isfinite(pose).all() and math.isfinite(stamp_s)):
        raise ValueError("has a value that is not finite")
    intervals = count if count % 2 == 0 else count - 1  # 180 beams end at 89 degrees, 361 at 90
    bearing = -math.pi / 2 + np.arange(count) * math.pi / max(intervals, 1)
    seen = (ranges_m > 0.0) & (ranges_m < NO_RETURN_M)
    points = np.stack([ranges_m * np.cos(bearing), ranges_m * np.sin(bearing)], axis=1)[seen]
    return CarmenScan(stamp_s, points, pose)


def _odometry(line: str) -> tuple[float, ...]:
    """Stamp and x, y, yaw of an ODOM line."""
    words = line.split()
    if len(words) != ODOM_FIELDS:
        raise ValueError(f"an ODOM line has {ODOM_FIELDS} fields, found {len(words)}")
    numbers = tuple(float(word) for word in (words[-1], *words[1:4]))
    if not all(map(math.isfinite, numbers)):
        raise ValueError("has a value that is not finite")
    return numbers
