"""Plans for many robots: nobody in one place twice, everybody arrives, equal knowledge gives equal plans."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_fleet_lab import Lab, drawn

from hippomat_core.config import PLANNERS
from hippomat_core.errors import ConfigError
from hippomat_core.motion.graph import UNREACHED, largest_part, motion_graph, moves_to
from hippomat_core.motion.parking import parking_goals, parking_spots
from hippomat_core.motion.planners import make_planner
from hippomat_core.motion.reservations import NOBODY, hold, holder, release, table_size
from hippomat_core.motion.scene import Plan, Scene, ticks_of
from hippomat_core.motion.window import WindowPlanner
from hippomat_sim.bench.motion_checker import Move, judge

SIDING = """
##########  ####
#              #
################"""
DEAD_END = """
####   ####
####   ####
          #
####   ####"""


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 5), st.integers(0, 4), st.booleans()), max_size=200)
)
def test_the_table_never_holds_one_place_twice(entries: list[tuple[int, int, int, bool]]) -> None:
    size = table_size(4, 4)
    keys, owners = np.zeros(size, np.int64), np.zeros(size, np.int32)
    held: dict[tuple[int, int], int] = {}
    for tick, place, robot, enters in entries:
        if enters:
            assert hold(keys, owners, 6, tick, place, robot) == (held.get((tick, place), robot) == robot)
            held.setdefault((tick, place), robot)
        else:
            release(keys, owners, 6, tick, place, robot)
            if held.get((tick, place)) == robot:
                del held[(tick, place)]
        for t in range(4):
            for p in range(6):
                assert holder(keys, owners, 6, t, p) == held.get((t, p), NOBODY)


def scene(free: np.ndarray, count: int, seed: int, ticks: tuple[int, ...] = (1,), tick: int = 0) -> Scene:
    """Robots that stand anywhere and want to be anywhere."""
    graph = motion_graph(free)
    rng = np.random.default_rng(seed)
    part = largest_part(graph)
    node, goal = (rng.permutation(part)[:count].astype(np.int32) for _ in range(2))
    fields = np.array([moves_to(graph, int(g)) for g in goal])
    paces = np.array([ticks[k % len(ticks)] for k in range(count)], np.int32)
    rows = np.arange(count, dtype=np.int32)
    since = rng.integers(0, 50, count)
    return Scene(tick, graph, node, np.zeros(count, np.int32), node, paces, goal, rows, since, fields)


def moves_of(plan: Plan, of: Scene) -> list[Move]:
    moves = []
    for robot, target in enumerate(plan.target):
        at, tick, pace = int(of.node[robot]), 0, int(of.ticks[robot])
        while tick < len(target):
            head = int(target[tick])
            if head != at:
                cells = [tuple(of.graph.cells[n].tolist()) for n in (at, head)]
                moves.append(Move(robot, tick, tick + pace, *cells))
            tick, at = tick + (pace if head != at else 1), head
    return moves


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1), ticks=st.sampled_from([(1,), (5, 3), (2, 1)]), layers=st.integers(1, 2)
)
def test_no_two_robots_of_a_plan_ever_meet(seed: int, ticks: tuple[int, ...], layers: int) -> None:
    free = np.random.default_rng(seed).random((layers, 7, 8)) < 0.8
    of = scene(free, min(10, len(largest_part(motion_graph(free))) // 3), seed, ticks)
    planner = WindowPlanner()
    plan = planner.plan(of, None)
    starts = of.graph.cells[of.node]
    verdict = judge(free, starts, moves_of(plan, of), of.ticks.tolist(), plan.target.shape[1], False)
    assert verdict.wrong_moves == ()
    assert verdict.collisions == 0 or not planner.whole


def test_nearly_every_crowd_finds_a_whole_plan() -> None:
    """Else the law above would say little."""
    whole = 0
    for seed in range(100):
        free = np.random.default_rng(seed).random((1, 7, 8)) < 0.8
        planner = WindowPlanner()
        planner.plan(scene(free, min(10, len(largest_part(motion_graph(free))) // 3), seed, (5, 3)), None)
        whole += planner.whole
    assert whole >= 90


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), ticks=st.sampled_from([(1,), (5, 3)]))
def test_what_a_planner_remembers_never_shows_in_its_plans(seed: int, ticks: tuple[int, ...]) -> None:
    free = np.random.default_rng(seed).random((1, 8, 8)) < 0.85
    of = scene(free, 8, seed, ticks)
    rng = np.random.default_rng(seed)
    old, plan = WindowPlanner(), None
    for tick in range(12):
        goal = of.goal.copy()
        if tick % 2:
            goal[rng.integers(len(goal))] = rng.choice(largest_part(of.graph))
        fields = np.array([moves_to(of.graph, int(g)) for g in goal])
        ready = np.zeros(len(goal), np.int32)
        node = of.node if plan is None else plan.target[:, tick - 1 - plan.tick].copy()
        if ticks != (1,):
            node = of.node  # nobody moves: what is planned is only wished for
        of = Scene(tick, of.graph, node, ready, node, of.ticks, goal, of.goal_field, of.since, fields)
        new = old.plan(of, plan)
        assert np.array_equal(new.target, WindowPlanner().plan(of, plan).target)
        plan = new


@pytest.mark.parametrize("loss", [0.0, 0.5])
@pytest.mark.parametrize("ticks", [[1, 1], [5, 3]])
def test_two_robots_meeting_in_a_corridor_both_get_through(loss: float, ticks: list[int]) -> None:
    lab = Lab(drawn(SIDING), [(1, 1), (14, 1)], ticks=ticks, loss=loss)
    lab.send(0, (14, 1))
    lab.send(1, (1, 1))
    assert lab.run(300)
    assert lab.verdict().collisions == 0


def test_the_papers_scheme_waits_there_for_ever() -> None:
    lab = Lab(drawn(SIDING), [(1, 1), (14, 1)], planner="replan")
    lab.send(0, (14, 1))
    lab.send(1, (1, 1))
    assert not lab.run(300)
    assert lab.verdict().collisions == 0


@pytest.mark.parametrize("planner", ["window", "pibt"])
def test_a_robot_that_wants_nothing_lets_others_by(planner: str) -> None:
    lab = Lab(drawn(SIDING), [(1, 1), (8, 1)], planner=planner)
    lab.send(0, (14, 1))
    while lab.node(0) != lab.graph.node(14, 1) and lab.fleet.tick < 100:
        lab.step()
    assert lab.node(0) == lab.graph.node(14, 1)


@pytest.mark.parametrize("planner", PLANNERS)
def test_every_planner_brings_robots_across_a_room_without_a_meeting(planner: str) -> None:
    free = np.ones((1, 9, 9), np.bool_)
    lab = Lab(free, [(0, y) for y in range(0, 9, 2)], planner=planner, loss=0.3)
    for robot, y in enumerate(range(8, -1, -2)):
        lab.send(robot, (8, y))
    assert lab.run(200)
    assert lab.verdict().collisions == 0


def test_robots_with_goals_in_a_room_arrive_as_fast_as_alone() -> None:
    lab = Lab(np.ones((1, 9, 9), np.bool_), [(0, 0), (0, 2), (0, 4)])
    for robot in range(3):
        lab.send(robot, (8, 2 * robot))
    assert lab.run(8)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), diagonals=st.booleans())
def test_fewest_moves_differ_by_at_most_one_between_neighbours(seed: int, diagonals: bool) -> None:
    graph = motion_graph(np.random.default_rng(seed).random((2, 6, 6)) < 0.7, diagonals)
    goal = int(largest_part(graph)[0])
    moves = moves_to(graph, goal)
    assert moves[goal] == 0
    for node, other in np.argwhere(graph.neighbours >= 0):
        assert abs(moves[node] - moves[graph.neighbours[node, other]]) <= 1
    reached = np.flatnonzero(moves < UNREACHED)
    assert np.array_equal(reached, largest_part(graph)) or len(reached) == len(largest_part(graph))


def test_a_parking_spot_closes_no_way() -> None:
    free = drawn(DEAD_END)
    graph = motion_graph(free)
    spots = {tuple(graph.cells[k, :2].tolist()) for k in np.flatnonzero(parking_spots(graph))}
    assert (0, 2) in spots  # the end of the corridor
    assert not {(1, 2), (2, 2), (3, 2), (8, 2)} & spots
    assert (4, 0) in spots  # a corner of the room


def test_idle_robots_park_apart_and_never_where_others_go() -> None:
    graph = motion_graph(np.ones((1, 3, 3), np.bool_))
    nodes = np.array([0, 1], np.int32)
    wanted = np.array([graph.node(0, 0), graph.node(2, 2)], np.int32)
    goals = parking_goals(graph, np.ones(9, np.bool_), nodes, nodes, wanted)
    assert len({*goals.tolist(), *wanted.tolist()}) == 4
    assert np.array_equal(parking_goals(graph, np.ones(9, np.bool_), nodes, goals, wanted), goals)


def test_speeds_become_the_smallest_whole_ticks() -> None:
    assert ticks_of((3.0, 5.0)) == (5, 3)
    assert ticks_of((0.2, 0.2)) == (1, 1)
    assert ticks_of((0.3, 0.2)) == (2, 3)
    with pytest.raises(ConfigError, match="no common tick"):
        ticks_of((1.0, 0.017))


def test_an_unknown_planner_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match="'fast' is unknown"):
        make_planner("fast")
