"""Compiled loops give, bit for bit, what whole-array expressions give: recorded runs were made with those."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from hippomat_core.allocation.quantise import FULL_SCALE, quantise
from hippomat_core.config import LidarConfig
from hippomat_core.control.guard import HOLE_Q6, TURN_Q6, is_whole, returns, scan_points
from hippomat_core.control.path_kernels import nearest_point, ways_m
from hippomat_core.control.scan_kernels import nearer_than
from hippomat_core.control.stopping import carried, kept_clear_of
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import ScanReceived
from hippomat_core.planning.astar import path_length_m
from hippomat_core.planning.costmap import inflate
from hippomat_core.planning.graph import DIAGONAL, STRAIGHT
from hippomat_core.planning.reservations import Taken, decode_intent, encode_intent, free_stretch
from hippomat_core.planning.taken_kernels import TOLERANCE_M, discs_from
from hippomat_core.wire.frames import UNREACHABLE

Floats = NDArray[np.float64]
metres = st.floats(-4.0, 4.0)
points = st.integers(1, 12).flatmap(lambda n: arrays(np.float64, (n, 2), elements=metres))
moves = st.lists(st.tuples(st.integers(-1, 1), st.integers(-1, 1)), max_size=30)


def path_of(steps: list[tuple[int, int]]) -> NDArray[np.int32]:
    return np.cumsum(np.array([(50, 60), *steps], np.int32), axis=0, dtype=np.int32)


def same_bits(one: NDArray[np.generic], other: NDArray[np.generic]) -> bool:
    return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()


@st.composite
def tables(draw: st.DrawFn) -> Floats:
    """(T, 6) as reserve() collects discs; some hold the origin, some of the same robot overlap."""
    rows = st.tuples(
        metres, metres, st.floats(0.05, 3.0), st.floats(0.0, 2.0), st.integers(-1, 2), st.booleans()
    )
    return np.array(draw(st.lists(rows, max_size=10)), np.float64).reshape(-1, 6)


@given(tables())
def test_discs_are_what_numpy_makes_of_their_table(table: Floats) -> None:
    made = discs_from(table, 0.1, -0.2)
    away_m = np.hypot(table[:, 0] - 0.1, table[:, 1] + 0.2)
    inside = away_m < table[:, 2]
    radius_m = np.where(inside, np.maximum(away_m - TOLERANCE_M, 0.0), table[:, 2])
    wanted = (table[:, :2], radius_m, table[:, 3], table[:, 4].astype(np.int32), table[:, 5] > 0, inside)
    assert all(same_bits(one, other) for one, other in zip(made, wanted, strict=True))


@given(tables(), points, st.floats(0.0, 1.0))
def test_a_free_stretch_is_what_numpy_finds(table: Floats, way: Floats, slack_s: float) -> None:
    taken, at_s = Taken(*discs_from(table, 0.0, 0.0)), ways_m(way, 0.0, 0.0) / 0.4
    assert free_stretch(taken, way, at_s, slack_s) == numpys_stretch(taken, way, at_s, slack_s)


def numpys_stretch(taken: Taken, way: Floats, at_s: Floats, slack_s: float) -> tuple[int, int]:
    dx, dy = way[:, 0, None] - taken.xy[:, 0], way[:, 1, None] - taken.xy[:, 1]
    overlap = dx * dx + dy * dy < taken.radius_m**2
    fails = overlap & (at_s[:, None] + slack_s > taken.from_s)
    if not fails.any():
        return len(way), -1
    first = int(np.argmax(fails.any(axis=1)))
    owner = int(taken.robot[int(np.argmax(fails[first]))])
    theirs = overlap[:, taken.robot == owner].any(axis=1)
    while first > 0 and theirs[first - 1]:
        first -= 1
    return first, owner


@given(points, metres, metres)
def test_places_along_a_path_are_what_numpy_finds(way: Floats, x_m: float, y_m: float) -> None:
    away_m = np.hypot(way[:, 0] - x_m, way[:, 1] - y_m)
    nearest, off_m = nearest_point(way, x_m, y_m)
    assert (nearest, off_m) == (int(np.argmin(away_m)), float(away_m.min()))
    legs = np.diff(np.concatenate([[(x_m, y_m)], way]), axis=0)
    assert same_bits(ways_m(way, x_m, y_m), np.hypot(legs[:, 0], legs[:, 1]).cumsum())


@given(points, st.floats(-math.pi, math.pi), metres, metres)
def test_points_are_carried_as_numpy_carries_them(seen: Floats, turn: float, dx: float, dy: float) -> None:
    c, s = math.cos(turn), math.sin(turn)
    x, y = seen[:, 0], seen[:, 1]
    assert same_bits(carried(seen, c, s, dx, dy), np.stack([c * x - s * y + dx, s * x + c * y + dy], axis=1))


@given(points, metres)
def test_points_near_a_place_are_what_numpy_finds(seen: Floats, limit_m: float) -> None:
    near = np.hypot(seen[:, 0] - 0.1, seen[:, 1] + 0.2) < limit_m
    assert same_bits(nearer_than(seen, 0.1, -0.2, limit_m), seen[near])


@given(st.integers(1, 60).flatmap(lambda n: arrays(np.uint16, (2, n))), st.floats(-4.0, 4.0))
def test_a_sweep_becomes_the_points_that_numpy_makes_of_it(
    samples: NDArray[np.uint16], yaw_rad: float
) -> None:
    angle_q6, distance_q2 = samples
    scan = ScanReceived(0, np.zeros(len(angle_q6), np.uint8), angle_q6, distance_q2)
    lidar = LidarConfig(yaw_rad=yaw_rad, x_m=0.03, y_m=-0.01)
    range_m = distance_q2 / 4000.0
    kept = (distance_q2 > 0) & (range_m >= lidar.min_range_m) & (range_m <= lidar.max_range_m)
    assert same_bits(returns(scan, lidar), kept)
    angle_rad = yaw_rad - np.deg2rad(angle_q6[kept] / 64.0)
    x_m, y_m = 0.03 + range_m[kept] * np.cos(angle_rad), -0.01 + range_m[kept] * np.sin(angle_rad)
    assert same_bits(scan_points(scan, lidar), np.stack([x_m, y_m], axis=1))
    angles = np.sort(angle_q6 % TURN_Q6).astype(np.int64)
    gaps = [*np.diff(angles), TURN_Q6 - angles[-1] + angles[0]]
    assert is_whole(scan) == (max(gaps) <= HOLE_Q6)


def test_what_is_kept_clear_of_is_all_that_is_seen_and_all_peers_with_their_size() -> None:
    seen, peers = np.array([[1.0, 2.0]]), np.array([[3.0, 4.0, 0.15], [5.0, 6.0, 0.25]])
    xy, size_m, gap_m = kept_clear_of(seen, peers, 0.1, 0.02)
    assert xy.tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
    assert same_bits(size_m, np.array([0.1, 0.1 + 0.15, 0.1 + 0.25]))
    assert same_bits(gap_m, size_m + 0.02)


@given(moves)
def test_cells_lie_where_the_grid_says_and_paths_are_as_long_as_their_moves(
    steps: list[tuple[int, int]],
) -> None:
    path, grid = path_of(steps), OccupancyGrid(np.zeros((120, 120), np.int8), 0.05, -1.3, 0.7)
    middles = inflate(grid, 0.1).centres(path)
    assert [tuple(middle) for middle in middles.tolist()] == [grid.centre_of(*cell) for cell in path.tolist()]
    lengths = [DIAGONAL if dx and dy else STRAIGHT for dx, dy in steps]
    assert path_length_m(path, 0.05) == sum(lengths) * 0.05 / STRAIGHT


@given(arrays(np.uint8, st.integers(0, 12)))
def test_an_intent_is_the_sum_of_its_moves(steps: NDArray[np.uint8]) -> None:
    moved = np.stack([steps.astype(np.int32) % 3 - 1, steps.astype(np.int32) // 3 % 3 - 1], axis=1)
    cells = decode_intent(7, 9, steps)
    assert same_bits(
        cells, np.concatenate([np.array([(7, 9)], np.int32), moved]).cumsum(axis=0, dtype=np.int32)
    )
    assert not cells.flags.writeable
    if (steps // 9 == 1).all():  # what robots on the ground send
        assert same_bits(encode_intent(cells)[2], steps)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=12), st.floats(0.1, 100.0))
@pytest.mark.filterwarnings("ignore:overflow")
def test_costs_are_quantised_as_numpy_would(costs_s: list[float], c_max_s: float) -> None:
    costs = np.array(costs_s, np.float64)
    finite = np.isfinite(costs)
    share = np.minimum(np.maximum(np.where(finite, costs, 0.0) / c_max_s, 0.0), 1.0)
    wanted = np.where(finite, np.rint(FULL_SCALE * np.sqrt(share)), UNREACHABLE).astype(np.uint8)
    assert same_bits(quantise(costs, c_max_s), wanted)
