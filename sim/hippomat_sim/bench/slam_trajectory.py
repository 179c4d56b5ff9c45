"""Where the robot was at any time, from poses at some times: ordered stamps, and odometry between scans.

Loggers stamp lines when they write them: some lines of real logs are stamped before the line above them.
Knows stamps and poses, no scans.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import ConfigError
from hippomat_core.slam.poses import composed, seen_from, wrapped
from hippomat_sim.maps.carmen import CarmenLog

SAME_SCAN_S = 0.01  # logs round stamps to six digits


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses in the order of their stamps; in between they are interpolated."""

    stamps_s: NDArray[np.float64]  # (n,) ascending, no two alike
    poses: NDArray[np.float64]  # (n, 3) x [m], y [m], yaw [rad]

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k, 3) the poses at these times; before the first and after the last stamp those hold."""
        yaw = np.unwrap(self.poses[:, 2])
        columns = (self.poses[:, 0], self.poses[:, 1], yaw)
        return np.stack([np.interp(times_s, self.stamps_s, column) for column in columns], axis=1)


def trajectory_of(stamps_s: NDArray[np.float64], poses: NDArray[np.float64]) -> Trajectory:
    """Of lines in file order; left out are those not stamped later than the line above them."""
    kept = np.concatenate([[True], np.diff(stamps_s) > 0.0])
    stamps_s, first = np.unique(stamps_s[kept], return_index=True)
    return Trajectory(stamps_s, poses[kept][first])


def with_odometry_between(scans: Trajectory, log: CarmenLog, offset_s: float) -> Trajectory:
    """The scans' poses, with a log's odometry in between; its stamps + offset_s are those of `scans`.

    The log is of the same run: its ODOM lines between two FLASER lines tell how the robot moved between those
    scans. What odometry and the two poses disagree on is spread evenly over the lines between. Raises
    ConfigError where no two scans in a row are in both.
    """
    lines = np.flatnonzero(log.of_scan)
    taken_s = log.stamps_s[lines] + offset_s
    nearest = _nearest(taken_s, scans.stamps_s)
    same = np.abs(taken_s - scans.stamps_s[nearest]) <= SAME_SCAN_S
    stamps_s, poses = [scans.stamps_s], [scans.poses]  # first: of a scan and an odometry line the scan counts
    for k in np.flatnonzero(same[:-1] & same[1:]):
        between = slice(lines[k] + 1, lines[k + 1])
        if between.stop > between.start:
            here, there = scans.poses[nearest[k]], scans.poses[nearest[k + 1]]
            moved = seen_from(log.poses[lines[k]], log.poses[between])
            stretch = trajectory_of(log.stamps_s[between] + offset_s, _bent(moved, seen_from(here, there)))
            stamps_s.append(stretch.stamps_s)
            poses.append(composed(here, stretch.poses))
    if len(stamps_s) == 1:
        raise ConfigError("--between: none of its scans is in the log: is --time-offset right?")
    unique_s, first = np.unique(np.concatenate(stamps_s), return_index=True)
    return Trajectory(unique_s, np.concatenate(poses)[first])


def _bent(moved: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """The motion (k, 3), changed evenly from line to line so that it ends at `end` (3,)."""
    off = end - moved[-1]
    off[2] = wrapped(off[2])
    share = np.arange(1, len(moved) + 1, dtype=np.float64) / len(moved)
    bent: NDArray[np.float64] = moved + share[:, None] * off
    return bent


def _nearest(times_s: NDArray[np.float64], stamps_s: NDArray[np.float64]) -> NDArray[np.int64]:
    """(k,) which of the ascending stamps is nearest to each time."""
    after = np.clip(np.searchsorted(stamps_s, times_s), 1, len(stamps_s) - 1)
    before = after - 1
    return np.asarray(np.where(times_s - stamps_s[before] < stamps_s[after] - times_s, before, after))


def apart_from_nearest(times_s: NDArray[np.float64], stamps_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far each time is from the nearest of the ascending stamps [s]; of any shape."""
    return np.asarray(np.abs(times_s - stamps_s[_nearest(times_s, stamps_s)]), np.float64)
