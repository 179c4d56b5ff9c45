"""Robots that commit their moves in turn: nobody comes near, nobody waits for ever, under any loss."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_world import TICK_S, Radio, World
from test_control_navigator import CORRIDOR, drawn

from hippomat_core.config import Config, PlanningConfig
from hippomat_core.control.together import Together
from hippomat_core.errors import MapError
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.motion.lattice import NOWHERE, lattice_of
from hippomat_core.planning.costmap import inflate
from hippomat_core.planning.distance_field import distance_field
from hippomat_core.planning.feasibility import path_fault
from hippomat_core.planning.ground import ground_of
from hippomat_sim.maps.demo_room import draw_demo_room

ROOM = draw_demo_room()
SWIFT = (0.02, 0.08)  # [s] a STATE is heard in the round in which it is sent


def committed(world: World) -> list[np.ndarray]:
    """Cells that each robot has committed itself to, its own included."""
    paths = []
    for robot in world.robots:
        own = np.array([world.grid.cell_of(robot.x, robot.y)])
        path = robot.nav.path
        paths.append(own if path is None else np.concatenate([own, path[robot.nav.cursor :]]))
    return paths


def nearest_m(world: World) -> float:
    """Between two commitments."""
    pairs = itertools.combinations(committed(world), 2)
    apart = [np.hypot(*(a[:, None] - b[None]).astype(float).transpose(2, 0, 1)).min() for a, b in pairs]
    return float(min(apart)) * world.grid.resolution_m


@pytest.mark.parametrize(("seed", "loss"), [(1, 0.2), (2, 0.5)])
def test_commitments_stay_apart_and_everybody_gets_on(seed: int, loss: float) -> None:
    world = World(ROOM, 5, seed, Radio(loss, SWIFT), planner="window")
    nearest = np.inf
    while world.tick * TICK_S < 40:
        world.step()
        nearest = min(nearest, nearest_m(world))
    assert world.contacts == []
    assert nearest > 0.24 + 0.02  # two radii; robots keep out 0.30 m of where the others know them to be
    assert world.stuck_s() < 15
    assert min(robot.done for robot in world.robots) >= 1


def test_nobody_is_touched_when_the_radio_is_almost_dead_and_slow() -> None:
    world = World(ROOM, 5, 3, Radio(0.9, (0.05, 0.3)), planner="window")
    world.run(30)
    assert world.contacts == []


@pytest.mark.parametrize("planner", ["window", "pibt"])
def test_two_robots_meeting_in_a_one_lane_corridor_both_get_through(planner: str) -> None:
    grid = drawn(CORRIDOR, 10)
    world = World(grid, 2, 0, Radio(0.2, SWIFT), planner=planner)
    for robot, start, goal in zip(
        world.robots, [(3.5, 1.25), (4.5, 1.25)], [(7.0, 1.25), (1.0, 1.25)], strict=True
    ):
        robot.x, robot.y, robot.yaw, robot.goal = *start, 0.0, goal
        robot.to_goal = distance_field(world.costmap, grid.cell_of(*goal))
    while world.tick * TICK_S < 90 and not all(robot.done for robot in world.robots):
        world.idle |= {k for k, robot in enumerate(world.robots) if robot.done}
        world.step()
    assert [robot.done for robot in world.robots] == [1, 1]
    assert world.contacts == []


def test_equal_seeds_give_equal_runs() -> None:
    runs = []
    for _ in range(2):
        world = World(ROOM, 4, 7, planner="window")
        world.run(8)
        runs.append([(r.x, r.y, r.yaw, r.v, r.wz) for r in world.robots])
    assert runs[0] == runs[1]


@given(number=st.integers(0, 1000), near=st.sets(st.integers(0, 7), min_size=1))
def test_of_robots_that_are_near_each_other_exactly_one_decides_in_an_odd_round(
    number: int, near: set[int]
) -> None:
    deciding = [k for k in near if Together._turn_of(number, k, near - {k}, 8)]
    assert len(deciding) == number % 2


@settings(deadline=None)
@given(
    peer=st.integers(0, 5),
    robot=st.integers(0, 5),
    told=st.integers(0, 40),
    passed=st.integers(0, 12),
    others=st.sets(st.integers(0, 5)),
)
def test_no_turn_of_a_peer_is_missed_whoever_else_is_near_it(
    peer: int, robot: int, told: int, passed: int, others: set[int]
) -> None:
    if peer == robot:
        return
    now = Together(None, told + passed, 0, True)  # type: ignore[arg-type]
    near = (others | {robot}) - {peer}
    real = sum(Together._turn_of(number, peer, near, 6) for number in range(told + 1, told + passed))
    assert now.missed_turns(peer, robot, 6, told) >= real


def test_before_the_first_round_nobody_decides() -> None:
    assert not Together(None, -1, 0, True).turn(0, set(), 5)  # type: ignore[arg-type]


@pytest.mark.parametrize("grid", [ROOM, drawn(CORRIDOR, 10)], ids=["room", "corridor"])
def test_every_move_between_nodes_is_drivable_and_nodes_are_apart(grid: OccupancyGrid) -> None:
    costmap = inflate(grid, 0.17)
    lattice = lattice_of(costmap, 0.35)
    assert lattice is not None
    assert lattice.side == 7
    graph = lattice.graph
    for node, column in np.argwhere(graph.neighbours >= 0):
        tail, head = lattice.centre[node], lattice.centre[graph.neighbours[node, column]]
        line = np.array([tail + k * (head - tail) // 7 for k in range(8)], np.int32)
        ends = [(int(x), int(y)) for x, y in (tail, head)]
        assert path_fault(costmap.free, line, ends[0], ends[1]) == ""
    reached = lattice.near[costmap.free]
    assert (reached != NOWHERE).mean() > 0.95


def test_a_map_on_which_commitments_cannot_be_told_is_refused_with_the_remedy() -> None:
    cells = np.zeros((200, 200), np.int8)
    fine = OccupancyGrid(cells, 0.02, 0.0, 0.0)
    with pytest.raises(MapError, match="planner = 'replan'"):
        ground_of(fine, 0, Config(planning=PlanningConfig(planner="window")))
