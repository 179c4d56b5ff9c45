"""The last instance before the motors: slow down or stop so that nothing seen is touched.

Knows the latest scan, the peers as discs, the footprint and the speed; no map, no path, no goal. The robot is
round, so turning in place is always allowed. A thing that is already too near only forbids getting nearer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import Config, LidarConfig
from hippomat_core.messages import ScanReceived

Points = NDArray[np.float64]  # (n, 2) [m], base frame: x forward, y left

STEP_M = 0.01  # the swept corridor is looked at this finely
CRAWL_MPS = 0.015  # slower than this is standing: the base's motors would only hum
NEARER_M = 0.001  # a point counts as approached when it gets nearer by this much
TURN_Q6 = 360 * 64
HOLE_Q6 = 15 * 64  # samples are one or two degrees apart: a wider hole is damage
HIDDEN_KEPT = 360


@dataclass(frozen=True, slots=True)
class GuardedDrive:
    """The velocity that is safe to command; `limited` where it is not the one that was asked for."""

    v_mps: float
    wz_radps: float
    limited: bool


def is_whole(scan: ScanReceived) -> bool:
    """True where the samples leave no hole: it would show free space where nobody looked."""
    if not len(scan.angle_q6):
        return False
    angles = np.sort(scan.angle_q6.astype(np.int64) % TURN_Q6)
    return int(np.diff(angles, append=angles[0] + TURN_Q6).max()) <= HOLE_Q6


def scan_points(scan: ScanReceived, lidar: LidarConfig) -> Points:
    """The sweep's returns in the base frame; without no-returns and ranges outside the lidar's limits.

    The device's angles run clockwise, ours counter-clockwise; the lidar's pose is in `lidar`.
    """
    range_m = scan.distance_q2 / 4000.0
    kept = (scan.distance_q2 > 0) & (range_m >= lidar.min_range_m) & (range_m <= lidar.max_range_m)
    range_m = range_m[kept]
    angle_rad = lidar.yaw_rad - np.deg2rad(scan.angle_q6[kept] / 64.0)
    x_m = lidar.x_m + range_m * np.cos(angle_rad)
    y_m = lidar.y_m + range_m * np.sin(angle_rad)
    return np.stack([x_m, y_m], axis=1)


def carried_along(
    points: Points, then: tuple[float, float, float], now: tuple[float, float, float]
) -> Points:
    """Points seen from pose `then`, in the base frame at pose `now`; poses are (x, y, yaw) of one frame.

    Without it a robot that has turned since the sweep would brake for things beside it.
    """
    c, s = math.cos(then[2] - now[2]), math.sin(then[2] - now[2])
    east_m, north_m = then[0] - now[0], then[1] - now[1]
    shift_x = math.cos(now[2]) * east_m + math.sin(now[2]) * north_m
    shift_y = -math.sin(now[2]) * east_m + math.cos(now[2]) * north_m
    x, y = points[:, 0], points[:, 1]
    return np.stack([c * x - s * y + shift_x, s * x + c * y + shift_y], axis=1)


def hidden_points(points: Points, lidar: LidarConfig) -> Points:
    """Those of an earlier sweep's points (base frame, now) that are too near for the lidar to see."""
    range_m = np.hypot(points[:, 0] - lidar.x_m, points[:, 1] - lidar.y_m)
    return points[range_m < lidar.min_range_m][-HIDDEN_KEPT:]


def guard(
    points: Points, v_mps: float, wz_radps: float, peers: NDArray[np.float64], config: Config
) -> GuardedDrive:
    """The wanted velocity, made slow enough to stop before contact in the corridor it sweeps.

    peers: (k, 3) x, y, radius [m], base frame. Stopping takes v * guard.latency_s + v^2 / (2
    limits.accel_mps2); guard.margin_m stays free beyond the footprint. When slowed, the arc keeps its
    curvature.
    """
    if abs(v_mps) < CRAWL_MPS:
        return GuardedDrive(0.0, wz_radps, False)
    accel, latency_s = config.limits.accel_mps2, config.guard.latency_s
    reach_m = config.robot.radius_m + config.guard.margin_m
    stop_m = abs(v_mps) * latency_s + v_mps * v_mps / (2.0 * accel)
    xy = np.concatenate([points, peers[:, :2]])
    gap_m = np.concatenate([np.full(len(points), reach_m), peers[:, 2] + reach_m])
    free_m = _free_travel_m(xy, gap_m, math.copysign(1.0, v_mps), wz_radps / v_mps, stop_m)
    if free_m >= stop_m:
        return GuardedDrive(v_mps, wz_radps, False)
    speed = accel * (math.sqrt(latency_s * latency_s + 2.0 * free_m / accel) - latency_s)
    if speed < CRAWL_MPS:
        return GuardedDrive(0.0, wz_radps, True)
    return GuardedDrive(math.copysign(speed, v_mps), wz_radps * speed / abs(v_mps), True)


def _free_travel_m(
    xy: Points, gap_m: NDArray[np.float64], direction: float, curvature: float, stop_m: float
) -> float:
    """How far along the arc the robot's centre may go before a point is nearer than its gap.

    curvature [1/m]: counter-clockwise turn per metre of forward travel
    """
    now_m = np.hypot(xy[:, 0], xy[:, 1])
    near = now_m < gap_m + stop_m + STEP_M
    xy, gap_m, now_m = xy[near], gap_m[near], now_m[near]
    if not len(xy):
        return stop_m
    travelled = np.minimum(np.arange(1, math.ceil(stop_m / STEP_M) + 1) * STEP_M, stop_m)
    along = direction * travelled
    if abs(curvature) < 1e-6:
        centre_x, centre_y = along, np.zeros_like(along)
    else:
        centre_x = np.sin(along * curvature) / curvature
        centre_y = (1.0 - np.cos(along * curvature)) / curvature
    distance_m = np.hypot(xy[:, 0, None] - centre_x, xy[:, 1, None] - centre_y)
    hit = (distance_m < np.minimum(gap_m, now_m - NEARER_M)[:, None]).any(axis=0)
    if not hit.any():
        return stop_m
    return max(float(travelled[int(np.argmax(hit))]) - STEP_M, 0.0)
