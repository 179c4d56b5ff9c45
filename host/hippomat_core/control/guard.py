"""The last instance before the motors: slow down or stop so that nothing seen is touched.

Knows the latest scan, the peers as discs, the footprint and the speed; no map, no path, no goal. A round
robot may always turn in place. A thing that is too near already only forbids getting nearer (stopping.py).

What it counts on: the base brakes at limits.decel_mps2 or more and obeys within guard.latency_s; wheels do
not slip between a scan and its use; nothing comes nearer by itself faster than guard.obstacle_speed_mps; and
the lidar sees what there is, at its height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import Config, LidarConfig
from hippomat_core.control.scan_kernels import came_back, kept_samples, nearer_than, placed, widest_gap
from hippomat_core.control.stopping import (
    Points,
    carried,
    free_travel_m,
    free_turn_rad,
    kept_clear_of,
    nearest_m,
)
from hippomat_core.messages import ScanReceived
from hippomat_core.replaced import quickly_made

CRAWL_MPS = 0.015  # slower than this is standing: the base's motors would only hum
TURN_Q6 = 360 * 64
HOLE_Q6 = 15 * 64  # samples are one or two degrees apart: a wider hole is damage
HIDDEN_KEPT = 360


@quickly_made
@dataclass(frozen=True, slots=True)
class GuardedDrive:
    """The velocity that is safe to command; `limited` where it is not the one that was asked for."""

    v_mps: float
    wz_radps: float
    limited: bool
    nearest_m: float = (
        math.inf
    )  # from the footprint to the nearest thing, less its allowances; inf: nothing seen
    free_m: float = math.inf  # along the wanted arc; where it only turns: of its farthest corner
    stop_m: float = 0.0  # what stopping would take


@quickly_made
@dataclass(frozen=True, slots=True)
class Lateness:
    """How old it is what the guard decides from, and what the base did when it last said so."""

    scan_s: float = 0.0  # since the scan's end
    odometry_s: float = 0.0  # since the base's last frame: motion since then is unknown
    v_mps: float = 0.0  # measured


NOT_LATE = Lateness()


def is_whole(scan: ScanReceived) -> bool:
    """True where the samples leave no hole: it would show free space where nobody looked."""
    if not len(scan.angle_q6):
        return False
    angles = scan.angle_q6 % TURN_Q6
    angles.sort()
    return bool(widest_gap(angles, TURN_Q6) <= HOLE_Q6)


def returns(scan: ScanReceived, lidar: LidarConfig) -> NDArray[np.bool_]:
    """(n,): which samples came back from something within the lidar's range."""
    return came_back(scan.distance_q2 / 4000.0, lidar.min_range_m, lidar.max_range_m)


def scan_points(scan: ScanReceived, lidar: LidarConfig) -> Points:
    """The sweep's returns in the base frame; without no-returns and ranges outside the lidar's limits.

    The device's angles run clockwise, ours counter-clockwise; the lidar's pose is in `lidar`.
    """
    limits_m = lidar.min_range_m, lidar.max_range_m
    samples = scan.distance_q2 / 4000.0, scan.angle_q6 / 64.0
    range_m, angle_rad = kept_samples(*samples, *limits_m, lidar.yaw_rad)
    return placed(range_m, np.cos(angle_rad), np.sin(angle_rad), lidar.x_m, lidar.y_m)


def carrying(
    then: tuple[float, float, float], now: tuple[float, float, float]
) -> tuple[float, float, float, float]:
    """(c, s, dx, dy) that carry a point (x, y) along: (c x - s y + dx, s x + c y + dy)."""
    c, s = math.cos(then[2] - now[2]), math.sin(then[2] - now[2])
    east_m, north_m = then[0] - now[0], then[1] - now[1]
    shift_x = math.cos(now[2]) * east_m + math.sin(now[2]) * north_m
    shift_y = -math.sin(now[2]) * east_m + math.cos(now[2]) * north_m
    return c, s, shift_x, shift_y


def carried_along(
    points: Points, then: tuple[float, float, float], now: tuple[float, float, float]
) -> Points:
    """Points seen from pose `then`, in the base frame at pose `now`; poses are (x, y, yaw) of one frame.

    Without it a robot that has turned since the sweep would brake for things beside it.
    """
    return carried(points, *carrying(then, now))


def hidden_points(points: Points, lidar: LidarConfig) -> Points:
    """Those of an earlier sweep's points (base frame, now) that are too near for the lidar to see."""
    return nearer_than(points, lidar.x_m, lidar.y_m, lidar.min_range_m)[-HIDDEN_KEPT:]


def guard(
    points: Points,
    v_mps: float,
    wz_radps: float,
    peers: NDArray[np.float64],
    config: Config,
    late: Lateness = NOT_LATE,
    whole: bool = True,
) -> GuardedDrive:
    """The wanted velocity, made slow enough to stop before contact in the area that the footprint sweeps.

    points: (n, 2) [m]   peers: (k, 3) x, y, radius [m]; both in the base frame, where they are now
    Stopping takes v * reaction + v^2 / (2 limits.decel_mps2), with the larger of the wanted and the measured
    speed; guard.margin_m stays free beyond the footprint. When slowed, the arc keeps its curvature.
    whole: the points are of all directions; a lidar that sees a sector looks ahead, so nobody looked behind
    """
    if not (math.isfinite(v_mps) and math.isfinite(wz_radps)):
        return GuardedDrive(0.0, 0.0, True)
    seen = _things_seen(points, peers, v_mps, config, late)
    if abs(v_mps) < CRAWL_MPS:
        return _guarded_turn(seen, wz_radps, config, late)
    direction, decel = math.copysign(1.0, v_mps), config.limits.decel_mps2
    speed = max(abs(v_mps), direction * late.v_mps)
    reaction_s = config.guard.latency_s + late.odometry_s
    stop_m = stopping_way(speed, reaction_s, decel)
    curvature = wz_radps / v_mps
    free_m = 0.0
    if whole or direction > 0.0:
        free_m = free_travel_m(
            seen.xy, seen.gap_m, seen.corners, config.robot.radius_m, direction, curvature, stop_m
        )
    if free_m >= stop_m:
        return GuardedDrive(v_mps, wz_radps, False, seen.nearest_m, free_m, stop_m)
    allowed = min(fastest(free_m, reaction_s, decel), abs(v_mps))
    if allowed < CRAWL_MPS:
        turn = _guarded_turn(seen, wz_radps, config, late)
        return GuardedDrive(0.0, turn.wz_radps, True, seen.nearest_m, free_m, stop_m)
    share = allowed / abs(v_mps)
    # Where only the measured speed is too much, the wanted one is kept: the base is braking to it already.
    return GuardedDrive(v_mps * share, wz_radps * share, share < 1.0, seen.nearest_m, free_m, stop_m)


def stopping_way(speed: float, reaction_s: float, decel: float) -> float:
    """Covered until standing, from a speed and with a deceleration: [m], or [rad] for a turn."""
    return speed * reaction_s + speed * speed / (2.0 * decel)


def fastest(free: float, reaction_s: float, decel: float) -> float:
    """The speed from which stopping takes no more than `free`: the inverse of stopping_way."""
    return decel * (math.sqrt(reaction_s * reaction_s + 2.0 * free / decel) - reaction_s)


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Everything to keep clear of, and our body."""

    xy: Points  # (n, 2) base frame
    gap_m: NDArray[np.float64]  # (n,) to be kept beyond the body
    corners: Points  # (k, 2)
    nearest_m: float  # beyond the body, less what the things may move; margin not counted


def _things_seen(
    points: Points, peers: NDArray[np.float64], v_mps: float, config: Config, late: Lateness
) -> _Seen:
    """Points and peers, each with the way it may have come nearer until we stand."""
    settings, limits = config.guard, config.limits
    until_s = late.scan_s + late.odometry_s + settings.latency_s + abs(v_mps) / limits.decel_mps2
    come_m = settings.obstacle_speed_mps * until_s
    xy, size_m, gap_m = kept_clear_of(points, peers, come_m, settings.margin_m)
    corners = _corners(config.robot.footprint)
    nearest = float(nearest_m(xy, size_m, corners, config.robot.radius_m))
    return _Seen(xy, gap_m, corners, nearest)


@lru_cache(maxsize=16)  # of a robot it is one, asked for at every tick
def _corners(footprint: tuple[float, ...]) -> Points:
    """(k, 2); not to be written to."""
    return np.array(footprint, np.float64).reshape(-1, 2)


def _guarded_turn(seen: _Seen, wz_radps: float, config: Config, late: Lateness) -> GuardedDrive:
    """Turning in place: corners that are no circle's may touch something."""
    if not len(seen.corners) or wz_radps == 0.0:
        return GuardedDrive(0.0, wz_radps, False, seen.nearest_m)
    radius_m, decel = config.robot.radius_m, config.limits.turn_accel_radps2
    reaction_s = config.guard.latency_s + late.odometry_s
    stop_rad = stopping_way(abs(wz_radps), reaction_s, decel)
    free_rad = free_turn_rad(seen.xy, seen.gap_m, seen.corners, radius_m, math.copysign(stop_rad, wz_radps))
    allowed = abs(wz_radps) if free_rad >= stop_rad else fastest(free_rad, reaction_s, decel)
    wz = math.copysign(min(allowed, abs(wz_radps)), wz_radps)
    limited = free_rad < stop_rad
    return GuardedDrive(0.0, wz, limited, seen.nearest_m, free_rad * radius_m, stop_rad * radius_m)
