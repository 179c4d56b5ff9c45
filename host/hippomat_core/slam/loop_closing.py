"""Notice that the robot is where it was before, and make the map agree. For a worker: slow, and pure.

Each new keyframe is matched with the keyframes around it that are not its own recent past. Matches that fit
become loop links, and all poses are solved for again. Knows a snapshot of the graph; the robot drives on
meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from hippomat_core.replaced import replace
from hippomat_core.slam.gtsam_solver import solved_poses
from hippomat_core.slam.mapper import MapperSettings
from hippomat_core.slam.matcher import Match, Search
from hippomat_core.slam.places import link_of, loosest_m, match_at, places_near
from hippomat_core.slam.pose_graph import Links, PoseGraph, joined
from hippomat_core.slam.ray_cast import no_evidence, with_scans
from hippomat_core.slam.solution import Solution


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """When a match closes a loop."""

    every: int = 20  # keyframes
    reach_m: float = 3.0  # how far the robot may believe to be from where it is
    gap: int = 30  # keyframes nearer in time are matched by the front end
    beside: int = 6  # keyframes before and after a place that a scan is matched with
    at_most: int = 3  # places looked at per keyframe
    search: Search = field(default_factory=lambda: Search(1.5, math.radians(15.0), math.radians(1.0)))
    least_score: float = 0.6
    least_inside: float = 0.6
    largest_sigma_m: float = 0.04  # along a bare corridor a match tells nothing, and says 0.05 or more


def is_due(graph: PoseGraph, settings: LoopSettings | None = None) -> bool:
    """True when enough keyframes came since loops were looked for."""
    return len(graph) - graph.searched >= (settings or LoopSettings()).every


def close_loops(
    graph: PoseGraph, epoch: int, mapper: MapperSettings, settings: LoopSettings | None = None
) -> Solution:
    """The graph with the loops closed that end in keyframes not searched yet; `epoch` is the map's now."""
    settings = settings or LoopSettings()
    found = [graph.loops]
    for second in range(graph.searched, len(graph)):
        found += _loops_to(graph, second, mapper, settings)
    loops = joined(found)
    poses = solved_poses(graph.poses, graph.steps, loops) if len(loops) else graph.poses
    return solution_of(replace(graph, poses=poses, loops=loops, searched=len(graph)), epoch + 1, mapper)


def solution_of(graph: PoseGraph, epoch: int, mapper: MapperSettings) -> Solution:
    """The graph as it is, with all its keyframes cast into a new map."""
    scans = [frame.points for frame in graph.keyframes]
    evidence = with_scans(no_evidence(mapper.resolution_m), scans, graph.poses, mapper.lidar)
    return Solution(epoch, graph.poses, graph.loops, graph.searched, evidence)


def _loops_to(
    graph: PoseGraph, keyframe: int, mapper: MapperSettings, settings: LoopSettings
) -> Iterator[Links]:
    """Links from earlier places to the keyframe."""
    past = np.arange(len(graph)) < keyframe - settings.gap
    for place in places_near(graph, keyframe, past, settings.reach_m, settings.at_most):
        found = match_at(graph, place, keyframe, settings.beside, settings.search, mapper)
        if _closes(found, settings):
            yield link_of(place, keyframe, found)


def _closes(found: Match, settings: LoopSettings) -> bool:
    """True where the scan fits well, mostly lies where something is known, and cannot slide along it."""
    fits = found.score >= settings.least_score and found.inside >= settings.least_inside
    return fits and loosest_m(found) <= settings.largest_sigma_m
