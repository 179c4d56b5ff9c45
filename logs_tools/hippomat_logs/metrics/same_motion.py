"""How the clock and the frame of a motion-capture system stand to the logs': found by the motion itself.

First the speeds are correlated over every offset that leaves half of the shorter recording (a shift of frames
does not matter to them); then the offset is refined where the ways fit best, each time with the best rigid
transform between the frames (Umeyama 1991, without scale; all robots together). An estimate that always lags
by the same time looks like a clock that is off by it. Knows tracks, not files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import correlate, correlation_lags

from hippomat_core.errors import HippomatError
from hippomat_logs.metrics.truth_files import Floats, Track

STEP_S = 0.1  # of the speeds that are correlated
SPEED_OVER_S = 0.5
MIN_CORRELATION = 0.5
MIN_OVERLAP = 0.5
REFINE_S = 2.0 * STEP_S
FIT_POINTS = 2000  # of one robot, for the refinement
MIN_SPREAD_M = 0.1  # with less motion no frame can be found


@dataclass(frozen=True, slots=True)
class Rigid:
    """Turns by yaw_rad, then shifts: p' = R p + (x_m, y_m)."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0

    def __call__(self, poses: Floats) -> Floats:
        """(n, 3) -> (n, 3)."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        x, y = poses[:, 0], poses[:, 1]
        return np.column_stack(
            [c * x - s * y + self.x_m, s * x + c * y + self.y_m, poses[:, 2] + self.yaw_rad]
        )


@dataclass(frozen=True, slots=True)
class Match:
    """log time = truth time + offset_s; map pose = frame(truth pose)."""

    offset_s: float
    correlation: float  # of the speeds, at most 1; nan: nothing was correlated
    frame: Rigid


def match(told: Mapping[int, Track], true: Mapping[int, Track], *, fit_frame: bool) -> Match:
    """told: what robots believed, on the logs' clock. Raises HippomatError where the motion is another."""
    robots = sorted(told.keys() & true.keys())
    coarse_s, correlation = _by_speeds({k: told[k] for k in robots}, {k: true[k] for k in robots})
    if correlation < MIN_CORRELATION:
        raise HippomatError(
            f"the motion in --truth is not that in the logs (best correlation of the speeds "
            f"{correlation:.2f}, needed {MIN_CORRELATION}): is it of this run, are its robots' ids right?"
        )

    def left_m(more_s: float) -> float:  # than coarse_s: the search's tolerance is relative to its argument
        believed, really = _pairs(told, true, robots, coarse_s + more_s)
        return _rms_m(believed, fit_rigid(really, believed)(really) if fit_frame else really)

    finer = minimize_scalar(
        left_m, bracket=None, bounds=(-REFINE_S, REFINE_S), args=(), method="bounded", options={"xatol": 1e-4}
    )
    offset_s = coarse_s + float(finer.x)
    believed, really = _pairs(told, true, robots, offset_s)
    return Match(offset_s, correlation, fit_rigid(really, believed) if fit_frame else Rigid())


def fit_rigid(source: Floats, target: Floats) -> Rigid:
    """The rigid transform of the plane that takes source (n, 2+) to target with least squares."""
    if len(source) < 2 or float(np.ptp(target[:, :2], axis=0).max(initial=0.0)) < MIN_SPREAD_M:
        raise HippomatError("the robots hardly moved: give --truth-frame map if the frames are one")
    from_m, to_m = source[:, :2].mean(axis=0), target[:, :2].mean(axis=0)
    a, b = source[:, :2] - from_m, target[:, :2] - to_m
    yaw_rad = math.atan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a * b).sum()))
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    x_m = to_m[0] - (c * from_m[0] - s * from_m[1])
    y_m = to_m[1] - (s * from_m[0] + c * from_m[1])
    return Rigid(float(x_m), float(y_m), yaw_rad)


def _pairs(
    told: Mapping[int, Track], true: Mapping[int, Track], robots: list[int], offset_s: float
) -> tuple[Floats, Floats]:
    """(n, 3) believed and (n, 3) true poses at the same moments, of all robots."""
    believed: list[Floats] = [np.empty((0, 3))]
    really: list[Floats] = [np.empty((0, 3))]
    for robot in robots:
        track, truth = told[robot], true[robot]
        at_s = track.time_s - offset_s
        inside = np.flatnonzero((at_s >= truth.time_s[0]) & (at_s <= truth.time_s[-1]))
        inside = inside[:: max(1, len(inside) // FIT_POINTS)]
        believed.append(track.poses[inside])
        really.append(truth.at(at_s[inside]))
    return np.concatenate(believed), np.concatenate(really)


def _rms_m(one: Floats, other: Floats) -> float:
    off = one[:, :2] - other[:, :2]
    return math.sqrt(float((off * off).sum(axis=1).mean())) if len(off) else math.inf


def _by_speeds(told: Mapping[int, Track], true: Mapping[int, Track]) -> tuple[float, float]:
    """(offset [s], correlation) where the speeds of all robots are most alike."""
    begun_s, ended_s = _span(told)
    true_begun_s, true_ended_s = _span(true)
    n, k = (max(2, int((b - a) / STEP_S) + 1) for a, b in ((begun_s, ended_s), (true_begun_s, true_ended_s)))
    both, ours, theirs, shared = (np.zeros(n + k - 1) for _ in range(4))
    for robot in told:
        a, a_there = _speeds(told[robot], begun_s, n)
        b, b_there = _speeds(true[robot], true_begun_s, k)
        for total, one, other in (
            (both, a, b),
            (ours, a * a, b_there),
            (theirs, a_there, b * b),
            (shared, a_there, b_there),
        ):
            total += np.asarray(correlate(one, other), np.float64)
    enough = shared >= MIN_OVERLAP * shared.max()
    with np.errstate(invalid="ignore", divide="ignore"):
        alike = np.where(enough, both / np.sqrt(np.maximum(ours * theirs, 1e-12)), -1.0)
    best = int(alike.argmax())
    return float(begun_s - true_begun_s + correlation_lags(n, k)[best] * STEP_S), float(alike[best])


def _span(tracks: Mapping[int, Track]) -> tuple[float, float]:
    return min(t.time_s[0] for t in tracks.values()), max(t.time_s[-1] for t in tracks.values())


def _speeds(track: Track, begun_s: float, count: int) -> tuple[Floats, Floats]:
    """(count,) speeds less their mean, 0 outside of the track; and 1 where it is."""
    at_s: Floats = begun_s + STEP_S * np.arange(count, dtype=np.float64)
    there = ((at_s >= track.time_s[0]) & (at_s <= track.time_s[-1])).astype(np.float64)
    ahead, behind = track.at(at_s + SPEED_OVER_S / 2), track.at(at_s - SPEED_OVER_S / 2)
    speeds = np.hypot(*(ahead - behind)[:, :2].T) / SPEED_OVER_S
    mean = float(speeds @ there) / max(1.0, float(there.sum()))
    return (speeds - mean) * there, there
