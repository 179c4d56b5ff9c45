"""What peers have taken, who goes first, and where to let others pass."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hippomat_core.config import Config, RobotConfig
from hippomat_core.planning.costmap import inflate
from hippomat_core.planning.feasibility import path_fault
from hippomat_core.planning.give_way import way_aside
from hippomat_core.planning.reservations import (
    PeerMotion,
    decode_intent,
    encode_intent,
    free_stretch,
    has_priority,
    keep_out_m,
    reserve,
    taken_cells,
)
from hippomat_sim.maps.demo_room import draw_demo_room

GRID = draw_demo_room()
CONFIG = Config(robot=RobotConfig(id=3))
EAST = np.array([[k, 20] for k in range(40, 53)], np.int32)  # 12 steps east
AT = GRID.centre_of(40, 20)


def peer(robot: int = 1, **changes: object) -> PeerMotion:
    values = {
        "robot": robot,
        "x_m": AT[0],
        "y_m": AT[1],
        "speed_mps": 0.2,
        "age_s": 0.1,
        "intent": EAST,
        "destination": (2.0, 2.0),
    }
    return PeerMotion(**{**values, **changes})  # type: ignore[arg-type]


@given(
    st.tuples(st.integers(20, 60000), st.integers(20, 60000)),
    st.lists(st.tuples(st.integers(-1, 1), st.integers(-1, 1)), max_size=12),
)
def test_an_intent_survives_the_air(first: tuple[int, int], moves: list[tuple[int, int]]) -> None:
    cells = np.cumsum(np.array([first, *moves], np.int32), axis=0).astype(np.int32)
    ix, iy, steps = encode_intent(cells)
    assert np.array_equal(decode_intent(ix, iy, steps), cells)
    assert (steps <= 26).all()


def test_a_longer_path_is_cut_to_what_the_air_carries() -> None:
    cells = np.array([[k, 5] for k in range(30)], np.int32)
    assert np.array_equal(decode_intent(*encode_intent(cells)), cells[:13])


def test_of_two_robots_exactly_one_has_priority() -> None:
    for mine in (None, (0.0, 0.0)):
        for theirs in (None, (0.0, 0.0)):
            one = has_priority(peer(1, destination=theirs), 3, mine is not None)
            other = has_priority(peer(3, destination=mine), 1, theirs is not None)
            assert one != other
    assert has_priority(peer(1), 3, True)
    assert not has_priority(peer(1, destination=None), 3, True)


def stretch(of: PeerMotion, points: list[tuple[float, float]], slow: float = 0.0) -> tuple[int, int]:
    xy = np.array(points)
    taken = reserve([of], GRID, points[0], True, CONFIG)
    at_s = np.arange(len(xy)) * 0.25 + slow
    return free_stretch(taken, xy, at_s, 0.6)


def across(x_m: float, upto_m: float = 0.8) -> list[tuple[float, float]]:
    """A way north that crosses the line the peer drives on at x_m."""
    return [(x_m, AT[1] + y) for y in np.arange(-upto_m, upto_m, 0.05)]


def test_everybody_stops_before_a_peers_disc() -> None:
    for robot in (1, 4):
        points = across(AT[0])
        count, owner = stretch(peer(robot), points)
        assert owner == robot
        assert points[count - 1][1] <= AT[1] - keep_out_m(CONFIG)
        assert points[count][1] > AT[1] - keep_out_m(CONFIG) - 0.05


def test_only_the_one_without_priority_keeps_out_of_the_intent() -> None:
    points = across(AT[0] + 0.5)
    count, owner = stretch(peer(1), points)
    assert (count < len(points), owner) == (True, 1)
    assert stretch(peer(4), points) == (len(points), -1)


def test_a_crossing_that_ends_long_before_the_peer_comes_is_allowed() -> None:
    points = across(AT[0] + 0.6, 0.32)
    assert stretch(peer(1), points, slow=-2.0) == (len(points), -1)
    assert stretch(peer(1), points, slow=2.0)[1] == 1


def test_a_robot_inside_a_disc_may_leave_it_but_not_get_nearer() -> None:
    near = (AT[0], AT[1] - 0.2)
    away = [near] + [(AT[0], near[1] - 0.05 * k) for k in range(1, 8)]
    assert stretch(peer(4, intent=EAST[:1]), away)[0] == len(away)
    towards = [near] + [(AT[0], near[1] + 0.05 * k) for k in range(1, 8)]
    assert stretch(peer(4, intent=EAST[:1]), towards)[0] == 1


def test_a_disc_grows_with_silence_up_to_a_limit() -> None:
    radii = [
        float(reserve([peer(1, age_s=age)], GRID, (-2.0, -2.0), True, CONFIG).radius_m[0])
        for age in (0.1, 0.3, 0.8, 3.0, 9.0, 60.0)
    ]
    assert radii[0] == radii[1] == pytest.approx(0.30)
    assert radii[2] == pytest.approx(0.40)
    assert radii[3] == radii[4] == pytest.approx(0.55)
    assert radii[5] == radii[0]  # it stands where it was last heard


def test_a_moving_peer_takes_what_it_can_no_longer_stop_before() -> None:
    fast = reserve([peer(4, speed_mps=0.2, age_s=0.3)], GRID, (-2.0, -2.0), True, CONFIG)
    still = reserve([peer(4, speed_mps=0.0, age_s=0.1)], GRID, (-2.0, -2.0), True, CONFIG)
    assert fast.xy[:, 0].max() - AT[0] >= 0.2 * 0.3
    assert still.xy[:, 0].max() - AT[0] <= 0.05


def test_taken_cells_are_those_whose_centres_lie_inside() -> None:
    rng = np.random.default_rng(5)
    xy, radius_m = rng.uniform(-2.8, 2.8, (20, 2)), rng.uniform(0, 0.4, 20)
    mask = taken_cells(xy, radius_m, GRID)
    for iy, ix in rng.integers(0, 104, (300, 2)):
        x, y = GRID.centre_of(int(ix), int(iy))
        assert mask[iy, ix] == bool((np.hypot(xy[:, 0] - x, xy[:, 1] - y) < radius_m).any())


def test_the_way_aside_leads_out_of_the_peers_way_by_a_feasible_path() -> None:
    costmap = inflate(GRID, 0.17)
    start = (50, 20)
    passing = [peer(1, destination=GRID.centre_of(90, 20))]
    out_m = keep_out_m(CONFIG)
    blocked = taken_cells(np.array([AT]), np.array([out_m]), GRID)
    path = way_aside(costmap, start, blocked, passing, out_m)
    assert path is not None
    end = (int(path[-1, 0]), int(path[-1, 1]))
    assert path_fault(costmap.free & ~blocked, path, start, end) == ""
    x, y = GRID.centre_of(*end)
    way = [GRID.centre_of(k, 20) for k in range(40, 80)]
    assert min(np.hypot(x - wx, y - wy) for wx, wy in way) >= out_m
