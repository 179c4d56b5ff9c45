"""Build a map while finding one's place in it: the front end, which answers every scan at once.

A value: `with_scan` gives the next mapper and leaves this one as it was. Each scan is matched with a field of
the last keyframes; a scan far enough from the last keyframe becomes the next one. Loops are closed elsewhere
(loop_closing) on a snapshot, and `with_solution` takes the result: nothing here takes longer than a match
and a field. Knows no clock and no thread.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.replaced import replace
from hippomat_core.slam.likelihood_field import SIGMA_M, LikelihoodField, field_of_points
from hippomat_core.slam.matcher import Search, Trust, match
from hippomat_core.slam.pose_graph import EMPTY_GRAPH, Keyframe, PoseGraph
from hippomat_core.slam.poses import composed, placed_together, seen_from, turned_information
from hippomat_core.slam.ray_cast import Evidence, Lidar, no_evidence, with_scans
from hippomat_core.slam.solution import Solution

# What a step without odometry is worth before any match: it is no longer than a few metres.
NO_ODOMETRY = np.diag(Trust(2.0, 2.0).information)


@dataclass(frozen=True, slots=True)
class MapperSettings:
    """The defaults suit lidars of 6 m to 80 m indoors."""

    keyframe_m: float = 0.25
    keyframe_rad: float = math.radians(10.0)
    window: int = 25  # keyframes that a scan is matched with
    resolution_m: float = 0.05
    sigma_m: float = SIGMA_M
    search: Search = field(default_factory=lambda: Search(0.5, math.radians(25.0)))
    # Without odometry: wide enough for logs that were thinned to a scan a metre or a quarter turn.
    blind_search: Search = field(default_factory=lambda: Search(1.3, math.radians(90.0), math.radians(1.0)))
    least_score: float = 0.4  # below it a match is taken for none
    slip: float = (
        0.1  # odometry is off by this share of the way and by that of the turn, and by no less than:
    )
    turn_slip: float = 0.3  # wheels that skid turn less than they count
    slip_m: float = 0.02
    slip_rad: float = math.radians(2.0)
    lidar: Lidar = field(default_factory=Lidar)

    def trust(self, moved: NDArray[np.float64]) -> Trust:
        """How far odometry is believed about a motion (3,) between two scans."""
        moved_m, turned_rad = math.hypot(moved[0], moved[1]), abs(float(moved[2]))
        return Trust(self.slip_m + self.slip * moved_m, self.slip_rad + self.turn_slip * turned_rad)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What one scan led to."""

    pose: NDArray[np.float64]  # (3,) x [m], y [m], yaw [rad] in the map frame, as known now
    score: float  # of the match, 0..1; 1 for the first scan
    matched: bool  # False: the pose is odometry from the one before
    keyframe: int  # the pose hangs on this keyframe, and moves with it when loops are closed
    offset: NDArray[np.float64]  # (3,) the pose in the keyframe's frame
    is_keyframe: bool


@dataclass(frozen=True, slots=True, eq=False)
class Mapper:
    """The map frame is that of the first scan, or of the pose that empty_mapper() was given."""

    settings: MapperSettings
    graph: PoseGraph
    evidence: Evidence
    pose: NDArray[np.float64]  # (3,) of the last scan
    odometry: NDArray[np.float64] | None  # (3,) of the last scan, in the odometry's frame
    field: LikelihoodField | None = None  # of the last keyframes; None before the first
    epoch: int = 0  # of the map; goes up when places in it move

    def with_scan(
        self, points: NDArray[np.float64], odometry: NDArray[np.float64] | None, stamp_ns: int
    ) -> tuple[Mapper, Outcome]:
        """The mapper after a scan; points (n, 2) [m] in the base frame.

        odometry: (3,) pose in the odometry's frame when the scan was taken; None: unknown, search farther
        """
        if self.field is None:
            first = self._with_keyframe(Keyframe(stamp_ns, points), self.pose, NO_ODOMETRY)
            first = replace(first, odometry=odometry)
            return first, Outcome(self.pose, 1.0, True, 0, np.zeros(3), True)
        guess, search, trust = self._guess(odometry)
        found = match(self.field, points, guess, search, trust)
        matched = found.score >= self.settings.least_score
        pose = found.pose if matched else guess
        last = len(self.graph) - 1
        offset = seen_from(self.graph.poses[last], pose)
        if not self._is_far(offset):
            moved = replace(self, pose=pose, odometry=odometry)
            return moved, Outcome(pose, found.score, matched, last, offset, False)
        step = np.diag(trust.information) if trust else NO_ODOMETRY
        step = step + turned_information(found.information, pose[2]) if matched else step
        grown = self._with_keyframe(Keyframe(stamp_ns, points), pose, step)
        grown = replace(grown, pose=pose, odometry=odometry)
        return grown, Outcome(pose, found.score, matched, last + 1, np.zeros(3), True)

    def with_solution(self, solution: Solution) -> Mapper:
        """The mapper with loops closed: all poses move at once, those of keyframes made since with the last.

        A solution older than the map's epoch answers a question that nobody has any more: it changes nothing.
        """
        known = len(solution.poses)
        if solution.epoch <= self.epoch or known == 0 or known > len(self.graph):
            return self
        since = seen_from(self.graph.poses[known - 1], self.graph.poses[known:])
        last = solution.poses[-1]
        poses = np.concatenate([solution.poses, composed(last, since)])
        graph = replace(self.graph, poses=poses, loops=solution.loops, searched=solution.searched)
        scans = [frame.points for frame in graph.keyframes[known:]]
        return replace(
            self,
            graph=graph,
            evidence=with_scans(solution.evidence, scans, poses[known:], self.settings.lidar),
            pose=composed(last, seen_from(self.graph.poses[known - 1], self.pose)),
            field=_local_field(graph, self.settings),
            epoch=solution.epoch,
        )

    def grid(self) -> OccupancyGrid:
        """The map as known now."""
        return self.evidence.grid()

    def _guess(
        self, odometry: NDArray[np.float64] | None
    ) -> tuple[NDArray[np.float64], Search, Trust | None]:
        if odometry is None or self.odometry is None:
            return self.pose, self.settings.blind_search, None
        moved = seen_from(self.odometry, odometry)
        return composed(self.pose, moved), self.settings.search, self.settings.trust(moved)

    def _is_far(self, offset: NDArray[np.float64]) -> bool:
        moved_m = math.hypot(offset[0], offset[1])
        return moved_m >= self.settings.keyframe_m or abs(offset[2]) >= self.settings.keyframe_rad

    def _with_keyframe(
        self, frame: Keyframe, pose: NDArray[np.float64], information: NDArray[np.float64]
    ) -> Mapper:
        """With one more keyframe at `pose`, and a link to it from the last one, known that well (3, 3)."""
        graph, count = self.graph, len(self.graph)
        steps = graph.steps
        if count:
            steps = steps.and_link(count - 1, count, seen_from(graph.poses[-1], pose), information)
        poses = np.concatenate([graph.poses, pose[None, :]])
        graph = replace(graph, keyframes=(*graph.keyframes, frame), poses=poses, steps=steps)
        return replace(
            self,
            graph=graph,
            evidence=with_scans(self.evidence, [frame.points], pose[None, :], self.settings.lidar),
            field=_local_field(graph, self.settings),
        )


def empty_mapper(settings: MapperSettings | None = None, pose: NDArray[np.float64] | None = None) -> Mapper:
    """A mapper that has seen nothing; its first scan is taken at `pose` (3,) of the map frame."""
    settings = settings or MapperSettings()
    start = np.zeros(3) if pose is None else pose
    return Mapper(settings, EMPTY_GRAPH, no_evidence(settings.resolution_m), start, None)


def _local_field(graph: PoseGraph, settings: MapperSettings) -> LikelihoodField:
    """The field of the last keyframes, in the map frame."""
    first = max(len(graph) - settings.window, 0)
    return surroundings(graph.keyframes[first:], graph.poses[first:], settings)


def surroundings(
    keyframes: Sequence[Keyframe], poses: NDArray[np.float64], settings: MapperSettings
) -> LikelihoodField:
    """The field of these keyframes at these poses (k, 3), in the poses' frame; far returns are left out."""
    clouds = [near(frame.points, settings.lidar.max_range_m) for frame in keyframes]
    return field_of_points(placed_together(clouds, poses), settings.resolution_m, settings.sigma_m)


def near(points: NDArray[np.float64], reach_m: float) -> NDArray[np.float64]:
    """Those of the points (n, 2) that are within reach."""
    near_by: NDArray[np.float64] = points[(points * points).sum(axis=1) <= reach_m**2]
    return near_by
