"""Estimates and their intervals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hippomat_sim.bench.tables_stats import difference, mean, ratio, ratio_of_ratios

COUNTS = st.lists(st.integers(1, 1000), min_size=2, max_size=40)


@given(COUNTS)
def test_an_interval_holds_its_value_and_scales_with_it(values: list[int]) -> None:
    estimate = mean(values)
    assert estimate.value == pytest.approx(np.mean(values))
    assert estimate.low <= estimate.high
    assert min(values) - 1e-9 <= estimate.low <= estimate.high <= max(values) + 1e-9
    assert estimate.scaled(2.0, 1.0).value == pytest.approx(2.0 * estimate.value + 1.0)


@given(COUNTS)
def test_a_method_differs_from_itself_by_nothing(values: list[int]) -> None:
    whole = [7] * len(values)
    same = difference(values, whole, values, whole)
    assert (same.value, same.low, same.high) == (0.0, 0.0, 0.0)
    assert ratio_of_ratios(values, whole, values, whole).value == 1.0


def test_intervals_narrow_with_the_root_of_the_count_and_cover_the_truth() -> None:
    random = np.random.default_rng(1)
    covered = 0
    for _ in range(200):
        estimate = mean(random.normal(5.0, 2.0, 100))
        covered += estimate.low <= 5.0 <= estimate.high
        assert (estimate.high - estimate.low) / 2.0 == pytest.approx(1.96 * 2.0 / 10.0, rel=0.4)
    assert 180 <= covered <= 200


def test_paired_differences_are_sharper_than_the_values() -> None:
    random = np.random.default_rng(2)
    values = random.normal(50.0, 20.0, 400)
    whole = np.ones(400)
    apart = difference(values + 1.0, whole, values, whole)
    assert apart.low == pytest.approx(1.0)
    assert mean(values).high - mean(values).low > 1.0


# --- worlds ---


@given(COUNTS)
def test_worlds_of_one_instance_each_are_drawn_as_instances_are(values: list[int]) -> None:
    assert mean(values, np.arange(len(values)) + 5) == mean(values)


@given(st.lists(st.integers(0, 4), min_size=2, max_size=40))
def test_figures_that_are_the_same_everywhere_have_no_width(worlds: list[int]) -> None:
    values = np.full(len(worlds), 3)
    estimate = mean(values, worlds)
    assert (estimate.value, estimate.low, estimate.high) == (3.0, 3.0, 3.0)
    apart = difference(values + 1, values, values, values, worlds)
    assert apart.low == pytest.approx(apart.high)


def test_figures_of_one_world_say_less_than_so_many_independent_ones() -> None:
    random = np.random.default_rng(3)
    worlds = np.repeat(np.arange(32), 30)
    values = random.normal(0.0, 2.0, 32)[worlds] + random.normal(0.0, 1.0, len(worlds))
    together, alone = mean(values, worlds), mean(values)
    assert together.value == alone.value
    assert together.high - together.low > 3.0 * (alone.high - alone.low)


@pytest.mark.parametrize("between", [0.0, 1.0])
def test_intervals_over_worlds_cover_the_truth(between: float) -> None:
    random, worlds = np.random.default_rng(4), np.repeat(np.arange(32), 10)
    covered = 0
    for _ in range(200):
        values = random.normal(5.0, between, 32)[worlds] + random.normal(0.0, 1.0, len(worlds))
        estimate = mean(values, worlds)
        covered += estimate.low <= 5.0 <= estimate.high
    assert covered >= 180


def test_a_method_differs_from_itself_by_nothing_whatever_its_worlds() -> None:
    random = np.random.default_rng(5)
    values, worlds = random.integers(1, 100, 60), random.integers(0, 7, 60)
    whole = np.full(60, 7)
    same = difference(values, whole, values, whole, worlds)
    assert (same.value, same.low, same.high) == (0.0, 0.0, 0.0)


def test_nothing_counted_is_nan() -> None:
    assert math.isnan(ratio([], []).value)
    assert math.isnan(ratio([0, 0], [0, 0]).value)


def test_draws_of_worlds_that_hold_nothing_to_count_are_left_out() -> None:
    estimate = ratio([1, 0], [1, 0], [0, 1])
    assert (estimate.value, estimate.low, estimate.high) == (1.0, 1.0, 1.0)
