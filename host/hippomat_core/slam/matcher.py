"""Where was this scan taken? The pose at which its points fall on known surfaces, with how sure that is.

Knows a likelihood field and a guess, not how either came about: a local field of the last keyframes and a
whole saved map are matched alike. First every pose of a grid around the guess, then Newton steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.slam.correlative import search_poses
from hippomat_core.slam.likelihood_field import TOP_LEVEL, LikelihoodField
from hippomat_core.slam.refine import climb, curvature, mean_value

Pose = tuple[float, float, float]  # x [m], y [m], yaw [rad]

RANGE_SIGMA_M = 0.03  # of one return, lidar and surface together
RETURNS_PER_OBSERVATION = 10.0  # neighbouring beams meet the same surface and err alike
LEAST_INFORMATION = 1e-2  # along a bare corridor: a standard deviation of 10 m (10 rad at the lever)
LEAST_LEVER_M = 0.5
FLATTEST = 0.05  # of a full wall's curvature: less is taken for this, lest a Newton step goes far on a plain
SHARPNESS = 2.0 * (1.0 - math.exp(-0.5))  # minus the second difference of exp(-x^2 / 2) over +-1


@dataclass(frozen=True, slots=True)
class Search:
    """Half widths of the grid of poses around the guess, and the grid's turn; translations go by one cell."""

    xy_m: float = 0.3
    yaw_rad: float = math.radians(15.0)
    yaw_step_rad: float = math.radians(0.5)


@dataclass(frozen=True, slots=True)
class Trust:
    """How sure the guess is: standard deviations, alike in all directions."""

    sigma_m: float
    sigma_rad: float

    @property
    def information(self) -> NDArray[np.float64]:
        """(3,) of x, y [1/m^2] and yaw [1/rad^2]."""
        sigmas = (self.sigma_m, self.sigma_m, self.sigma_rad)
        return np.array([1.0 / sigma**2 for sigma in sigmas])


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """The best pose found. Only `score` says whether it is one: a bad guess gives a bad match, no error."""

    pose: NDArray[np.float64]  # (3,) x [m], y [m], yaw [rad] of the base in the field's frame
    score: float  # 0..1, mean likelihood of the points there
    information: NDArray[np.float64]  # (3, 3) inverse covariance [1/m^2, 1/rad^2], axes of the field's frame
    inside: float  # 0..1, share of the points that lie on the field


def match(
    field: LikelihoodField,
    points: NDArray[np.float64],
    guess: Pose | NDArray[np.float64],
    search: Search | None = None,
    trust: Trust | None = None,
) -> Match:
    """The pose near the guess at which the points (n, 2) [m] of the base frame fit the field best.

    The pose and the guess are of the base in the field's frame; with `trust` the guess is evidence too. Equal
    arguments give equal bits; of several grid poses that score alike the nearest to the guess is refined.
    Without points the guess comes back with score 0.
    """
    search = search or Search()
    cell_m = field.resolution_m
    origin = np.array([field.origin_x_m, field.origin_y_m, 0.0])
    unit = np.array([cell_m, cell_m, 1.0])
    in_cells = np.ascontiguousarray(points, np.float64) / cell_m
    given = (np.asarray(guess, np.float64) - origin) / unit
    # The mean likelihood times its worth is a log likelihood: see RETURNS_PER_OBSERVATION.
    worth = len(points) * (field.sigma_m / RANGE_SIGMA_M) ** 2 / RETURNS_PER_OBSERVATION
    pull = np.zeros(3) if trust is None else trust.information * unit**2 / max(worth, 1e-9)
    start = _best_of_grid(field, in_cells, given, search, pull)
    sigma = field.sigma_m / cell_m
    lever = max(_root_mean_square(in_cells), LEAST_LEVER_M / cell_m)
    bent = curvature(field.values, in_cells, start, sigma, lever) / SHARPNESS + np.diag(pull)
    inverse = np.linalg.inv(_floored(bent, lever, FLATTEST / sigma**2)).astype(np.float64)
    found = climb(field.values, in_cells, start, inverse, lever, given, pull)
    pose = found * unit + origin
    pose[2] = math.remainder(pose[2], math.tau)
    # A return on a wall bends its own likelihood by 1 / sigma^2 across it, and is worth an observation there.
    bent = curvature(field.values, in_cells, found, sigma, lever) / SHARPNESS
    information = _floored(worth * bent, lever, LEAST_INFORMATION * cell_m**2) / np.outer(unit, unit)
    return Match(
        pose,
        float(mean_value(field.values, in_cells, found)),
        information,
        _inside(field, in_cells, found),
    )


def _best_of_grid(
    field: LikelihoodField,
    points: NDArray[np.float64],
    given: NDArray[np.float64],
    search: Search,
    pull: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(3,) the best pose of the grid around `given`; lengths in cells. pull: (3,), see climb()."""
    turn_rad = search.yaw_step_rad
    half_cells, half_turns = round(search.xy_m / field.resolution_m), round(search.yaw_rad / turn_rad)
    levels_per_pull = 0.5 * TOP_LEVEL * len(points)
    per_cell, per_turn = levels_per_pull * float(pull[0]), levels_per_pull * float(pull[2]) * turn_rad**2
    dx, dy, turns, _ = search_poses(
        field.levels, field.blocks, points, given, half_cells, half_turns, turn_rad, per_cell, per_turn
    )
    best: NDArray[np.float64] = given + np.array([dx, dy, turns * turn_rad])
    return best


def _root_mean_square(points: NDArray[np.float64]) -> float:
    return math.sqrt(float((points * points).sum()) / max(len(points), 1))


def _floored(matrix: NDArray[np.float64], lever: float, least: float) -> NDArray[np.float64]:
    """The symmetric (3, 3) matrix with eigenvalues of at least `least`, yaw counted in arcs at the lever."""
    scale = np.outer(np.array([1.0, 1.0, lever]), np.array([1.0, 1.0, lever]))
    sizes, axes = np.linalg.eigh(matrix / scale)
    floored: NDArray[np.float64] = (axes * np.maximum(sizes, least)) @ axes.T
    return 0.5 * (floored + floored.T) * scale


def _inside(field: LikelihoodField, points: NDArray[np.float64], pose: NDArray[np.float64]) -> float:
    """points and pose with lengths in cells from the field's corner."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    u = pose[0] + c * points[:, 0] - s * points[:, 1]
    v = pose[1] + s * points[:, 0] + c * points[:, 1]
    height, width = field.values.shape
    on_field = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    return float(np.count_nonzero(on_field)) / max(len(points), 1)
