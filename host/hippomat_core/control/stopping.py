"""How far a body gets along an arc, or round in place, before it is nearer to something than it may be.

The body is a disc or a convex outline. Points are where things are now; what is nearer than its gap already
only forbids getting nearer. Geometry of the guard: knows no speeds, no scan and no reason.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

STEP_M = 0.01  # the swept area is looked at this finely
NEARER_M = 0.001  # a point counts as approached when it gets nearer by this much
OWN_BODY_M = 0.03  # deeper inside the body than this is the body itself
STRAIGHT_PER_M = 1e-6  # curvature below which an arc is a line

Points = NDArray[np.float64]  # (n, 2) [m], base frame: x forward, y left


@njit(cache=True, nogil=True)
def beyond_body_m(x: float, y: float, corners: Points, radius_m: float) -> float:
    """From the body's edge to a point of the base frame; negative inside it.

    corners: (n, 2) counter-clockwise and convex; (0, 2): the body is the disc of radius_m
    """
    count = len(corners)
    if count == 0:
        return math.hypot(x, y) - radius_m
    deepest, nearest = -math.inf, math.inf
    for k in range(count):
        ax, ay = corners[k, 0], corners[k, 1]
        ex, ey = corners[(k + 1) % count, 0] - ax, corners[(k + 1) % count, 1] - ay
        length = math.hypot(ex, ey)
        deepest = max(deepest, ((y - ay) * -ex + (x - ax) * ey) / length)
        share = min(max(((x - ax) * ex + (y - ay) * ey) / (length * length), 0.0), 1.0)
        nearest = min(nearest, math.hypot(x - ax - share * ex, y - ay - share * ey))
    return deepest if deepest <= 0.0 else nearest


@njit(cache=True, nogil=True)
def carried(points: Points, c: float, s: float, shift_x: float, shift_y: float) -> Points:
    """(n, 2) points turned and moved: guard.carrying."""
    moved = np.empty(points.shape, np.float64)
    for k in range(len(points)):
        x, y = points[k, 0], points[k, 1]
        moved[k, 0] = c * x - s * y + shift_x
        moved[k, 1] = s * x + c * y + shift_y
    return moved


@njit(cache=True, nogil=True)
def kept_clear_of(
    points: Points, peers: NDArray[np.float64], come_m: float, margin_m: float
) -> tuple[Points, NDArray[np.float64], NDArray[np.float64]]:
    """All things (n + k, 2), how much nearer the edge of each may be (n + k,), and the same with the margin.

    points: (n, 2)   peers: (k, 3) x, y, radius [m]   come_m: how far anything may have come by itself
    """
    seen, count = len(points), len(points) + len(peers)
    xy, size_m = np.empty((count, 2), np.float64), np.full(count, come_m)
    xy[:seen] = points
    for k in range(len(peers)):
        xy[seen + k, 0], xy[seen + k, 1] = peers[k, 0], peers[k, 1]
        size_m[seen + k] += peers[k, 2]
    return xy, size_m, size_m + margin_m


@njit(cache=True, nogil=True)
def nearest_m(xy: Points, gap_m: NDArray[np.float64], corners: Points, radius_m: float) -> float:
    """How near the nearest thing is: beyond the body's edge, less its own gap. inf: there is nothing.

    xy: (n, 2) base frame   gap_m: (n,) to be kept to each; not finite: no such thing
    """
    least = math.inf
    for k in range(len(xy)):
        beyond = beyond_body_m(xy[k, 0], xy[k, 1], corners, radius_m)
        if beyond >= -OWN_BODY_M:
            least = min(least, beyond - gap_m[k])
    return least


@njit(cache=True, nogil=True)
def free_travel_m(
    xy: Points,
    gap_m: NDArray[np.float64],
    corners: Points,
    radius_m: float,
    direction: float,
    curvature: float,
    stop_m: float,
) -> float:
    """How far along the arc, up to stop_m, the body's middle may go.

    direction: 1 forward, -1 backward   curvature [1/m]: counter-clockwise turn per metre of forward travel
    """
    reach_m = stop_m * (1.0 + abs(curvature) * radius_m) + STEP_M
    free_m = stop_m
    for k in range(len(xy)):
        x, y = xy[k, 0], xy[k, 1]
        now_m = beyond_body_m(x, y, corners, radius_m)
        if now_m < -OWN_BODY_M or now_m >= gap_m[k] + reach_m:
            continue
        least_m = min(gap_m[k], now_m - NEARER_M)
        steps = math.ceil(free_m / STEP_M)
        for step in range(1, steps + 1):
            travelled = min(step * STEP_M, free_m)
            yaw = direction * travelled * curvature
            if abs(curvature) < STRAIGHT_PER_M:
                mx, my = direction * travelled, 0.0
            else:
                mx, my = math.sin(yaw) / curvature, (1.0 - math.cos(yaw)) / curvature
            c, s = math.cos(yaw), math.sin(yaw)
            bx, by = c * (x - mx) + s * (y - my), -s * (x - mx) + c * (y - my)
            if not beyond_body_m(bx, by, corners, radius_m) >= least_m:  # also where it is no number
                free_m = max(travelled - STEP_M, 0.0)
                break
    return free_m


@njit(cache=True, nogil=True)
def free_turn_rad(
    xy: Points, gap_m: NDArray[np.float64], corners: Points, radius_m: float, turn_rad: float
) -> float:
    """How far the body may turn in place, up to turn_rad (signed; the answer is not)."""
    wanted, step_rad = abs(turn_rad), STEP_M / radius_m
    free_rad = wanted
    if len(corners) == 0:  # a disc turns in itself
        return free_rad
    sign = 1.0 if turn_rad >= 0.0 else -1.0
    for k in range(len(xy)):
        x, y = xy[k, 0], xy[k, 1]
        now_m = beyond_body_m(x, y, corners, radius_m)
        if now_m < -OWN_BODY_M or math.hypot(x, y) - radius_m >= gap_m[k]:
            continue
        least_m = min(gap_m[k], now_m - NEARER_M)
        for step in range(1, math.ceil(free_rad / step_rad) + 1):
            turned = min(step * step_rad, free_rad)
            c, s = math.cos(turned), sign * math.sin(turned)
            if not beyond_body_m(c * x + s * y, -s * x + c * y, corners, radius_m) >= least_m:
                free_rad = max(turned - step_rad, 0.0)
                break
    return free_rad
