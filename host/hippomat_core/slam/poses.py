"""Planar poses as arrays (..., 3): x [m], y [m], yaw [rad]. Each function says whose frame they are in."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray


def composed(first: ArrayLike, then: ArrayLike) -> NDArray[np.float64]:
    """The pose `then`, given in the frame of `first`, in the frame that `first` is given in."""
    a, b = np.asarray(first, np.float64), np.asarray(then, np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    y = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return np.stack([x, y, wrapped(a[..., 2] + b[..., 2])], axis=-1)


def seen_from(first: ArrayLike, second: ArrayLike) -> NDArray[np.float64]:
    """The pose `second` in the frame of `first`; both are given in one frame."""
    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    east, north = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    return np.stack([c * east + s * north, -s * east + c * north, wrapped(b[..., 2] - a[..., 2])], axis=-1)


def wrapped(angle_rad: ArrayLike) -> NDArray[np.float64]:
    """The same angles in -pi .. pi."""
    angle = np.asarray(angle_rad, np.float64)
    return angle - math.tau * np.round(angle / math.tau)


def placed(points: NDArray[np.float64], pose: ArrayLike) -> NDArray[np.float64]:
    """Points (n, 2) of the frame that lies at `pose` (3,), in the frame that the pose is given in."""
    x, y, yaw = (float(value) for value in np.asarray(pose, np.float64))
    c, s = math.cos(yaw), math.sin(yaw)
    east = x + c * points[:, 0] - s * points[:, 1]
    north = y + s * points[:, 0] + c * points[:, 1]
    return np.stack([east, north], axis=1)


def placed_together(clouds: Sequence[NDArray[np.float64]], poses: ArrayLike) -> NDArray[np.float64]:
    """All points of the clouds, each (n, 2) in the frame at its pose of poses (k, 3), in the poses' frame."""
    sizes = [len(points) for points in clouds]
    x, y, yaw = np.repeat(np.asarray(poses, np.float64), sizes, axis=0).T
    ahead, left = np.concatenate(list(clouds)).T
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([x + c * ahead - s * left, y + s * ahead + c * left], axis=1)


def turned_information(information: NDArray[np.float64], yaw_rad: float) -> NDArray[np.float64]:
    """An information matrix (3, 3) of x, y, yaw, with x and y along axes turned by yaw_rad."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    turned: NDArray[np.float64] = axes @ information @ axes.T
    return turned
