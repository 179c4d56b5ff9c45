"""Poses in the plane as plain tuples (x [m], y [m], yaw [rad]). Knows no frames by name and no robot.

A pose b_from_a takes points of frame a to frame b, and is where frame a lies in frame b.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

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


def transformed(pose: Pose, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) points of the pose's own frame, in the frame that the pose is given in."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = points[:, 0], points[:, 1]
    return np.stack([pose[0] + c * x - s * y, pose[1] + s * x + c * y], axis=1)


def apart(a: Pose, b: Pose) -> tuple[float, float]:
    """How far two poses of one frame are from each other: [m], [rad]."""
    return math.hypot(a[0] - b[0], a[1] - b[1]), abs(math.remainder(a[2] - b[2], math.tau))
