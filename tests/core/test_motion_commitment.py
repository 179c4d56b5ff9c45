"""Robots that commit only what is safe never meet, whatever they want and whatever they do not hear."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_fleet_lab import Lab, Wanderer, drawn

from hippomat_core.motion.commitment import extend, may_extend, may_start, standing
from hippomat_core.motion.graph import motion_graph
from hippomat_core.motion.scene import ways_of

LINE = motion_graph(np.ones((1, 1, 12), np.bool_))
FORGET = 50


def line(*cells: int, ticks: int = 1):
    """Robots that stand in cells of a line; everybody knows."""
    return standing(np.array(cells, np.int32), np.full(len(cells), ticks, np.int32))


def granted(known, head: int, now: int = 0, robot: int = 0) -> bool:
    return may_extend(ways_of(LINE), LINE.cells, False, known, robot, head, now, FORGET)


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    loss=st.sampled_from([0.0, 0.2, 0.5, 0.9]),
    ticks=st.sampled_from([[1], [5, 3], [2, 1, 3]]),
    diagonals=st.booleans(),
    layers=st.sampled_from([1, 2]),
)
def test_robots_that_want_anything_and_hear_little_never_meet(
    seed: int, loss: float, ticks: list[int], diagonals: bool, layers: int
) -> None:
    rng = np.random.default_rng(seed)
    free = rng.random((layers, 5, 6)) < 0.85
    nodes = int(free.sum())
    starts = rng.permutation(nodes)[: min(8, nodes // 2)].astype(np.int32)
    paces = [ticks[k % len(ticks)] for k in range(len(starts))]
    seeds = iter(range(seed, seed + 100))
    lab = Lab(free, starts, lambda: Wanderer(next(seeds)), paces, loss, seed, diagonals)
    for _ in range(60):
        lab.step(rounds=2)
    verdict = lab.verdict()
    assert (verdict.collisions, verdict.wrong_moves) == (0, ())


def test_wanderers_do_move_under_loss() -> None:
    lab = Lab(
        np.ones((1, 6, 6), np.bool_), np.arange(0, 36, 6, dtype=np.int32), lambda: Wanderer(1), loss=0.5
    )
    for _ in range(50):
        lab.step()
    assert len(lab.moves) > 60


def test_a_cell_is_entered_as_its_holder_leaves_only_if_that_was_heard() -> None:
    known = line(3, 4)
    assert not granted(known, 4)
    extend(known, 1, 5, 0)
    assert granted(known, 4)


def test_two_robots_never_swap_even_if_both_would_leave() -> None:
    known = line(3, 4)
    extend(known, 1, 3, 0)
    assert not granted(known, 4)


def test_a_slower_leaver_is_not_run_into_by_a_faster_follower() -> None:
    known = standing(np.array([3, 4], np.int32), np.array([3, 5], np.int32))
    extend(known, 1, 5, 0)
    assert [granted(known, 4, now) for now in (0, 3, 4)] == [False, False, True]


@pytest.mark.parametrize(("silent_for", "far"), [(0, 2), (1, 3), (2, 4), (FORGET + 1, 1)])
def test_a_peer_may_be_anywhere_it_can_have_got_to_since_it_was_heard(silent_for: int, far: int) -> None:
    for gap in range(1, 6):
        known = line(3, 4 + gap)  # we would be `gap` cells from where it was heard
        known.exact[1], known.heard[1] = False, 100
        assert granted(known, 4, 100 + silent_for) == (gap >= far), gap


def test_a_peer_that_has_committed_already_in_this_tick_can_do_no_more() -> None:
    known = line(3, 6)
    extend(known, 1, 5, 100)
    known.exact[1], known.heard[1] = False, 100
    assert granted(known, 4, 100)


def test_a_robot_on_a_move_commits_no_other_before_it_ends() -> None:
    known = line(3, ticks=4)
    extend(known, 0, 4, 10)
    assert [granted(known, 5, now) for now in (10, 13, 14)] == [False, False, True]


def test_only_neighbours_are_granted() -> None:
    assert [granted(line(3), head) for head in (2, 3, 4, 5)] == [True, False, True, False]


@pytest.mark.parametrize(
    ("heard_by", "alone_s", "may"),
    [([], 1.0, False), ([], 3.0, True), ([True, False], 9.0, False), ([True, True], 0.0, True)],
)
def test_a_newcomer_stands_until_all_have_heard_it_or_it_is_alone(
    heard_by: list[bool], alone_s: float, may: bool
) -> None:
    assert may_start(heard_by, alone_s, 3.0) == may


def test_crossing_diagonals_are_a_meeting() -> None:
    square = motion_graph(np.ones((1, 2, 2), np.bool_), diagonals=True)
    known = standing(np.array([square.node(0, 0), square.node(1, 0)], np.int32), np.ones(2, np.int32))
    extend(known, 1, square.node(0, 1), 0)
    assert not may_extend(ways_of(square), square.cells, True, known, 0, square.node(1, 1), 0, FORGET)


def test_a_ring_of_followers_cannot_start() -> None:
    lab = Lab(drawn("  \n  "), [(0, 0), (1, 0), (1, 1), (0, 1)])
    for robot, goal in enumerate([(1, 0), (1, 1), (0, 1), (0, 0)]):
        lab.send(robot, goal)
    for _ in range(10):
        lab.step()
    assert lab.moves == []
