"""Which places are free and which are not: rays from the lidar to its returns, as evidence per cell.

Evidence adds up as log odds in whole hundredths, so that the order of the scans changes nothing. Within one
scan a cell counts once, and a return in it outweighs the rays that pass. Knows poses and points, not how they
were found.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.maps.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from hippomat_core.replaced import replace
from hippomat_core.slam.poses import composed, placed

HIT, MISS = 200, -115  # hundredths of log odds: a third of the looks at a cell must have met something
OCCUPIED_FROM, FREE_TO = 62, -110  # map_server's 0.65 and 0.25
TILE = 64  # a grid grows by whole tiles, so that it seldom has to

NOTHING, PASSED, RETURNED = 0, 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Log odds of being occupied, per cell of the map frame; 0 where nothing was seen."""

    log_odds: NDArray[np.int32]  # (H, W) [iy, ix], hundredths
    resolution_m: float
    left: int  # column and row of cell (0, 0), counted from the map's origin
    low: int

    def grid(self) -> OccupancyGrid:
        """The map to save: occupied, free, and unknown where evidence is thin or contradicts itself."""
        cells = np.full(self.log_odds.shape, UNKNOWN, np.int8)
        cells[self.log_odds >= OCCUPIED_FROM] = OCCUPIED
        cells[self.log_odds <= FREE_TO] = FREE
        resolution_m = self.resolution_m
        return OccupancyGrid(cells, resolution_m, self.left * resolution_m, self.low * resolution_m)


def no_evidence(resolution_m: float) -> Evidence:
    """Nothing was seen yet."""
    return Evidence(np.zeros((1, 1), np.int32), resolution_m, 0, 0)


@dataclass(frozen=True, slots=True)
class Lidar:
    """Where rays start and how far they are believed."""

    x_m: float = 0.0  # in the base frame
    y_m: float = 0.0
    max_range_m: float = 25.0  # farther returns only say that the way to there is free


def with_scans(
    evidence: Evidence, scans: list[NDArray[np.float64]], poses: NDArray[np.float64], lidar: Lidar
) -> Evidence:
    """The evidence with these scans added: scans[k] (n, 2) [m] in the base frame at poses[k] (3,)."""
    if not scans:
        return evidence
    hits = [placed(points, pose) for points, pose in zip(scans, poses, strict=True)]
    starts = composed(poses, np.array([lidar.x_m, lidar.y_m, 0.0]))[:, :2]
    boxes = [_box(start, points, lidar.max_range_m) for start, points in zip(starts, hits, strict=True)]
    low, high = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
    grown = _grown(evidence, low, high)
    resolution_m = grown.resolution_m
    corner = np.array([grown.left, grown.low], np.float64)
    for start, points in zip(starts, hits, strict=True):
        reach = lidar.max_range_m / resolution_m
        _cast(grown.log_odds, start / resolution_m - corner, points / resolution_m - corner, reach)
    return grown


def _box(
    start: NDArray[np.float64], points: NDArray[np.float64], reach_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower left and upper right [m] of what the rays touch."""
    everything = np.concatenate([start[None, :], points])
    low, high = everything.min(axis=0), everything.max(axis=0)
    return np.maximum(low, start - reach_m), np.minimum(high, start + reach_m)


def _grown(evidence: Evidence, low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> Evidence:
    """A copy that covers low .. high [m] too, with a cell to spare on each side."""
    resolution_m = evidence.resolution_m
    height, width = evidence.log_odds.shape
    left = min(evidence.left, TILE * math.floor((low_m[0] / resolution_m - 1) / TILE))
    low = min(evidence.low, TILE * math.floor((low_m[1] / resolution_m - 1) / TILE))
    right = max(evidence.left + width, TILE * math.ceil((high_m[0] / resolution_m + 2) / TILE))
    top = max(evidence.low + height, TILE * math.ceil((high_m[1] / resolution_m + 2) / TILE))
    if (left, low, right - left, top - low) == (evidence.left, evidence.low, width, height):
        return replace(evidence, log_odds=evidence.log_odds.copy())
    log_odds = np.zeros((top - low, right - left), np.int32)
    dx, dy = evidence.left - left, evidence.low - low
    log_odds[dy : dy + height, dx : dx + width] = evidence.log_odds
    return Evidence(log_odds, resolution_m, left, low)


@njit(cache=True, nogil=True)
def _cast(
    log_odds: NDArray[np.int32], start: NDArray[np.float64], points: NDArray[np.float64], reach: float
) -> None:
    """Adds one scan; start (2,), points (n, 2) and reach in cells from the grid's corner."""
    left, low = math.floor(start[0]), math.floor(start[1])
    right, top = left, low
    for k in range(points.shape[0]):
        x, y, _ = _end(start, points[k], reach)
        left, right = min(left, math.floor(x)), max(right, math.floor(x))
        low, top = min(low, math.floor(y)), max(top, math.floor(y))
    met = np.zeros((top - low + 1, right - left + 1), np.uint8)
    for k in range(points.shape[0]):
        x, y, near = _end(start, points[k], reach)
        _pass(met, start[0] - left, start[1] - low, x - left, y - low)
        if near:
            met[math.floor(y) - low, math.floor(x) - left] = RETURNED
    for iy in range(met.shape[0]):
        for ix in range(met.shape[1]):
            if met[iy, ix] == RETURNED:
                log_odds[low + iy, left + ix] += HIT
            elif met[iy, ix] == PASSED:
                log_odds[low + iy, left + ix] += MISS


@njit(cache=True, nogil=True)
def _end(start: NDArray[np.float64], point: NDArray[np.float64], reach: float) -> tuple[float, float, bool]:
    """Where the ray ends, at the point or at the reach, and whether it ends at the point."""
    dx, dy = point[0] - start[0], point[1] - start[1]
    length = math.sqrt(dx * dx + dy * dy)
    if length <= reach:
        return point[0], point[1], True
    return start[0] + dx * reach / length, start[1] + dy * reach / length, False


@njit(cache=True, nogil=True)
def _pass(met: NDArray[np.uint8], x: float, y: float, to_x: float, to_y: float) -> None:
    """Marks every cell that the ray crosses before its last one (Amanatides, Woo 1987)."""
    ix, iy = math.floor(x), math.floor(y)
    last_x, last_y = math.floor(to_x), math.floor(to_y)
    dx, dy = to_x - x, to_y - y
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    per_x = abs(1.0 / dx) if dx != 0.0 else math.inf  # share of the ray per cell
    per_y = abs(1.0 / dy) if dy != 0.0 else math.inf
    next_x = per_x * ((ix + 1 - x) if dx > 0 else (x - ix)) if dx != 0.0 else math.inf
    next_y = per_y * ((iy + 1 - y) if dy > 0 else (y - iy)) if dy != 0.0 else math.inf
    for _ in range(abs(last_x - ix) + abs(last_y - iy)):
        if met[iy, ix] == NOTHING:
            met[iy, ix] = PASSED
        if iy == last_y or (ix != last_x and next_x < next_y):  # rounding never leads past the end
            ix, next_x = ix + step_x, next_x + per_x
        else:
            iy, next_y = iy + step_y, next_y + per_y
