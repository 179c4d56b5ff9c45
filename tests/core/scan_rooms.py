"""Scans of made-up rooms: exact rays on wall segments, seeded range noise."""

from __future__ import annotations

import math

import numpy as np

BEAMS = 240
NOISE_M = 0.01

HALL = [
    ((-4.0, -2.5), (4.0, 2.5)),
    ((1.0, 0.5), (1.6, 1.4)),
    ((-3.0, -2.0), (-2.2, -1.5)),
    ((2.9, -1.3), (3.2, -0.4)),
]
CORRIDOR = [((-60.0, -1.0), (60.0, 1.0))]


def walls_of(boxes):
    """(n, 4) segments x0, y0, x1, y1 of axis-aligned boxes given by two corners."""
    sides = []
    for (left, low), (right, high) in boxes:
        sides += [
            (left, low, right, low),
            (right, low, right, high),
            (right, high, left, high),
            (left, high, left, low),
        ]
    return np.array(sides, np.float64)


def scan(walls, pose, beams=BEAMS, noise_m=NOISE_M, seed=0, max_range_m=12.0):
    """(n, 2) [m] returns in the base frame at pose (x, y, yaw)."""
    bearing = np.arange(beams) * math.tau / beams
    heading = bearing + pose[2]
    ray = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    along = walls[:, 2:] - walls[:, :2]
    start = walls[:, :2] - np.asarray(pose[:2])
    cross = ray[:, None, 0] * along[None, :, 1] - ray[:, None, 1] * along[None, :, 0]
    with np.errstate(all="ignore"):
        distance = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / cross
        share = (start[None, :, 0] * ray[:, None, 1] - start[None, :, 1] * ray[:, None, 0]) / cross
    hit = (distance > 0) & (share >= -1e-9) & (share <= 1 + 1e-9)
    range_m = np.where(hit, distance, np.inf).min(axis=1)
    range_m = range_m + noise_m * np.random.default_rng(seed).standard_normal(beams)
    kept = range_m < max_range_m
    return np.stack([range_m * np.cos(bearing), range_m * np.sin(bearing)], axis=1)[kept]


def in_map(points, pose):
    """Points of the base frame in the map frame."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return points @ np.array([[c, s], [-s, c]]) + np.asarray(pose[:2])
