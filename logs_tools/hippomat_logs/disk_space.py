"""Is there room for the run, and what is shed when room runs low? Decides levels; knows no records.

KEEP_ALL: everything is recorded. NO_VIEWS: no standard ROS topics, which can be computed again from the
records. NO_BULK: no scans, grids and lidar bytes either (records.is_bulk); decisions and alarms to the last.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from hippomat_core.config import LogConfig
from hippomat_core.errors import HippomatError

KEEP_ALL, NO_VIEWS, NO_BULK = 0, 1, 2
HYSTERESIS = 1.25  # so much more room than was too little, and a level is left again
MIB = 1 << 20
FreeBytes = Callable[[], int]


def free_bytes(directory: Path) -> int:
    """What an ordinary user can still write on the disk of `directory`."""
    space = os.statvfs(directory)
    return space.f_bavail * space.f_frsize


class DiskWatch:
    """Ask level() now and then; it never raises."""

    def __init__(self, low_mib: int, free: FreeBytes) -> None:
        self._free = free
        self._limits = {NO_VIEWS: low_mib * MIB, NO_BULK: low_mib * MIB // 2}
        self._level = KEEP_ALL
        self._left = 0

    def level(self) -> int:
        try:
            self._left = self._free()
        except OSError:  # a disk that is gone fails its next write, which is dealt with there
            return self._level
        while self._level < NO_BULK and self._left < self._limits[self._level + 1]:
            self._level += 1
        while self._level > KEEP_ALL and self._left > HYSTERESIS * self._limits[self._level]:
            self._level -= 1
        return self._level

    @property
    def problem(self) -> str:
        """What is not recorded because of it, "" if everything is."""
        if self._level == KEEP_ALL:
            return ""
        shed = "views (/scan, /map ...)" if self._level == NO_VIEWS else "scans, grids and views"
        return f"disk low, {self._left // MIB} MiB free: {shed} are not recorded, decisions are"


def check_forecast(directory: Path, log: LogConfig, free: FreeBytes) -> None:
    """Refuse a run that the disk cannot hold; raises HippomatError with the three ways out."""
    need_mib = log.expected_min * log.rate_mib_per_min
    have_mib = free() / MIB
    if need_mib > have_mib:
        raise HippomatError(
            f"the log of {log.expected_min:g} min ({log.rate_mib_per_min:g} MiB/min) needs "
            f"{need_mib:,.0f} MiB, but {directory} has {have_mib:,.0f} MiB free: make room, "
            "choose another disk (--log DIR), or lower [log] expected_min"
        )
