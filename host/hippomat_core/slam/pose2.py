"""One pose in the plane as a plain tuple (x [m], y [m], yaw [rad]); poses.py has arrays of them.

A pose b_from_a takes points of frame a to frame b, and is where frame a lies in frame b.
"""

from __future__ import annotations

import math

Pose = tuple[float, float, float]

IDENTITY: Pose = (0.0, 0.0, 0.0)


def compose(a: Pose, b: Pose) -> Pose:
    """First b, then a: c_from_a of c_from_b and b_from_a."""
    c, s = math.cos(a[2]), math.sin(a[2])
    x = a[0] + c * b[0] - s * b[1]
    y = a[1] + s * b[0] + c * b[1]
    return x, y, math.remainder(a[2] + b[2], math.tau)


def inverse(a: Pose) -> Pose:
    """a_from_b of b_from_a."""
    c, s = math.cos(a[2]), math.sin(a[2])
    return -c * a[0] - s * a[1], s * a[0] - c * a[1], -a[2]


def between(a: Pose, b: Pose) -> Pose:
    """b as seen from a: both in one frame."""
    return compose(inverse(a), b)


def apart(a: Pose, b: Pose) -> tuple[float, float]:
    """How far two poses of one frame are from each other: [m], [rad]."""
    return math.hypot(a[0] - b[0], a[1] - b[1]), abs(math.remainder(a[2] - b[2], math.tau))
