"""The only clock of the daemon and its motor guard: the machine's monotonic one, or a simulator's.

A simulator hands out its time in a file of 8-byte words, named by HIPPOMAT_CLOCK: word 0 is now [ns], word
1 + N the last tick that robot N has acted on, so that a world can wait for a daemon on a busy machine. Only
pseudo-terminals have simulated devices behind them: with anything else a simulated clock is refused, for a
clock that stands still would disarm the dead man's switch.
"""

from __future__ import annotations

import mmap
import os
import time
from collections.abc import Sequence

from hippomat_core.errors import HippomatError

VARIABLE = "HIPPOMAT_CLOCK"
WORDS = 65  # now, and one per robot id
PSEUDO_TERMINALS = "/dev/pts/"

_words: memoryview | None = None


def now() -> int:
    """[ns]"""
    return time.monotonic_ns() if _words is None else int(_words[0])


def acted(robot: int, stamp_ns: int) -> None:
    """Robot's daemon has dealt with this tick."""
    if _words is not None and 0 <= robot < WORDS - 1:
        _words[1 + robot] = stamp_ns


def adopt(devices: Sequence[str]) -> bool:
    """Take the simulator's clock if there is one; raises HippomatError where a device is a real one."""
    global _words
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
    return True
