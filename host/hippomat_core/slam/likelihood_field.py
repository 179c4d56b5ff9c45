"""How likely a lidar return is at each place: near 1 on known surfaces, falling off around them.

A point at distance d from the nearest surface point counts exp(-d^2 / (2 sigma^2)) (likelihood field: Thrun,
Burgard, Fox, Probabilistic Robotics, 6.4). Knows surface points, not where or when they were seen, and no
free space: a return behind a wall and one in the open are equally unlikely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.errors import MapError
from hippomat_core.maps.occupancy_grid import OccupancyGrid

SIGMA_M = 0.1
REACH_SIGMAS = 3.0  # beyond it a value is below 0.012 and taken as 0
OCCUPIED_FROM = 65  # map_server's occupied_thresh, in percent
BLOCK = 4  # cells a side that one step of the coarse search covers
TOP_LEVEL = 255
MAX_CELLS = 64_000_000

Bounds = tuple[float, float, float, float]  # x_min, y_min, x_max, y_max [m]


@dataclass(frozen=True, slots=True, eq=False)
class LikelihoodField:
    """Likelihoods on a grid, in the frame of the points it was made of. A value belongs to its cell's centre.

    `levels` and `blocks` are derived: the search adds integers, so that its answer depends on no order.
    """

    values: NDArray[np.float32]  # (H, W) [iy, ix], 0..1
    resolution_m: float
    origin_x_m: float  # lower left corner of cell (0, 0)
    origin_y_m: float
    sigma_m: float = SIGMA_M
    levels: NDArray[np.uint8] = field(init=False, repr=False)  # (H, W) values in steps of 1/255
    blocks: NDArray[np.uint8] = field(init=False, repr=False)  # see _blocks_of

    def __post_init__(self) -> None:
        levels = _levels_of(self.values)
        object.__setattr__(self, "levels", levels)
        object.__setattr__(self, "blocks", _blocks_of(levels))


def field_of_points(
    points: NDArray[np.float64],
    resolution_m: float = 0.05,
    sigma_m: float = SIGMA_M,
    bounds: Bounds | None = None,
) -> LikelihoodField:
    """The field around surface points (n, 2) [m]; it covers `bounds`, or all points and what they reach.

    Its cells lie on multiples of the resolution, so that bounds change no value. Raises MapError above
    MAX_CELLS cells.
    """
    reach_m = REACH_SIGMAS * sigma_m
    if bounds is None:
        low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
        bounds = (low[0] - reach_m, low[1] - reach_m, high[0] + reach_m, high[1] + reach_m)
    left, bottom = math.floor(bounds[0] / resolution_m), math.floor(bounds[1] / resolution_m)
    width = max(math.ceil(bounds[2] / resolution_m) - left, 1)
    height = max(math.ceil(bounds[3] / resolution_m) - bottom, 1)
    if width * height > MAX_CELLS:
        raise MapError(
            f"a likelihood field of {width} x {height} cells is too large (at most {MAX_CELLS}): "
            "limit the range of the points or give a coarser resolution"
        )
    x_m, y_m = left * resolution_m, bottom * resolution_m
    values = _splatted(
        np.ascontiguousarray(points, np.float64), height, width, resolution_m, x_m, y_m, sigma_m, reach_m
    )
    return LikelihoodField(values, resolution_m, x_m, y_m, sigma_m)


def field_of_grid(grid: OccupancyGrid, sigma_m: float = SIGMA_M) -> LikelihoodField:
    """The field around a saved map's occupied cells, on the map's own cells and in its frame."""
    iy, ix = np.nonzero(grid.cells >= OCCUPIED_FROM)
    x_m, y_m, resolution_m = grid.origin_x_m, grid.origin_y_m, grid.resolution_m
    centres = np.stack([x_m + (ix + 0.5) * resolution_m, y_m + (iy + 0.5) * resolution_m], axis=1)
    reach_m = REACH_SIGMAS * sigma_m
    values = _splatted(centres, grid.height, grid.width, resolution_m, x_m, y_m, sigma_m, reach_m)
    return LikelihoodField(values, resolution_m, x_m, y_m, sigma_m)


@njit(cache=True, nogil=True)
def _splatted(
    points: NDArray[np.float64],
    height: int,
    width: int,
    resolution_m: float,
    origin_x_m: float,
    origin_y_m: float,
    sigma_m: float,
    reach_m: float,
) -> NDArray[np.float32]:
    """The values: each point lowers the squared distance [cells^2] of the cells that it reaches."""
    reach = reach_m / resolution_m
    far = np.float32(reach * reach)
    squared = np.full((height, width), far, np.float32)
    for k in range(points.shape[0]):
        u = (points[k, 0] - origin_x_m) / resolution_m - 0.5
        v = (points[k, 1] - origin_y_m) / resolution_m - 0.5
        if not (-reach < u < width + reach and -reach < v < height + reach):
            continue  # also what is not a number
        low_x, high_x = max(math.ceil(u - reach), 0), min(math.floor(u + reach), width - 1)
        for iy in range(max(math.ceil(v - reach), 0), min(math.floor(v + reach), height - 1) + 1):
            beside = np.float32((iy - v) * (iy - v))
            for ix in range(low_x, high_x + 1):
                ahead = np.float32(ix - u)
                squared[iy, ix] = min(squared[iy, ix], beside + ahead * ahead)
    scale = -0.5 * (resolution_m / sigma_m) ** 2
    for iy in range(height):
        for ix in range(width):
            near = squared[iy, ix]
            squared[iy, ix] = np.float32(math.exp(scale * near)) if near < far else np.float32(0.0)
    return squared


@njit(cache=True, nogil=True)
def _levels_of(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    levels = np.empty(values.shape, np.uint8)
    for iy in range(values.shape[0]):
        for ix in range(values.shape[1]):
            levels[iy, ix] = np.uint8(values[iy, ix] * np.float32(TOP_LEVEL) + np.float32(0.5))
    return levels


@njit(cache=True, nogil=True)
def _blocks_of(levels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The highest level that a point can meet while it moves by 0 .. BLOCK - 1 cells in x and y.

    blocks[by + 1, bx + 1] holds for all starts in rows BLOCK * by .. BLOCK * by + BLOCK - 1, columns alike;
    row and column 0 are for starts below and left of the field.
    """
    height, width = levels.shape
    high, wide = (height + BLOCK - 1) // BLOCK, (width + BLOCK - 1) // BLOCK
    own = np.zeros((high + 2, wide + 2), np.uint8)  # each block's own highest level, framed by zeros
    for iy in range(height):
        by = iy // BLOCK + 1
        for ix in range(width):
            bx = ix // BLOCK + 1
            own[by, bx] = max(own[by, bx], levels[iy, ix])
    blocks = np.empty((high + 1, wide + 1), np.uint8)
    for by in range(high + 1):
        for bx in range(wide + 1):
            lower = max(own[by, bx], own[by, bx + 1])
            blocks[by, bx] = max(lower, own[by + 1, bx], own[by + 1, bx + 1])
    return blocks
