"""The relations benchmark (Kuemmerle et al. 2009): how far poses differ from measured pose differences.

A relation says where the robot was at t2 as seen from where it was at t1. Knows stamps and poses, not how the
poses were found.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import ConfigError
from hippomat_core.slam.poses import seen_from
from hippomat_sim.bench.slam_trajectory import Trajectory, apart_from_nearest

NEAR_S = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Relations:
    """Each row is one relation."""

    times_s: NDArray[np.float64]  # (n, 2) t1, t2
    motions: NDArray[np.float64]  # (n, 3) dx [m], dy [m], dyaw [rad] in the frame of the pose at t1


@dataclass(frozen=True, slots=True)
class RelationErrors:
    """Mean and deviation over `count` relations."""

    count: int
    translation_m: float
    translation_deviation_m: float
    rotation_deg: float
    rotation_deviation_deg: float


def read_relations(path: Path) -> Relations:
    """Lines `t1 t2 dx dy dz roll pitch yaw`; ConfigError names the file and what is wrong."""
    try:
        rows = np.loadtxt(path, ndmin=2)
    except OSError as error:
        raise ConfigError(f"relations {path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise ConfigError(f"relations {path}: {error}; lines are t1 t2 dx dy dz roll pitch yaw") from None
    if not len(rows) or rows.shape[1] != 8 or not np.isfinite(rows).all():
        raise ConfigError(f"relations {path}: lines are t1 t2 dx dy dz roll pitch yaw, found {rows.shape}")
    return Relations(rows[:, :2], rows[:, [2, 3, 7]])


def at_scans(relations: Relations, scan_stamps_s: NDArray[np.float64]) -> Relations:
    """Those with both ends within NEAR_S of a scan (stamps ascending): no interpolation enters."""
    near = (apart_from_nearest(relations.times_s, scan_stamps_s) <= NEAR_S).all(axis=1)
    return Relations(relations.times_s[near], relations.motions[near])


def relation_errors(relations: Relations, trajectory: Trajectory) -> RelationErrors:
    """Over the relations within the trajectory's time."""
    times_s = relations.times_s
    first_s, last_s = trajectory.stamps_s[0] - NEAR_S, trajectory.stamps_s[-1] + NEAR_S
    covered = ((times_s >= first_s) & (times_s <= last_s)).all(axis=1)
    found = seen_from(trajectory.at(times_s[:, 0]), trajectory.at(times_s[:, 1]))
    off = seen_from(relations.motions, found)[covered]
    return _errors(np.hypot(off[:, 0], off[:, 1]), np.abs(np.rad2deg(off[:, 2])))


def _errors(apart_m: NDArray[np.float64], turned_deg: NDArray[np.float64]) -> RelationErrors:
    if not len(apart_m):
        nan = float("nan")
        return RelationErrors(0, nan, nan, nan, nan)
    means = (float(apart_m.mean()), float(apart_m.std()), float(turned_deg.mean()), float(turned_deg.std()))
    return RelationErrors(len(apart_m), *means)
