"""Map a log as a robot would, and measure what each step costs. Times are the thread's processor time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from hippomat_core.slam.mapper import MapperSettings
from hippomat_core.slam.offline import SCAN, SOLUTION, WORKER, FinishedMap, Sweep, finished_map
from hippomat_sim.maps.carmen import CarmenScan

# The robots of these logs: their odometry slips more than ours is believed to. The same for every log.
SETTINGS = MapperSettings(slip=0.3, slip_m=0.05, slip_rad=math.radians(3.0))
Progress = Callable[[str, int, int], None]  # what is being done, how much of it, of how much


@dataclass(slots=True)
class Costs:
    """Milliseconds of one core."""

    scan_ms: list[float] = field(default_factory=list)  # each scan in the front end
    solution_ms: list[float] = field(default_factory=list)  # each solution taken over
    worker_ms: list[float] = field(default_factory=list)  # each search for loops; nobody waits for it

    @property
    def longest_ms(self) -> float:
        """Of all that the robot waits for."""
        return max([*self.scan_ms, *self.solution_ms])

    @contextmanager
    def measured(self, step: str) -> Iterator[None]:
        """Adds what the body costs to that step's list."""
        times_ms = {SCAN: self.scan_ms, SOLUTION: self.solution_ms, WORKER: self.worker_ms}[step]
        begun_s = time.thread_time()
        yield
        times_ms.append(1e3 * (time.thread_time() - begun_s))


@dataclass(frozen=True, slots=True)
class SlamRun:
    """What a log became, and at what cost."""

    map: FinishedMap
    costs: Costs


def run_slam(scans: Sequence[CarmenScan], with_odometry: bool, progress: Progress) -> SlamRun:
    """Maps the scans; with_odometry: their poses are odometry, otherwise they are not looked at."""
    costs = Costs()

    def sweeps() -> Iterator[Sweep]:
        for number, scan in enumerate(scans, 1):
            yield scan.points, scan.pose if with_odometry else None, round(scan.stamp_s * 1e9)
            progress("mapping", number, len(scans))

    finished = finished_map(
        sweeps(), SETTINGS, None, lambda done, of: progress("final pass", done, of), costs.measured
    )
    return SlamRun(finished, costs)
