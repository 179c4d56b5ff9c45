"""Mapping as the robot's events drive it: every sweep goes into the map, and loops are closed outside.

The core asks for it (LoopsDue) and gets the answer as an event (LoopsClosed), so that a replay feeds the
recorded answer. Somebody moves the robot meanwhile: without a finished map it does not drive. How a map is
made, is slam/mapper.py's affair.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import Config
from hippomat_core.messages import Effect, Localized, LoopsClosed, LoopsDue, MapDrawn, ScanReceived
from hippomat_core.replaced import replace
from hippomat_core.slam.loop_closing import is_due
from hippomat_core.slam.mapper import Mapper, MapperSettings, Outcome, empty_mapper
from hippomat_core.slam.pose2 import IDENTITY, Pose, compose, inverse
from hippomat_core.slam.pose_graph import Links
from hippomat_core.slam.ray_cast import Evidence, Lidar
from hippomat_core.slam.solution import Solution

DRAWN_EVERY = 20  # keyframes


@dataclass(frozen=True, slots=True, eq=False)
class Charting:
    """A map in the making, and where the odom frame lies in it."""

    mapper: Mapper
    map_from_odom: Pose = IDENTITY
    asked: bool = False  # for loops to be closed, and not answered yet


def mapper_settings(config: Config) -> MapperSettings:
    """The robot's own lidar in the mapper's defaults."""
    lidar = config.lidar
    return MapperSettings(lidar=Lidar(lidar.x_m, lidar.y_m, lidar.max_range_m))


def first_charting(config: Config) -> Charting:
    """Nothing was seen yet; the map's frame is that of the start pose."""
    robot = config.robot
    start = np.array([robot.start_x_m, robot.start_y_m, robot.start_yaw_rad])
    return Charting(empty_mapper(mapper_settings(config), start))


def with_sweep(
    charting: Charting,
    event: ScanReceived,
    seen: tuple[NDArray[np.float64], Pose, int],
    effects: list[Effect],
) -> Charting:
    """After one more sweep. seen: points (n, 2) [m], base frame; pose, odom frame; the pose's stamp."""
    points, odom, at_ns = seen
    if not len(points):
        return charting
    mapper, outcome = charting.mapper.with_scan(points, np.array(odom), event.stamp_ns)
    x, y, yaw = outcome.pose.tolist()
    charting = replace(charting, mapper=mapper, map_from_odom=compose((x, y, yaw), inverse(odom)))
    effects.append(_record(outcome, at_ns))
    keyframes = len(mapper.graph)
    if not outcome.is_keyframe:
        return charting
    if keyframes % DRAWN_EVERY == 1:
        effects.append(drawn(mapper))
    if is_due(mapper.graph) and not charting.asked:
        effects.append(LoopsDue(mapper.epoch, keyframes))
        return replace(charting, asked=True)
    return charting


def with_answer(charting: Charting, event: LoopsClosed, effects: list[Effect]) -> Charting:
    """Loops are closed: all poses move at once, ours with them. An answer without poses changes nothing."""
    charting = replace(charting, asked=False)
    if not len(event.poses):
        return charting
    before = charting.mapper
    mapper = before.with_solution(_solution(event))
    if mapper is before:
        return charting
    moved = compose(_pose(mapper), inverse(_pose(before)))
    effects.append(drawn(mapper))
    return replace(charting, mapper=mapper, map_from_odom=compose(moved, charting.map_from_odom))


def drawn(mapper: Mapper) -> MapDrawn:
    """The map as it is now."""
    grid = mapper.grid()
    cells = np.ascontiguousarray(grid.cells).ravel()
    place = (grid.resolution_m, grid.origin_x_m, grid.origin_y_m)
    return MapDrawn(mapper.epoch, len(mapper.graph), grid.width, grid.height, *place, cells)


def answer_of(solution: Solution, stamp_ns: int) -> LoopsClosed:
    """The solver's answer as an event."""
    loops, evidence = solution.loops, solution.evidence
    height, width = evidence.log_odds.shape
    return LoopsClosed(
        stamp_ns,
        solution.epoch,
        solution.searched,
        solution.poses.ravel(),
        loops.first,
        loops.second,
        loops.motion.ravel(),
        loops.information.ravel(),
        evidence.resolution_m,
        evidence.left,
        evidence.low,
        width,
        height,
        np.ascontiguousarray(evidence.log_odds).ravel(),
        "",
    )


def failed_answer(text: str, stamp_ns: int) -> LoopsClosed:
    """The solver could not answer."""
    none, whole = np.zeros(0), np.zeros(0, np.int32)
    return LoopsClosed(stamp_ns, 0, 0, none, whole, whole, none, none, 0.0, 0, 0, 0, 0, whole, text)


def _solution(event: LoopsClosed) -> Solution:
    links = Links(
        event.loop_first,
        event.loop_second,
        event.loop_motion.reshape(-1, 3),
        event.loop_information.reshape(-1, 3, 3),
    )
    log_odds = event.log_odds.reshape(event.height, event.width)
    evidence = Evidence(log_odds, event.resolution_m, event.left, event.low)
    return Solution(event.epoch, event.poses.reshape(-1, 3), links, event.searched, evidence)


def _pose(mapper: Mapper) -> Pose:
    x, y, yaw = mapper.pose.tolist()
    return x, y, yaw


def _record(outcome: Outcome, at_ns: int) -> Localized:
    x, y, yaw = outcome.pose.tolist()
    phase = "mapping" if outcome.matched else "unmatched"
    return Localized(at_ns, phase, x, y, yaw, outcome.score, np.zeros(9), 0, 0, 0, 0)
