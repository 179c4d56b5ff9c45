"""Where in the whole map does this scan fit? Branch and bound over all free places and headings.

After Hess et al., "Real-time loop closure in 2D lidar SLAM" (ICRA 2016): the score of a scan on a map whose
cells hold the best of their surroundings bounds its score at every place therein. Decides which places are
worth a closer look; whether one of them is believed is localizer.py's affair. A search is a value: every call
does a bounded amount of work and gives the next one. Scores are integers, so they are the same everywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.maps.occupancy_grid import FREE
from hippomat_core.planning.costmap import Costmap
from hippomat_core.replaced import replace
from hippomat_core.slam.pose2 import Pose

LEAF_M = 0.10  # places are told apart this finely; the scan matcher does the rest
LEVELS = 5  # squares of 0.1, 0.2, 0.4, 0.8 and 1.6 m
SIGMA_M = 0.15  # how far beside a wall a return still counts: half a leaf, half a heading at some metres
HEADINGS = 144  # 2.5 degrees apart
TURN_RAD = math.tau / HEADINGS
BEAMS = 48  # of the scan are used
REACH_M = 10.0  # beams longer than this need finer headings
KEPT = 0.8  # places with this share of the best one's score are looked at closer
FLOOR = 0.35  # and none below this share of a perfect score
PLACES = 24  # at most
APART_LEAVES, APART_HEADINGS = 5, 8  # nearer ones are one place
WORK = 1_500_000  # cell look-ups per call: some milliseconds


@dataclass(frozen=True, slots=True, eq=False)
class Pyramid:
    """A map made ready for searching. Level 0 has cells of LEAF_M, each next one of twice that.

    best[k] (H_k, W_k): the highest value in the 2 x 2 cells from there on, 0 .. 255, at a wall 255
    open[k] (H_k, W_k): 1 where the robot can stand somewhere in the cell
    """

    best: tuple[NDArray[np.uint8], ...]
    open: tuple[NDArray[np.uint8], ...]
    leaf_m: float
    origin_x_m: float
    origin_y_m: float


def pyramid_of(costmap: Costmap, body_m: float) -> Pyramid:
    """body_m: the robot's radius; it stands where nothing is nearer."""
    grid = costmap.grid
    factor = max(round(LEAF_M / grid.resolution_m), 1)
    away = costmap.clearance_m.astype(np.float64)
    value = np.rint(255.0 * np.exp(-0.5 * (away / SIGMA_M) ** 2)).astype(np.uint8)
    stand = ((grid.cells == FREE) & (away >= min(body_m, 0.1))).astype(np.uint8)
    values, opens = [_pooled(value, factor)], [_pooled(stand, factor)]
    for _ in range(LEVELS - 1):
        values.append(_pooled(values[-1], 2))
        opens.append(_pooled(opens[-1], 2))
    leaf_m = factor * grid.resolution_m
    return Pyramid(
        tuple(_with_neighbours(level) for level in values),
        tuple(opens),
        leaf_m,
        grid.origin_x_m,
        grid.origin_y_m,
    )


def _pooled(cells: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """The highest of each factor x factor cells."""
    height, width = (-(-side // factor) for side in cells.shape)
    padded = np.zeros((height * factor, width * factor), np.uint8)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    return np.ascontiguousarray(padded.reshape(height, factor, width, factor).max(axis=(1, 3)))


def _with_neighbours(cells: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H + 1, W + 1): [iy, ix] is the highest of the cells (iy - 1 .. iy, ix - 1 .. ix)."""
    padded = np.zeros((cells.shape[0] + 2, cells.shape[1] + 2), np.uint8)
    padded[1:-1, 1:-1] = cells
    rows = np.maximum(padded[:-1], padded[1:])
    return np.ascontiguousarray(np.maximum(rows[:, :-1], rows[:, 1:]))


@dataclass(frozen=True, slots=True, eq=False)
class Relocalization:
    """A search under way. First every coarse square is bounded, then they are opened, best bound first."""

    offsets: NDArray[np.int32]  # (HEADINGS, LEVELS, 2, n) returns relative to the robot, in whole squares
    bounds: NDArray[np.int32]  # (HEADINGS, squares) of the coarsest level; filled up to `heading`
    heading: int = 0
    order: NDArray[np.int32] | None = None  # squares of all headings, best bound first
    opened: int = 0
    places: NDArray[np.float64] = field(
        default_factory=lambda: np.zeros((0, 4))
    )  # (k, 4) leaf x, y, heading, score
    done: bool = False


def begun(pyramid: Pyramid, points: NDArray[np.float64]) -> Relocalization:
    """A new search for where these returns (n, 2) [m], base frame, were seen."""
    near = points[np.hypot(points[:, 0], points[:, 1]) <= REACH_M]
    chosen = np.unique(np.linspace(0, max(len(near) - 1, 0), BEAMS).astype(np.int64))
    squares = pyramid.open[-1].size
    bounds = np.zeros((HEADINGS, squares), np.int32)
    offsets = _offsets(near[chosen] if len(near) else near, pyramid.leaf_m)
    return Relocalization(offsets, bounds, done=not len(near))


def _offsets(points: NDArray[np.float64], leaf_m: float) -> NDArray[np.int32]:
    """A return of a robot in square i lies in the square i + offset or in the next one."""
    yaw_rad = np.arange(HEADINGS) * TURN_RAD
    turned = np.exp(1j * yaw_rad)[:, None] * (points[:, 0] + 1j * points[:, 1])
    sizes_m = leaf_m * 2.0 ** np.arange(LEVELS)
    both = np.stack([turned.real, turned.imag], axis=1)  # (HEADINGS, 2, n)
    squares: NDArray[np.int32] = np.floor(both[:, None] / sizes_m[:, None, None]).astype(np.int32)
    return squares


def continued(search: Relocalization, pyramid: Pyramid) -> Relocalization:
    """The search after one more piece of work."""
    if search.done:
        return search
    if search.heading < HEADINGS:
        return _bounded(search, pyramid)
    return _opened(search, pyramid)


def candidates(search: Relocalization, pyramid: Pyramid) -> tuple[Pose, ...]:
    """Where it fits, best first; the search must be done."""
    leaf_m, x_m, y_m = pyramid.leaf_m, pyramid.origin_x_m, pyramid.origin_y_m
    return tuple(
        (x_m + (ix + 0.5) * leaf_m, y_m + (iy + 0.5) * leaf_m, math.remainder(heading * TURN_RAD, math.tau))
        for ix, iy, heading, _ in search.places.tolist()
    )


def _bounded(search: Relocalization, pyramid: Pyramid) -> Relocalization:
    per_heading = max(int(pyramid.open[-1].sum()) * search.offsets.shape[3], 1)
    until = min(search.heading + max(WORK // per_heading, 1), HEADINGS)
    bounds = search.bounds.copy()
    for heading in range(search.heading, until):
        _bound_squares(pyramid.best[-1], pyramid.open[-1], search.offsets[heading, -1], bounds[heading])
    if until < HEADINGS:
        return replace(search, bounds=bounds, heading=until)
    flat = bounds.ravel()
    promising = np.flatnonzero(flat >= FLOOR * 255 * search.offsets.shape[3])
    order = promising[np.argsort(-flat[promising], kind="stable")].astype(np.int32)
    return replace(search, bounds=bounds, heading=until, order=order)


def _opened(search: Relocalization, pyramid: Pyramid) -> Relocalization:
    assert search.order is not None
    places = np.zeros((PLACES + 1, 4))
    places[: len(search.places)] = search.places
    opened, count, done = _open_squares(
        pyramid.best,
        pyramid.open,
        search.offsets,
        search.bounds.ravel(),
        search.order,
        search.opened,
        places,
        len(search.places),
    )
    kept = places[:count].copy()
    if done and count:
        kept = kept[kept[:, 3] >= KEPT * kept[0, 3]]
    return replace(search, opened=opened, places=kept, done=done)


# ---- kernels ------------------------------------------------------------------------------------


@njit(cache=True)
def _bound_squares(best, stand, offsets, out):  # type: ignore[no-untyped-def]
    """Upper bounds of the score (0 .. 255 per return) anywhere in each square of one level."""
    height, width = stand.shape
    for iy in range(height):
        for ix in range(width):
            if stand[iy, ix]:
                out[iy * width + ix] = _bound(best, offsets, ix, iy)


@njit(cache=True)
def _bound(best, offsets, ix, iy):  # type: ignore[no-untyped-def]
    total = 0
    for k in range(offsets.shape[1]):
        x, y = ix + offsets[0, k] + 1, iy + offsets[1, k] + 1  # best[j] covers the squares j - 1 and j
        if 0 <= y < best.shape[0] and 0 <= x < best.shape[1]:
            total += best[y, x]
    return total


@njit(cache=True)
def _open_squares(best, stand, offsets, bounds, order, opened, places, count):  # type: ignore[no-untyped-def]
    """Look into squares, best bound first, until none is promising (done) or WORK is spent."""
    squares = stand[LEVELS - 1].size
    perfect = 255.0 * offsets.shape[3]
    work = 0
    while work < WORK:
        least = max(FLOOR, KEPT * places[0, 3] if count else 0.0)
        if opened >= len(order) or bounds[order[opened]] < least * perfect:
            return opened, count, True
        heading, square = order[opened] // squares, order[opened] % squares
        count, looked = _open_square(best, stand, offsets[heading], square, places, count, heading)
        opened += 1
        work += looked
    return opened, count, False


@njit(cache=True)
def _open_square(best, stand, offsets, square, places, count, heading):  # type: ignore[no-untyped-def]
    """Look into one coarse square, depth first; `places` (PLACES + 1, 4) is filled in order of score.

    Returns how many places there are now, and the work. x and y of a place in leaves, its yaw in headings.
    """
    top, beams = LEVELS - 1, offsets.shape[2]
    stack = np.empty((3 * LEVELS + 4, 3), np.int64)
    width = stand[top].shape[1]
    stack[0] = top, square % width, square // width
    depth, looked = 1, 0
    while depth:
        depth -= 1
        level, ix, iy = stack[depth]
        score = _bound(best[level], offsets[level], ix, iy) / (255.0 * beams)
        looked += beams
        if score < max(FLOOR, KEPT * places[0, 3] if count else 0.0):
            continue
        if level == 0:
            count = _insert(places, count, ix, iy, heading, score)
            continue
        for child in range(4):
            cx, cy = 2 * ix + child % 2, 2 * iy + child // 2
            if _stands(stand[level - 1], cx, cy):
                stack[depth] = level - 1, cx, cy
                depth += 1
    return count, looked


@njit(cache=True)
def _stands(cells, ix, iy):  # type: ignore[no-untyped-def]
    return iy < cells.shape[0] and ix < cells.shape[1] and cells[iy, ix] > 0


@njit(cache=True)
def _insert(places, count, ix, iy, heading, score):  # type: ignore[no-untyped-def]
    """Keep one place per neighbourhood, best first, at most PLACES."""
    for k in range(count):
        turn = abs(heading - places[k, 2])
        turn = min(turn, HEADINGS - turn)
        if math.hypot(ix - places[k, 0], iy - places[k, 1]) < APART_LEAVES and turn < APART_HEADINGS:
            if score <= places[k, 3]:
                return count
            for j in range(k, count - 1):
                places[j] = places[j + 1]
            count -= 1
            break
    at = count
    while at > 0 and places[at - 1, 3] < score:
        places[at] = places[at - 1]
        at -= 1
    places[at, 0], places[at, 1], places[at, 2], places[at, 3] = ix, iy, heading, score
    return min(count + 1, PLACES)
