"""A body that is no disc: how far it may drive and turn, and which outlines are refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from test_guard_faults import LONG, NO_PEERS

from hippomat_core.config import parse_config
from hippomat_core.control.guard import guard
from hippomat_core.control.stopping import beyond_body_m, free_travel_m, free_turn_rad
from hippomat_core.errors import ConfigError

DISC = np.zeros((0, 2))


def test_a_long_robot_does_not_turn_its_tail_into_a_thing_beside_it():
    beside = np.array([[0.02, 0.12]])  # within reach of a front corner, not of the side
    assert guard(beside, 0.0, 1.0, NO_PEERS, LONG).wz_radps < 1.0
    assert guard(beside, 0.0, 1.0, NO_PEERS, LONG).limited
    assert not guard(np.array([[0.3, 0.3]]), 0.0, 1.0, NO_PEERS, LONG).limited


def test_a_long_robot_passes_where_the_disc_around_it_would_not():
    beside = np.stack([np.linspace(-1, 1, 81), np.full(81, 0.13)], axis=1)
    assert not guard(beside, 0.2, 0.0, NO_PEERS, LONG).limited
    ahead = np.array([[0.22, 0.12]])
    as_disc = replace(LONG, robot=replace(LONG.robot, footprint=()))
    assert guard(ahead, 0.2, 0.0, NO_PEERS, as_disc).limited
    assert not guard(ahead, 0.2, 0.0, NO_PEERS, LONG).limited


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.integers(3, 9), st.floats(0.05, 0.3))
@settings(deadline=None)
def test_the_distance_to_an_outline_is_that_to_its_nearest_point_and_negative_inside(x, y, corners, radius):
    angle = np.arange(corners) / corners * math.tau
    outline = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    edge = np.concatenate([np.linspace(outline[k - 1], outline[k], 400) for k in range(corners)])
    nearest = float(np.hypot(edge[:, 0] - x, edge[:, 1] - y).min())
    beyond = beyond_body_m(x, y, outline, radius)
    assert abs(beyond) == pytest.approx(nearest, abs=radius / 100)
    if math.hypot(x, y) < radius * math.cos(math.pi / corners):
        assert beyond <= 1e-9
    if math.hypot(x, y) > radius:
        assert beyond >= 0.0


@given(st.integers(0, 2**32 - 1), st.floats(-8.0, 8.0), st.sampled_from([1.0, -1.0]))
@settings(deadline=None, max_examples=60)
@example(30155, 0.0, 1.0)  # the disc grazes a point that the outline just passes
def test_a_disc_given_as_an_outline_gets_as_far_as_the_discs_around_and_inside_it(seed, curvature, direction):
    random = np.random.default_rng(seed)
    xy, gap = random.uniform(-0.6, 0.6, (8, 2)), np.full(8, 0.03)
    xy = xy[np.hypot(*xy.T) > 0.16]
    angle = np.arange(64) / 64 * math.tau
    outline = 0.12 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    around_m, free_m, inside_m = (
        free_travel_m(xy, gap[: len(xy)], corners, radius_m, direction, curvature, 0.4)
        for corners, radius_m in ((DISC, 0.12), (outline, 0.12), (DISC, 0.12 * math.cos(math.pi / 64)))
    )
    assert around_m - 0.021 <= free_m <= inside_m + 0.021
    assert free_turn_rad(xy, gap[: len(xy)], DISC, 0.12, 3.0) == 3.0


@pytest.mark.parametrize(
    ("outline", "named"),
    [
        ("[[0.1, 0.0], [0.0, 0.1]]", "needs three corners"),
        ("[[0.1, 0.0, 1.0], [0.0, 0.1], [-0.1, -0.1]]", "needs three corners"),
        ("[[0.3, 0.0], [0.0, 0.1], [-0.1, -0.1]]", r"outside \[robot\] radius_m = 0.12.* radius_m = 0.3"),
        ("[[0.1, 0.0], [-0.05, -0.1], [0.0, 0.1]]", "counter-clockwise"),
        ("[[0.1, 0.0], [0.02, 0.02], [0.0, 0.1], [-0.08, 0.0], [0.0, -0.1]]", "convex"),
        ("[[nan, 0.0], [0.0, 0.1], [-0.1, -0.1]]", "no length"),
    ],
)
def test_an_outline_that_cannot_be_used_is_refused_with_the_remedy(outline, named):
    with pytest.raises(ConfigError, match=named):
        parse_config(f"[robot]\nfootprint = {outline}\n")
