"""A pose and how sure it is, from one scan to the next: odometry carries it on, the scan matcher corrects it.

An extended Kalman filter over (x, y, yaw) in the map frame (Thrun, Burgard, Fox: Probabilistic Robotics, 3.3
and 5.4). Along a bare corridor the matcher knows little and the odometry keeps the pose; scans from one place
err alike, so what is stated is never surer than the map is. Knows no map: a match is an argument.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import SlamConfig
from hippomat_core.slam.matcher import Match
from hippomat_core.slam.pose2 import Pose, between, compose

MAP_SIGMA = (0.018, 0.018, 0.006)  # [m, m, rad] what no number of scans averages out: walls are whole cells
SCAN_SIGMA = (0.004, 0.004, 0.003)  # of the pose from one scan to the next, even where the robot stands
GATE = 16.3  # squared deviations: one correction in a thousand is larger, if the odometry is what it says
CHI2_95 = 5.991  # of two degrees of freedom


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Map frame; covariance (3, 3) of x, y [m], yaw [rad]."""

    pose: Pose
    covariance: NDArray[np.float64]  # of what scans and odometry can tell

    @property
    def stated(self) -> NDArray[np.float64]:
        """(3, 3): the covariance of the pose's error, that of the map itself included."""
        return np.asarray(self.covariance + np.diag(np.square(MAP_SIGMA)), np.float64)

    @property
    def radius_m(self) -> float:
        """The robot is within this of the pose, 95 times of 100: the longer half axis of the ellipse."""
        return math.sqrt(CHI2_95 * float(np.linalg.eigvalsh(self.stated[:2, :2])[-1]))


def at_start(pose: Pose, xy_m: float, yaw_rad: float) -> Estimate:
    """As sure as a person is who puts a robot on its mark; standard deviations."""
    return Estimate(pose, np.diag(np.array([xy_m, xy_m, yaw_rad]) ** 2))


def carried_on(estimate: Estimate, before: Pose, now: Pose, config: SlamConfig) -> Estimate:
    """After the odometry went from one pose of the odom frame to another."""
    step = between(before, now)
    pose = compose(estimate.pose, step)
    way_m, turn_rad = math.hypot(step[0], step[1]), abs(step[2])
    moved = np.array(
        [
            [1.0, 0.0, -(pose[1] - estimate.pose[1])],
            [0.0, 1.0, pose[0] - estimate.pose[0]],
            [0.0, 0.0, 1.0],
        ]
    )
    # Variances grow with the way: the errors of single steps are taken to be independent.
    along = config.odometry_noise_m**2 * way_m
    turned = config.odometry_noise_rad**2 * (turn_rad + way_m)
    grown = moved @ estimate.covariance @ moved.T + np.diag([along, along, turned])
    return Estimate(pose, 0.5 * (grown + grown.T))


def corrected(predicted: Estimate, found: Match) -> Estimate:
    """With a match, each in proportion to what it knows.

    A match that the odometry cannot explain is believed where it knows something: wheels slip, walls do not.
    """
    noise = np.linalg.inv(found.information)
    prior = predicted.covariance + np.diag(np.square(SCAN_SIGMA))
    off = found.pose - np.array(predicted.pose)
    off[2] = math.remainder(off[2], math.tau)
    prior = prior * max(float(off @ np.linalg.solve(prior + noise, off)) / GATE, 1.0)
    gain = np.asarray(prior @ np.linalg.inv(prior + noise), np.float64)
    x, y, yaw = (np.array(predicted.pose) + gain @ off).tolist()
    left = np.eye(3) - gain
    covariance = left @ prior @ left.T + gain @ noise @ gain.T
    both = np.asarray(0.5 * (covariance + covariance.T), np.float64)
    return Estimate((x, y, math.remainder(yaw, math.tau)), both)
