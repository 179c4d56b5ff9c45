"""Make a finished map sharper: match every keyframe anew with all that was seen around it, earlier or later.

Offline, where nothing waits. The front end knew only the past, and loop links were found from worse poses.
Knows a solved pose graph.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from hippomat_core.replaced import replace
from hippomat_core.slam.gtsam_solver import solved_poses
from hippomat_core.slam.mapper import MapperSettings
from hippomat_core.slam.matcher import Search
from hippomat_core.slam.places import link_of, loosest_m, match_at, places_near
from hippomat_core.slam.pose_graph import Links, PoseGraph, joined

Progress = Callable[[int, int], None]  # keyframes done, of how many


@dataclass(frozen=True, slots=True)
class FinalSettings:
    """What the final pass does."""

    rounds: int = 2
    reach_m: float = 3.0
    beside: int = 6
    at_most: int = 5  # places per keyframe
    search: Search = field(default_factory=lambda: Search(0.15, math.radians(3.0)))
    least_score: float = 0.6
    largest_sigma_m: float = 0.04  # as in loop_closing


def final_pass(
    graph: PoseGraph,
    mapper: MapperSettings,
    settings: FinalSettings | None = None,
    progress: Progress | None = None,
) -> PoseGraph:
    """The graph with loop links measured anew and all poses solved for, `rounds` times."""
    settings = settings or FinalSettings()
    total = settings.rounds * len(graph)
    for done in range(settings.rounds):
        found: list[Links] = []
        for keyframe in range(len(graph)):
            found += _links_to(graph, keyframe, mapper, settings)
            if progress:
                progress(done * len(graph) + keyframe + 1, total)
        loops = joined(found)
        graph = replace(graph, loops=loops, poses=solved_poses(graph.poses, graph.steps, loops))
    return graph


def _links_to(
    graph: PoseGraph, keyframe: int, mapper: MapperSettings, settings: FinalSettings
) -> Iterator[Links]:
    others = np.arange(len(graph)) != keyframe
    for place in places_near(graph, keyframe, others, settings.reach_m, settings.at_most):
        found = match_at(graph, place, keyframe, settings.beside, settings.search, mapper)
        if found.score >= settings.least_score and loosest_m(found) <= settings.largest_sigma_m:
            yield link_of(place, keyframe, found)
