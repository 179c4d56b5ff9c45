"""The cases: one function each, named by what the robot does. Inputs are seeded and made here."""

from __future__ import annotations

import dataclasses
import heapq
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from mcap_ros2._dynamic import serialize_dynamic
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from benchmarks.measure import Result, compare
from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.port import Problem
from hippomat_core.config import Config
from hippomat_core.control.follower import Drive, Motion, follow
from hippomat_core.control.guard import CRAWL_MPS, guard
from hippomat_core.control.stopping import STEP_M
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import StateHeard
from hippomat_core.planning.astar import shortest_path
from hippomat_core.planning.costmap import Costmap, inflate
from hippomat_core.planning.distance_field import distance_at, distance_field
from hippomat_core.wire.codec import decode_frame, encode_frame
from hippomat_core.wire.frames import NO_CLAIM, STATE, Header, StateFrame
from hippomat_logs.schema import MessageStore, type_name
from hippomat_sim.radio import load_library

ROBOTS = TASKS = 30
Cell = tuple[int, int]


@cache
def _hall() -> tuple[Costmap, Cell, Cell]:
    """A seeded 20 x 20 m hall with crates, at 0.05 m; and two far corners of it."""
    random = np.random.default_rng(3)
    cells = np.zeros((400, 400), np.int8)
    for ix, iy in random.integers(20, 370, (60, 2)):
        cells[iy : iy + 14, ix : ix + 14] = 100
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    return inflate(OccupancyGrid(cells, 0.05, 0.0, 0.0), 0.17), (8, 8), (390, 390)


def distance_field_of_a_task() -> Result:
    costmap, start, goal = _hall()
    ours = distance_field(costmap, goal)
    theirs = _plain_dijkstra(costmap, goal)
    assert math.isclose(ours[start[1], start[0]], theirs[start[1], start[0]], rel_tol=1e-4)
    return compare(
        "distance field, 400 x 400 cells",
        lambda: distance_field(costmap, goal),
        "heapq Dijkstra in Python",
        lambda: _plain_dijkstra(costmap, goal),
        pairs=3,
    )


def costs_of_a_round() -> Result:
    costmap, start, _ = _hall()
    sites = costmap.graph.cells[:: len(costmap.graph.cells) // TASKS][:TASKS]
    fields = [distance_field(costmap, (int(ix), int(iy))) for ix, iy in sites]
    x_m, y_m = costmap.grid.centre_of(*start)
    goals = [(int(ix), int(iy)) for ix, iy in sites]
    return compare(
        f"travel costs of a round, {TASKS} tasks (fields kept)",
        lambda: [distance_at(costmap, field, x_m, y_m) for field in fields],
        "A* per task, heapq",
        lambda: [shortest_path(costmap, start, goal) for goal in goals],
        pairs=3,
    )


def path_around_peers() -> Result:
    costmap, start, goal = _hall()
    field = distance_field(costmap, goal)
    return compare(
        "re-planned path, exact field as heuristic",
        lambda: shortest_path(costmap, start, goal, None, field),
        "the same A*, octile heuristic",
        lambda: shortest_path(costmap, start, goal),
        pairs=5,
    )


def path_following() -> Result:
    costmap, start, goal = _hall()
    path = shortest_path(costmap, start, goal)
    assert path is not None
    ahead, config = costmap.centres(path[40:64]), Config()
    x_m, y_m = ahead[0].tolist()
    motion, last = Motion(x_m - 0.05, y_m - 0.05, 0.8, 0.2), Drive(0.2)
    return compare(
        "one command along a path, 24 cells ahead",
        lambda: follow(ahead, 1.0, motion, last, 0.05, config, costmap),
        "its pursued point alone, in Python",
        lambda: _pursued_in_python(ahead, motion, costmap),
    )


def scan_guard() -> Result:
    """Two metres of corridor and a thing ahead, 360 returns, four peers; the same arc as NumPy arrays."""
    angle = np.linspace(-math.pi, math.pi, 360)
    walls = np.stack([1.5 * np.cos(angle), 0.25 * np.sign(np.sin(angle)) + 0.02 * np.sin(9 * angle)], axis=1)
    points = np.concatenate([walls, [[0.2, 0.02], [0.21, 0.0]]])
    peers, config, v, wz = np.array([[1.0, k - 1.5, 0.12] for k in range(4)]), Config(), 0.2, 0.3
    ours = guard(points, v, wz, peers, config)
    theirs = _guarded_with_arrays(points, v, wz, peers, config)
    assert math.isclose(ours.v_mps, theirs, abs_tol=0.02), (ours, theirs)
    return compare(
        "scan guard, 362 returns, 4 peers",
        lambda: guard(points, v, wz, peers, config),
        "the same arc in NumPy",
        lambda: _guarded_with_arrays(points, v, wz, peers, config),
    )


def allocation() -> Result:
    problem = _problem()
    allocator = make_allocator("hungarian", None, ROBOTS, TASKS)
    costs = problem.costs_q.astype(np.float64)
    return compare(
        f"Hungarian on the snapshot, {ROBOTS} x {TASKS}",
        lambda: allocator.allocate(problem),
        "scipy linear_sum_assignment",
        lambda: linear_sum_assignment(costs),
    )


def state_decoding() -> Result:
    data = encode_frame(Header(STATE, False, 1, 2, 3, 4, 5), _state())
    library = load_library()
    return compare(
        f"STATE decoded and checked, M = {TASKS}",
        lambda: decode_frame(data),
        "the radio core's check in C",
        lambda: library.lib.rc_frame_valid(data, len(data)),
    )


def record_encoding() -> Result:
    store = MessageStore()
    heard = StateHeard(1, 2, 3, -40, Header(STATE, False, 1, 2, 3, 4, 5), _state())
    name = type_name(StateHeard)
    text = store.schema_text(name).decode()
    encoder = serialize_dynamic(name, text)[name]
    plain = _with_lists(dataclasses.asdict(heard))  # mcap_ros2 takes lists, not arrays
    return compare(
        "one STATE record encoded (CDR)",
        lambda: store.encode(heard),
        "mcap_ros2",
        lambda: encoder(plain),
    )


def _pursued_in_python(ahead: NDArray[np.float64], motion: Motion, costmap: Costmap) -> tuple[float, float]:
    """The farthest point within 0.2 m that is in sight, looked for every 2 cm."""
    chosen = (motion.x_m, motion.y_m)
    for x, y in ahead.tolist():
        away_m = math.hypot(x - motion.x_m, y - motion.y_m)
        count = max(2, math.ceil(away_m / 0.02))
        line = [
            (motion.x_m + k / count * (x - motion.x_m), motion.y_m + k / count * (y - motion.y_m))
            for k in range(count + 1)
        ]
        if away_m > 0.2 or not all(costmap.is_free(costmap.grid.cell_of(*place)) for place in line):
            break
        chosen = (x, y)
    return chosen


def _guarded_with_arrays(
    points: NDArray[np.float64], v: float, wz: float, peers: NDArray[np.float64], config: Config
) -> float:
    """The guard's speed for a disc, every point against every step of the arc."""
    decel, latency_s = config.limits.decel_mps2, config.guard.latency_s
    stop_m = v * latency_s + v * v / (2.0 * decel)
    reach_m = config.robot.radius_m + config.guard.margin_m
    xy = np.concatenate([points, peers[:, :2]])
    gap_m = np.concatenate([np.full(len(points), reach_m), peers[:, 2] + reach_m])
    now_m = np.hypot(xy[:, 0], xy[:, 1])
    along = np.minimum(np.arange(1, math.ceil(stop_m / STEP_M) + 1) * STEP_M, stop_m)
    yaw = along * wz / v
    away_m = np.hypot(xy[:, 0, None] - np.sin(yaw) * v / wz, xy[:, 1, None] - (1.0 - np.cos(yaw)) * v / wz)
    hit = (away_m < np.minimum(gap_m, now_m - 0.001)[:, None]).any(axis=0)
    free_m = max(float(along[int(np.argmax(hit))]) - STEP_M, 0.0) if hit.any() else stop_m
    if free_m >= stop_m:
        return v
    speed = decel * (math.sqrt(latency_s * latency_s + 2.0 * free_m / decel) - latency_s)
    return speed if speed >= CRAWL_MPS else 0.0


def _with_lists(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _with_lists(item) for key, item in value.items()}
    return value.tolist() if isinstance(value, np.ndarray) else value


def _problem() -> Problem:
    random = np.random.default_rng(1)
    return Problem(
        random.integers(0, 255, (ROBOTS, TASKS)).astype(np.uint8),
        np.ones(ROBOTS, bool),
        np.zeros(ROBOTS, bool),
        np.ones(TASKS, bool),
        np.ones(ROBOTS, bool),
        np.zeros(ROBOTS, bool),
        np.zeros(ROBOTS, np.float32),
        3,
        1,
        1,
    )


def _state() -> StateFrame:
    zeros = np.zeros(TASKS, np.uint8)
    return StateFrame(
        0, 2, 100, 200, 0, 17, 5, NO_CLAIM, zeros + 9, zeros + 1, 10, 20, 0, zeros[:12], 5,
        zeros[:ROBOTS], 0xABCD, 0xEF, 0,
    )  # fmt: skip


def _plain_dijkstra(costmap: Costmap, goal: Cell) -> NDArray[np.float64]:
    """The textbook way: a heap, a dictionary, eight neighbours, no corner cutting."""
    free, resolution_m = costmap.free.tolist(), costmap.grid.resolution_m
    done: dict[Cell, float] = {}
    heap = [(0.0, goal)]
    while heap:
        way, (ix, iy) = heapq.heappop(heap)
        if (ix, iy) in done:
            continue
        done[ix, iy] = way
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                if (dx or dy) and free[iy + dy][ix + dx] and free[iy][ix + dx] and free[iy + dy][ix]:
                    heapq.heappush(heap, (way + math.hypot(dx, dy), (ix + dx, iy + dy)))
    field = np.full(costmap.free.shape, math.inf)
    for (ix, iy), way in done.items():
        field[iy, ix] = way * resolution_m
    return field


CASES: dict[str, Callable[[], Result]] = {
    case.__name__: case
    for case in (
        distance_field_of_a_task,
        costs_of_a_round,
        path_around_peers,
        path_following,
        scan_guard,
        allocation,
        state_decoding,
        record_encoding,
    )
}
