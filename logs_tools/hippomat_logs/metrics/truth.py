"""How far the robots were from where they believed to be, and what they really did: logs against the truth.

ATE: error of the position; RPE: error of the motion over one second (Sturm et al. 2012). Counted at the
robot's ticks, while it knew where it was.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import HippomatError
from hippomat_core.messages import Localized, PoseEstimated
from hippomat_core.slam.poses import seen_from, wrapped
from hippomat_logs.alignment import Alignment
from hippomat_logs.metrics.robot import MIN_STEP_M
from hippomat_logs.metrics.same_motion import Match, Rigid, match
from hippomat_logs.metrics.samples import mean
from hippomat_logs.metrics.truth_files import Floats, Track, Truth
from hippomat_logs.reader import Run

RPE_S = 1.0


@dataclass(frozen=True, slots=True)
class Believed:
    """Where a robot believed to be at its ticks, by the time of its own log."""

    time_ns: NDArray[np.int64]  # (n,)
    poses: Floats  # (n, 3) x, y [m], yaw [rad], map frame
    known: NDArray[np.bool_]  # (n,) whether it knew


@dataclass(frozen=True, slots=True)
class PoseErrors:
    """One robot's, and its true way. nan: nothing to count."""

    robot: int
    errors_m: Floats = field(repr=False)  # (n,) of the position, while it knew its place
    known: float  # share of its ticks since it first did
    yaw_deg: float  # median, without sign
    rpe_m: float  # root mean square over RPE_S
    rpe_deg: float
    driven_m: float  # truly

    @property
    def ate_m(self) -> float:
        """Root mean square."""
        return math.sqrt(float(np.mean(self.errors_m**2))) if len(self.errors_m) else math.nan

    def quantile_m(self, share: float) -> float:
        return float(np.quantile(self.errors_m, share)) if len(self.errors_m) else math.nan


@dataclass(frozen=True, slots=True)
class Nearest:
    """The closest that two robots came: clear_m between their discs, negative where those overlapped."""

    robots: tuple[int, int]
    clear_m: float
    time_s: float  # since the truth began


@dataclass(frozen=True, slots=True)
class TruthMetrics:
    """All of a fleet."""

    match: Match
    robots: list[PoseErrors]
    nearest: Nearest | None  # None: fewer than two robots

    def together(self) -> PoseErrors:
        """All errors as one; yaw and RPE: means over the robots."""
        every = self.robots
        return PoseErrors(
            -1,
            np.concatenate([one.errors_m for one in every]),
            mean(one.known for one in every),
            mean(one.yaw_deg for one in every),
            mean(one.rpe_m for one in every),
            mean(one.rpe_deg for one in every),
            sum(one.driven_m for one in every),
        )


def believed(run: Run) -> Believed:
    """One pass over a log."""
    times, poses, known, sure, first = array("q"), array("d"), bytearray(), True, False
    for record in run.records_in_order((PoseEstimated, Localized)):
        message = record.message
        if isinstance(message, Localized):
            sure = message.phase == "localized"
            first = first or sure
        else:
            times.append(record.log_time_ns)
            poses.extend((message.x_m, message.y_m, message.yaw_rad))
            known.append(sure and (first or message.source == "odometry"))
    table = np.array(poses).reshape(-1, 3)
    table[:, 2] = np.unwrap(table[:, 2])
    return Believed(np.array(times, np.int64), table, np.frombuffer(known, np.bool_))


def against_truth(
    runs: Sequence[Run], alignment: Alignment, truth: Truth, *, map_frame: bool = False
) -> TruthMetrics:
    """map_frame: the truth is in the map's frame. A simulator's truth is, and knows the robots' clocks."""
    told: dict[int, tuple[Run, Believed]] = {}
    for run in runs:
        if run.robot in truth.tracks:
            one = believed(run)
            before = len(told[run.robot][1].time_ns) if run.robot in told else 1
            if len(one.time_ns) > before:  # of a robot that was started twice the longer run counts
                told[run.robot] = run, one
    if not told:
        ids = ", ".join(map(str, sorted(truth.tracks)))
        raise HippomatError(f"--truth has robots {ids}, the logs hold poses of none of them")
    if truth.simulated:
        tracks = {
            k: Track(truth.world_s(k, one.time_ns - run.wall_offset_ns), one.poses)
            for k, (run, one) in told.items()
        }
        found = Match(0.0, math.nan, Rigid())
    else:
        tracks = {
            k: Track(alignment.common_ns_array(run, one.time_ns) / 1e9, one.poses)
            for k, (run, one) in told.items()
        }
        sure = {k: _where(track, told[k][1].known) for k, track in tracks.items()}
        moving = {k: track for k, track in sure.items() if len(track.time_s) > 1}
        found = match(moving, truth.tracks, fit_frame=not map_frame)
    robots = [
        _errors(robot, tracks[robot], told[robot][1].known, truth.tracks[robot], found)
        for robot in sorted(told)
    ]
    radii_m = {robot: run.config.robot.radius_m for robot, (run, _) in told.items()}
    return TruthMetrics(found, robots, _nearest(truth.tracks, radii_m))


def _where(track: Track, mask: NDArray[np.bool_]) -> Track:
    return Track(track.time_s[mask], track.poses[mask])


def _errors(robot: int, track: Track, known: NDArray[np.bool_], truth: Track, found: Match) -> PoseErrors:
    at_s = track.time_s - found.offset_s
    inside = (at_s >= truth.time_s[0]) & (at_s <= truth.time_s[-1])
    at_s, poses, known = at_s[inside], track.poses[inside], known[inside]
    really = found.frame(truth.at(at_s))
    errors_m = np.hypot(*(poses - really)[:, :2].T)[known]
    began = int(known.argmax()) if known.any() else 0
    yaw_rad = wrapped(poses[:, 2] - really[:, 2])[known]
    rpe_m, rpe_rad = _relative(at_s[known], poses[known], really[known])
    return PoseErrors(
        robot,
        errors_m,
        float(known[began:].mean()) if known.any() else 0.0,
        math.degrees(float(np.median(np.abs(yaw_rad)))) if len(yaw_rad) else math.nan,
        rpe_m,
        math.degrees(rpe_rad),
        _driven_m(truth.poses),
    )


def _relative(at_s: Floats, poses: Floats, really: Floats) -> tuple[float, float]:
    """Root mean squares of the error of the motion over RPE_S (m, rad), the motion as seen from its start."""
    turns = not np.isnan(really[:, 2]).any()
    if not turns:  # then in the map's directions
        poses, really = poses * (1.0, 1.0, 0.0), np.nan_to_num(really) * (1.0, 1.0, 0.0)
    ends = np.searchsorted(at_s, at_s + RPE_S - 1e-6)
    starts = np.flatnonzero(ends < len(at_s))
    ends = ends[starts]
    steady = at_s[ends] - at_s[starts] < 1.5 * RPE_S  # no pause in between
    starts, ends = starts[steady], ends[steady]
    if not len(starts):
        return math.nan, math.nan
    off = seen_from(poses[starts], poses[ends]) - seen_from(really[starts], really[ends])
    turned = wrapped(off[:, 2])
    error_rad = math.sqrt(float((turned**2).mean())) if turns else math.nan
    return math.sqrt(float((off[:, :2] ** 2).sum(axis=1).mean())), error_rad


def _driven_m(poses: Floats) -> float:
    """Steps of MIN_STEP_M: cameras tremble too."""
    total_m = 0.0
    x_m, y_m = (float(value) for value in poses[0, :2])
    for px_m, py_m in poses[1:, :2].tolist():
        step_m = math.hypot(px_m - x_m, py_m - y_m)
        if step_m >= MIN_STEP_M:
            total_m, x_m, y_m = total_m + step_m, px_m, py_m
    return total_m


def _nearest(tracks: Mapping[int, Track], radii_m: Mapping[int, float]) -> Nearest | None:
    found: Nearest | None = None
    begun_s = min(track.time_s[0] for track in tracks.values())
    known = sorted(tracks.keys() & radii_m.keys())
    for number, robot in enumerate(known):
        track = tracks[robot]
        for other in known[number + 1 :]:
            there = (track.time_s >= tracks[other].time_s[0]) & (track.time_s <= tracks[other].time_s[-1])
            if not there.any():
                continue
            apart = np.hypot(*(track.poses[there] - tracks[other].at(track.time_s[there]))[:, :2].T)
            least = int(apart.argmin())
            clear_m = float(apart[least]) - radii_m[robot] - radii_m[other]
            if found is None or clear_m < found.clear_m:
                found = Nearest((robot, other), clear_m, float(track.time_s[there][least] - begun_s))
    return found
