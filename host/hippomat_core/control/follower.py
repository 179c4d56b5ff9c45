"""Drive along a path: turn in place first, then regulated pure pursuit (Macenski et al. 2023).

Decides a velocity from path, pose and limits. The pursued point is only ever one that is in sight over free
cells, so that a corner is not cut. Knows no peers: how far it may go is an argument.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import Config, ControlConfig, LimitsConfig
from hippomat_core.control.pursuit import pursued_point
from hippomat_core.planning.costmap import Costmap
from hippomat_core.replaced import quickly_made

TURN_GAIN = 3.0  # [1/s]
SLOWEST_MPS = 0.03  # slower than this is standing: there is no curvature, and the base would only hum
BRAKE_SHARE = 0.7  # of the deceleration is planned with, so that the brake has something left
TURN_SHARE = 0.8  # of the turn rate, so that a lagging turn can be caught up
REACTION_S = 0.1  # command to wheels
NEAREST_M = 0.05  # a pursued point nearer than this says little about the curvature


@quickly_made
@dataclass(frozen=True, slots=True)
class Motion:
    """Pose in the map frame and measured speed in the base frame."""

    x_m: float
    y_m: float
    yaw_rad: float
    v_mps: float = 0.0
    wz_radps: float = 0.0


@quickly_made
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
    config: Config,
    costmap: Costmap,
) -> Drive:
    """The next velocity command.

    ahead: (n, 2) path points still to drive, nearest first, n >= 1   free_m: metres we may drive along it
    last: what was commanded a moment dt_s ago
    """
    control, limits = config.control, config.limits
    x_m, y_m = pursued_point(ahead, motion.x_m, motion.y_m, look_ahead_m(motion.v_mps, control), costmap)
    dx, dy = x_m - motion.x_m, y_m - motion.y_m
    error_rad = math.remainder(math.atan2(dy, dx) - motion.yaw_rad, math.tau)
    turning = abs(error_rad) > (control.rotate_until_rad if last.turning else control.rotate_from_rad)
    if turning or free_m <= 0.0:
        # Waiting robots turn into their way already; a robot still rolling brakes first.
        idle = not turning and abs(error_rad) < control.rotate_until_rad
        wz = 0.0 if idle else turn_rate(error_rad, limits)
        return limited(Drive(0.0, wz, turning), last, dt_s, limits)
    curvature = 2.0 * math.sin(error_rad) / max(math.hypot(dx, dy), NEAREST_M)
    curvature = _clamped(curvature, limits.curvature_per_m)
    room_m = _room_m(motion, costmap) - config.robot.radius_m
    v = min(regulated_speed(curvature, room_m, config), braking_speed(free_m, limits))
    v = max(v, min(SLOWEST_MPS, limits.speed_mps))
    return limited(Drive(v, v * curvature, False), last, dt_s, limits)


def look_ahead_m(v_mps: float, control: ControlConfig) -> float:
    """How far along the path the pursued point is; grows with the speed."""
    return min(max(abs(v_mps) * control.lookahead_s, control.lookahead_min_m), control.lookahead_max_m)


def turn_rate(error_rad: float, limits: LimitsConfig) -> float:
    """The turn in place that ends at the wanted heading: slow enough to be braked until there."""
    brake = BRAKE_SHARE * limits.turn_accel_radps2
    fastest = math.sqrt(2.0 * brake * abs(error_rad))
    return math.copysign(min(TURN_GAIN * abs(error_rad), fastest, limits.turn_radps), error_rad)


def regulated_speed(curvature: float, room_m: float, config: Config) -> float:
    """The speed for a curvature [1/m] with room_m beside the body.

    Slower in curves tighter than regulated_radius_m and with less room than proximity_m, both in proportion;
    and never faster than turn rate and lateral acceleration allow.
    """
    control, limits = config.control, config.limits
    bend = max(abs(curvature), 1e-6)
    share = 1.0
    if control.regulated_radius_m > 0.0:
        share = min(share, 1.0 / (bend * control.regulated_radius_m))
    if control.proximity_m > 0.0:
        share = min(share, max(room_m, 0.0) / control.proximity_m)
    v = max(limits.speed_mps * share, min(control.regulated_min_mps, limits.speed_mps))
    return min(v, TURN_SHARE * limits.turn_radps / bend, math.sqrt(limits.lateral_accel_mps2 / bend))


def braking_speed(free_m: float, limits: LimitsConfig) -> float:
    """The speed from which the robot still stops within free_m, its reaction included."""
    brake = BRAKE_SHARE * limits.decel_mps2
    return brake * (math.sqrt(REACTION_S * REACTION_S + 2.0 * max(free_m, 0.0) / brake) - REACTION_S)


def limited(wanted: Drive, last: Drive, dt_s: float, limits: LimitsConfig) -> Drive:
    """The wanted velocity, changed no faster than the limits allow.

    Law: |wz| <= bound of turn_bound(v), or is on its way there as fast as turn_accel_radps2 allows.
    """
    v = _changed(last.v_mps, _clamped(wanted.v_mps, limits.speed_mps), dt_s, limits)
    wz = _clamped(wanted.wz_radps, turn_bound(v, limits))
    step = limits.turn_accel_radps2 * dt_s
    return Drive(v, last.wz_radps + _clamped(wz - last.wz_radps, step), wanted.turning)


def turn_bound(v_mps: float, limits: LimitsConfig) -> float:
    """The turn rate [rad/s] allowed at a speed: by itself, by lateral acceleration and by curvature."""
    v = abs(v_mps)
    bound = min(limits.turn_radps, limits.lateral_accel_mps2 / max(v, 1e-9))
    return min(bound, limits.curvature_per_m * v) if v > SLOWEST_MPS else bound


def _changed(v_mps: float, wanted_mps: float, dt_s: float, limits: LimitsConfig) -> float:
    """Speeding up and slowing down have a limit each; a change of direction first comes to a stand."""
    if v_mps * wanted_mps < 0.0:
        wanted_mps = 0.0
    faster = abs(wanted_mps) > abs(v_mps)
    step = (limits.accel_mps2 if faster else limits.decel_mps2) * dt_s
    return v_mps + _clamped(wanted_mps - v_mps, step)


def _room_m(motion: Motion, costmap: Costmap) -> float:
    """From the robot's middle to the nearest obstacle of the map."""
    ix, iy = costmap.grid.cell_of(motion.x_m, motion.y_m)
    return float(costmap.clearance_m[iy, ix]) if costmap.grid.holds(ix, iy) else 0.0


def _clamped(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
