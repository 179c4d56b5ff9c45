"""The only clock of the daemon and its motor guard: the machine's monotonic one, or a simulator's.

A simulator hands out its time in a file of 8-byte words, named by HIPPOMAT_CLOCK: word 0 is now [ns], word
1 + N the last tick that robot N has acted on, so that a world can wait for a daemon on a busy machine. Only
pseudo-terminals have simulated devices behind them: with anything else a simulated clock is refused, for a
clock that stands still would disarm the dead man's switch. HIPPOMAT_CLOCK_ERROR makes a simulated host's
clock wrong: nanoseconds ahead, drift in parts per 10^9, and nanoseconds that the wall clock is ahead on top.
"""

from __future__ import annotations

import mmap
import os
import time
from collections.abc import Sequence

from hippomat_core.errors import HippomatError

VARIABLE = "HIPPOMAT_CLOCK"
ERROR_VARIABLE = "HIPPOMAT_CLOCK_ERROR"
WORDS = 65  # now, and one per robot id
PSEUDO_TERMINALS = "/dev/pts/"

_words: memoryview | None = None
_ahead_ns, _drift_ppb, _wall_ahead_ns = 0, 0, 0  # of a simulated host


def now() -> int:
    """[ns]"""
    if _words is None:
        return time.monotonic_ns()
    world_ns = int(_words[0])
    return world_ns + world_ns * _drift_ppb // 10**9 + _ahead_ns


def wall_ns() -> int:
    """[ns] since 1970, as this host believes."""
    return time.time_ns() + _wall_ahead_ns


def acted(robot: int, stamp_ns: int) -> None:
    """Robot's daemon has dealt with this tick."""
    if _words is not None and 0 <= robot < WORDS - 1:
        _words[1 + robot] = (stamp_ns - _ahead_ns) * 10**9 // (10**9 + _drift_ppb)


def adopt(devices: Sequence[str]) -> bool:
    """Take the simulator's clock if there is one; raises HippomatError where a device is a real one."""
    global _words, _ahead_ns, _drift_ppb, _wall_ahead_ns
    path = os.environ.get(VARIABLE, "")
    if not path:
        return False
    for device in devices:
        if not os.path.realpath(device).startswith(PSEUDO_TERMINALS):
            raise HippomatError(
                f"{VARIABLE} is set, but {device} is no simulated device: unset it, robots have clocks"
            )
    try:
        with open(path, "r+b") as file:
            _words = memoryview(mmap.mmap(file.fileno(), 8 * WORDS)).cast("q")
    except (OSError, ValueError) as error:
        raise HippomatError(f"{VARIABLE}={path}: is no simulator's clock ({error}): unset it") from None
    text = os.environ.get(ERROR_VARIABLE, "0,0,0")
    try:
        _ahead_ns, _drift_ppb, _wall_ahead_ns = (int(word) for word in text.split(","))
    except ValueError:
        raise HippomatError(
            f"{ERROR_VARIABLE}={text}: is not AHEAD_NS,DRIFT_PPB,WALL_AHEAD_NS: unset it"
        ) from None
    return True
