"""Drive along a path of cells: turn in place first, then regulated pure pursuit (Macenski et al. 2023).

Decides a velocity from path, pose and limits. The pursued point is only ever one that is in sight over free
cells, so that a corner is not cut. Knows no peers: how far it may go is an argument.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import LimitsConfig
from hippomat_core.planning.costmap import Costmap

TURN_FROM_RAD = 0.6  # heading error at which the robot stops and turns in place
TURN_UNTIL_RAD = 0.12
TURN_GAIN = 3.0  # [1/s]
LOOKAHEAD_M = 0.20
SLOWEST_MPS = 0.03
BRAKE_SHARE = 0.7  # of limits.accel_mps2, so that the brake has something left
REACTION_S = 0.1  # command to wheels


@dataclass(frozen=True, slots=True)
class Motion:
    """Pose in the map frame and measured speed in the base frame."""

    x_m: float
    y_m: float
    yaw_rad: float
    v_mps: float = 0.0
    wz_radps: float = 0.0


@dataclass(frozen=True, slots=True)
class Drive:
    """Commanded velocity; `turning` is the follower's only memory besides the velocity itself."""

    v_mps: float = 0.0
    wz_radps: float = 0.0
    turning: bool = False


def follow(
    ahead: NDArray[np.float64],
    free_m: float,
    motion: Motion,
    last: Drive,
    dt_s: float,
    limits: LimitsConfig,
    costmap: Costmap,
) -> Drive:
    """The next velocity command.

    ahead: (n, 2) path points still to drive, nearest first, n >= 1   free_m: metres we may drive along it
    """
    target = _pursued(ahead, motion, costmap)
    dx, dy = target[0] - motion.x_m, target[1] - motion.y_m
    away_m = math.hypot(dx, dy)
    error_rad = math.remainder(math.atan2(dy, dx) - motion.yaw_rad, math.tau)
    turning = abs(error_rad) > (TURN_UNTIL_RAD if last.turning else TURN_FROM_RAD)
    if turning or free_m <= 0.0:
        # Waiting robots turn into their way already; a robot still rolling brakes first.
        idle = not turning and abs(error_rad) < TURN_UNTIL_RAD
        wz = 0.0 if idle else _clamped(TURN_GAIN * error_rad, limits.turn_radps)
        return limited(Drive(0.0, wz, turning), last, dt_s, limits)
    curvature = 2.0 * math.sin(error_rad) / max(away_m, 0.05)
    v = min(limits.speed_mps, braking_speed(free_m, limits))
    v *= max(1.0 - abs(error_rad) / 1.2, 0.2)
    v = min(v, 0.8 * limits.turn_radps / max(abs(curvature), 1e-6))
    v = max(v, min(SLOWEST_MPS, limits.speed_mps))
    return limited(Drive(v, _clamped(v * curvature, limits.turn_radps), False), last, dt_s, limits)


def braking_speed(free_m: float, limits: LimitsConfig) -> float:
    """The speed from which the robot still stops within free_m, its reaction included."""
    brake = BRAKE_SHARE * limits.accel_mps2
    return brake * (math.sqrt(REACTION_S * REACTION_S + 2.0 * max(free_m, 0.0) / brake) - REACTION_S)


def limited(wanted: Drive, last: Drive, dt_s: float, limits: LimitsConfig) -> Drive:
    """The wanted velocity, changed no faster than the limits allow."""
    dv, dw = limits.accel_mps2 * dt_s, limits.turn_accel_radps2 * dt_s
    v = last.v_mps + _clamped(wanted.v_mps - last.v_mps, dv)
    wz = last.wz_radps + _clamped(wanted.wz_radps - last.wz_radps, dw)
    return Drive(v, wz, wanted.turning)


def _clamped(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


def _pursued(ahead: NDArray[np.float64], motion: Motion, costmap: Costmap) -> tuple[float, float]:
    """The farthest point within the look-ahead that is in sight; the next one where none is."""
    own = (motion.x_m, motion.y_m)
    chosen = (float(ahead[0, 0]), float(ahead[0, 1]))
    for x, y in ahead[1:].tolist():
        if math.hypot(x - own[0], y - own[1]) > LOOKAHEAD_M or not _in_sight(own, (x, y), costmap):
            break
        chosen = (x, y)
    return chosen


def _in_sight(a: tuple[float, float], b: tuple[float, float], costmap: Costmap) -> bool:
    """True where the straight way from a to b stays on free cells."""
    count = max(2, math.ceil(math.hypot(b[0] - a[0], b[1] - a[1]) / (0.4 * costmap.grid.resolution_m)))
    for k in range(count + 1):
        t = k / count
        if not costmap.is_free(costmap.grid.cell_of(a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]))):
            return False
    return True
