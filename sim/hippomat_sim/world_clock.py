"""The time of a simulated world, as its daemons see it: never ahead of what the machine can do.

Real time sets the pace. On a busy machine the world slows down instead of jumping: it moves in small steps,
and waits for a daemon whose last tick is too long ago. So what a run shows of the robots does not hang on the
load. The file's layout is hippomat_host/clock.py's.
"""

from __future__ import annotations

import mmap
import time
from collections.abc import Sequence
from pathlib import Path

VARIABLE = "HIPPOMAT_CLOCK"
WORDS = 65
STEP_US = 40_000  # at most, from one look at the clock to the next
AHEAD_US = 100_000  # of the slowest daemon's last tick
PATIENCE_S = 20.0  # a daemon that does nothing for so long is not waited for


class WorldClock:
    """Microseconds since the world began; close() when done."""

    def __init__(self, path: Path, robots: int) -> None:
        path.write_bytes(bytes(8 * WORDS))
        self.path, self._robots = path, robots
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), 8 * WORDS)
        self._words = memoryview(self._map).cast("q")
        self.now_us = 0
        self._slowest_us = 0
        self.begin()

    def begin(self) -> None:
        """The world begins now."""
        self.start_ns = time.monotonic_ns()  # stamps look like those of a real run
        self._seen_ns = self._stuck_ns = self.start_ns  # stuck: since when the slowest has not moved
        self._words[0] = self.start_ns

    @property
    def real_s(self) -> float:
        """Real time since the world began."""
        return (time.monotonic_ns() - self.start_ns) / 1e9

    def move(self, waited_for: Sequence[int]) -> int:
        """Time goes on, as far as it may; now [us]. waited_for: the robots whose daemons are alive."""
        seen_ns = time.monotonic_ns()
        passed_us = (seen_ns - self._seen_ns) // 1000
        self._seen_ns += passed_us * 1000
        wanted_us = self.now_us + min(passed_us, STEP_US)
        self.now_us = min(wanted_us, max(self._limit_us(waited_for, seen_ns), self.now_us))
        self._words[0] = self.start_ns + self.now_us * 1000
        return self.now_us

    def _limit_us(self, robots: Sequence[int], seen_ns: int) -> int:
        acted = [self._words[1 + robot] for robot in robots if self._words[1 + robot]]
        if not acted:
            return self.now_us + STEP_US
        slowest_us = (min(acted) - self.start_ns) // 1000
        if slowest_us != self._slowest_us:
            self._slowest_us, self._stuck_ns = slowest_us, seen_ns
        stuck = seen_ns - self._stuck_ns > PATIENCE_S * 1e9
        return self.now_us + STEP_US if stuck else slowest_us + AHEAD_US

    def close(self) -> None:
        """The file stays readable for daemons that still end."""
        self._words.release()
        self._map.close()
