"""Map a log as a robot would, scan by scan, then sharpen the map; and measure what each step costs.

Loops are closed here in between, not beside, but as late as on a robot: a solution enters LAG keyframes after
its snapshot was taken. So a run gives the same map every time. Times are the thread's processor time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hippomat_core.slam.final_pass import final_pass
from hippomat_core.slam.loop_closing import close_loops, is_due, solution_of
from hippomat_core.slam.mapper import Mapper, MapperSettings, Outcome, empty_mapper
from hippomat_core.slam.pose_graph import PoseGraph
from hippomat_core.slam.poses import composed
from hippomat_core.slam.ray_cast import Evidence
from hippomat_sim.maps.carmen import CarmenScan

# The robots of these logs: their odometry slips more than ours is believed to. The same for every log.
SETTINGS = MapperSettings(slip=0.3, slip_m=0.05, slip_rad=math.radians(3.0))
LAG = 5  # keyframes that a robot makes while its worker closes loops
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


@dataclass(frozen=True, slots=True, eq=False)
class SlamRun:
    """What a log became."""

    online: NDArray[np.float64]  # (n, 3) pose of every scan when the log ended, before the final pass
    final: NDArray[np.float64]  # (n, 3) after it
    evidence: Evidence  # the final map
    graph: PoseGraph  # the final one
    unmatched: int  # scans whose pose is odometry alone
    costs: Costs


def run_slam(scans: Sequence[CarmenScan], with_odometry: bool, progress: Progress) -> SlamRun:
    """Maps the scans; with_odometry: their poses are odometry, otherwise they are not looked at."""
    costs = Costs()
    mapper, outcomes = _front_end(scans, with_odometry, costs, progress)
    settings = mapper.settings
    mapper = mapper.with_solution(close_loops(mapper.graph, mapper.epoch, settings))
    graph = final_pass(mapper.graph, settings, None, lambda done, of: progress("final pass", done, of))
    return SlamRun(
        _poses_of(mapper.graph, outcomes),
        _poses_of(graph, outcomes),
        solution_of(graph, mapper.epoch + 1, settings).evidence,
        graph,
        sum(not outcome.matched for outcome in outcomes),
        costs,
    )


def _front_end(
    scans: Sequence[CarmenScan], with_odometry: bool, costs: Costs, progress: Progress
) -> tuple[Mapper, list[Outcome]]:
    mapper, outcomes = empty_mapper(SETTINGS), []
    solution, keyframes = None, 0  # the solution that enters when there are so many keyframes
    for number, scan in enumerate(scans, 1):
        odometry = scan.pose if with_odometry else None
        with _measured(costs.scan_ms):
            mapper, outcome = mapper.with_scan(scan.points, odometry, round(scan.stamp_s * 1e9))
        outcomes.append(outcome)
        if solution and len(mapper.graph) >= keyframes:
            with _measured(costs.solution_ms):
                mapper = mapper.with_solution(solution)
            solution = None
        if not solution and is_due(mapper.graph):
            with _measured(costs.worker_ms):
                solution = close_loops(mapper.graph, mapper.epoch, mapper.settings)
            keyframes = len(mapper.graph) + LAG
        progress("mapping", number, len(scans))
    return mapper, outcomes


@contextmanager
def _measured(costs_ms: list[float]) -> Iterator[None]:
    begun_s = time.thread_time()
    yield
    costs_ms.append(1e3 * (time.thread_time() - begun_s))


def _poses_of(graph: PoseGraph, outcomes: Sequence[Outcome]) -> NDArray[np.float64]:
    """(n, 3) of every scan: it hangs on its keyframe."""
    keyframes = [outcome.keyframe for outcome in outcomes]
    return composed(graph.poses[keyframes], np.array([outcome.offset for outcome in outcomes]))
