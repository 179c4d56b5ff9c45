"""A finished map from recorded scans: the robot's front end scan by scan, loops closed in between, sharpened.

Loops are closed here in between, not beside, but as late as on a robot: a solution enters LAG keyframes after
its snapshot was taken. So the same scans give the same map every time. Knows no log and no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.slam.final_pass import Progress, final_pass
from hippomat_core.slam.loop_closing import close_loops, is_due, solution_of
from hippomat_core.slam.mapper import Mapper, MapperSettings, Outcome, empty_mapper
from hippomat_core.slam.pose_graph import PoseGraph
from hippomat_core.slam.poses import composed
from hippomat_core.slam.ray_cast import Evidence

LAG = 5  # keyframes that a robot makes while its worker closes loops
SCAN, SOLUTION, WORKER = "scan", "solution", "worker"  # the robot waits for the first two
Watch = Callable[[str], AbstractContextManager[None]]  # entered around each of them

# points (n, 2) [m] in the base frame; pose (3,) in the odom frame, None: no odometry; stamp [ns]
Sweep = tuple[NDArray[np.float64], NDArray[np.float64] | None, int]


@dataclass(frozen=True, slots=True, eq=False)
class FinishedMap:
    """What the scans became."""

    online: NDArray[np.float64]  # (n, 3) pose of every scan when the last one was in, before the final pass
    final: NDArray[np.float64]  # (n, 3) after it
    evidence: Evidence  # the final map
    graph: PoseGraph  # the final one
    unmatched: int  # scans whose pose is odometry alone


def finished_map(
    sweeps: Iterable[Sweep],
    settings: MapperSettings,
    start: NDArray[np.float64] | None = None,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> FinishedMap:
    """Needs GTSAM: raises HippomatError without it.

    start: (3,) pose of the first sweep in the map; None: the map begins there   progress: of the final pass
    """
    mapper = empty_mapper(settings) if start is None else empty_mapper(settings, start)
    mapper, outcomes = _front_end(mapper, sweeps, watch or _unwatched)
    mapper = mapper.with_solution(close_loops(mapper.graph, mapper.epoch, settings))
    graph = final_pass(mapper.graph, settings, None, progress)
    return FinishedMap(
        _poses_of(mapper.graph, outcomes),
        _poses_of(graph, outcomes),
        solution_of(graph, mapper.epoch + 1, settings).evidence,
        graph,
        sum(not outcome.matched for outcome in outcomes),
    )


def _unwatched(_: str) -> AbstractContextManager[None]:
    return nullcontext()


def _front_end(mapper: Mapper, sweeps: Iterable[Sweep], watch: Watch) -> tuple[Mapper, list[Outcome]]:
    outcomes = []
    solution, keyframes = None, 0  # the solution that enters when there are so many keyframes
    for points, odometry, stamp_ns in sweeps:
        with watch(SCAN):
            mapper, outcome = mapper.with_scan(points, odometry, stamp_ns)
        outcomes.append(outcome)
        if solution and len(mapper.graph) >= keyframes:
            with watch(SOLUTION):
                mapper = mapper.with_solution(solution)
            solution = None
        if not solution and is_due(mapper.graph):
            with watch(WORKER):
                solution = close_loops(mapper.graph, mapper.epoch, mapper.settings)
            keyframes = len(mapper.graph) + LAG
    return mapper, outcomes


def _poses_of(graph: PoseGraph, outcomes: Sequence[Outcome]) -> NDArray[np.float64]:
    """(n, 3) of every scan: it hangs on its keyframe."""
    keyframes = [outcome.keyframe for outcome in outcomes]
    return composed(graph.poses[keyframes], np.array([outcome.offset for outcome in outcomes]))
