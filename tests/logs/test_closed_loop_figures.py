"""Distributions of re-runs and paired differences: laws of the statistics, with numbers made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hippomat_core.errors import ConfigError
from hippomat_logs.closed_loop.figures import (
    FEWEST_PAIRS,
    FIGURES,
    distributions,
    mean_interval,
    paired_differences,
)
from hippomat_logs.closed_loop.plan import SenderDeliveries, parse_air
from hippomat_logs.closed_loop.show import verdicts

NUMBERS = st.lists(st.floats(-1e3, 1e3), min_size=FEWEST_PAIRS, max_size=30)


def values(number: float) -> dict[str, float]:
    return {figure.key: number for figure in FIGURES}


@given(NUMBERS)
def test_the_interval_of_a_mean_holds_values_between_the_extremes(numbers: list[float]) -> None:
    low, high = mean_interval(np.array(numbers))
    assert min(numbers) - 1e-6 <= low <= high <= max(numbers) + 1e-6


def test_a_few_pairs_that_happen_to_agree_decide_nothing() -> None:
    few = paired_differences([values(1.0)] * 3, [values(2.0)] * 3)
    assert not any(one.distinguishable for one in few)
    assert verdicts(few, "a", "b") == ["fewer than 10 pairs have no interval and decide nothing: --seeds 20"]


def test_a_recorded_value_is_placed_among_the_re_runs() -> None:
    reruns = [values(float(k)) for k in range(1, 11)]
    for recorded, percentile, outside in ((0.0, 0.0, True), (5.5, 50.0, False), (11.0, 100.0, True)):
        for one in distributions(reruns, values(recorded)):
            assert (one.percentile, one.outside) == (percentile, outside)


def test_what_no_run_has_is_left_out_of_its_figure() -> None:
    reruns = [values(math.nan), values(3.0)]
    (first, *_) = distributions(reruns, values(math.nan))
    assert first.values.tolist() == [3.0]
    assert math.isnan(first.percentile)
    assert not first.outside
    (pair, *_) = paired_differences(reruns, [values(1.0), values(4.0)])
    assert (pair.pairs, pair.difference) == (1, 1.0)


def test_runs_compared_with_themselves_differ_by_exactly_nothing() -> None:
    reruns = [values(float(k) / 3) for k in range(20)]
    for one in paired_differences(reruns, reruns):
        assert (one.difference, one.low, one.high, one.distinguishable) == (0.0, 0.0, 0.0, False)
    found = verdicts(paired_differences(reruns, reruns), "greedy", "greedy too")
    assert found == ["greedy too and greedy differ in nothing, seed by seed"]


def test_a_clear_difference_is_told_and_noise_is_not() -> None:
    rng = np.random.default_rng(5)
    noise = rng.normal(0.0, 1.0, 20)
    reruns = [values(float(k)) for k in noise]
    clear = paired_differences(reruns, [values(float(k) + 2.0 + 0.1 * k) for k in noise])
    assert all(one.distinguishable and one.low < 2.0 < one.high for one in clear)
    unclear = paired_differences(reruns, [values(float(k)) for k in rng.normal(0.0, 1.0, 20)])
    assert not any(one.distinguishable for one in unclear)
    assert "not distinguishable" in verdicts(unclear, "a", "b")[0]


def test_figures_that_never_differ_are_equal_rather_than_not_distinguishable() -> None:
    reruns = [values(float(k)) for k in range(20)]
    others = [{**one, "completed": one["completed"] + 1.0 + k % 2} for k, one in enumerate(reruns)]
    first, same = verdicts(paired_differences(reruns, others), "greedy", "auction")
    assert first == "tasks completed: auction is higher by 1.5 than greedy"
    assert same.startswith("equal, seed by seed: total travel cost, ")


def test_a_rare_kind_far_from_any_of_its_own_goes_as_the_link_went_then() -> None:
    times_us = np.array([0, 100_000, 5_000_000], np.int64)
    heard = np.array([[True], [False], [True]])
    deliveries = SenderDeliveries(times_us, np.array([1, 1, 3], np.uint8), heard)
    assert not deliveries.delivered(90_000, 1)[0]
    assert not deliveries.delivered(200_000, 3)[0]  # its own kind is 4.8 s away: the nearest frame decides
    assert deliveries.delivered(4_500_000, 3)[0]
    nothing = SenderDeliveries(times_us[:0], np.empty(0, np.uint8), heard[:0])
    assert nothing.delivered(0, 1).tolist() == [False]


@pytest.mark.parametrize(
    ("text", "again"), [("recorded", "recorded"), ("ideal", "ideal"), ("loss=0.20", "loss=0.2")]
)
def test_a_radio_is_named_as_it_was_asked_for(text: str, again: str) -> None:
    assert parse_air(text).text == again


@pytest.mark.parametrize("text", ["", "loss", "loss=", "loss=-1", "loss=nan", "ideal=1"])
def test_a_radio_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="is none of: recorded, ideal, loss=P"):
        parse_air(text)
