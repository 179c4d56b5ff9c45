"""Laws of the common time that a fleet's radio traffic gives its logs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from radio_traffic_lab import YEAR_S, Air, Clock, Robot, ToldRun, fleet

from hippomat_core.errors import HippomatError
from hippomat_logs.alignment import Alignment, align_runs
from hippomat_logs.clock_map import ClockMap, constant

S = 10**9
SECONDS = 20.0


def errors_ns(
    alignment: Alignment, runs: list[ToldRun], robots: list[Robot], reference: int = 0
) -> list[float]:
    """Of every run but the reference: the largest error of its common time while it recorded."""
    found = []
    for run, robot in zip(runs, robots, strict=True):
        begin_s, end_s = max(robot.from_s, 0.0), min(robot.until_s, SECONDS)
        times_s = np.linspace(begin_s, end_s, 11)
        own = np.array([robot.clock.at_ns(t) for t in times_s])
        true = np.array([robots[reference].clock.at_ns(t) for t in times_s])
        found.append(float(np.abs(alignment.common_ns_array(run, own) - true).max()))
    return found


def clocks() -> st.SearchStrategy[Clock]:
    decade_ns = 10 * YEAR_S * S
    return st.builds(Clock, st.integers(0, 2 * decade_ns), st.floats(-200, 200))


def robots() -> st.SearchStrategy[Robot]:
    return st.builds(
        Robot,
        clocks(),
        radio_drift_ppm=st.floats(-50, 50),
        least_latency_s=st.floats(0, 0.0008),
        reboots_s=st.sampled_from([(), (9.5,), (5.0, 14.2)]),
        from_s=st.sampled_from([0.0, 0.0, 6.0]),
    )


@settings(max_examples=20, phases=[Phase.explicit, Phase.reuse, Phase.generate])  # shrinking takes minutes
@given(
    st.lists(robots(), min_size=2, max_size=4),
    st.sampled_from([0.0, 0.2, 0.6]),
    st.tuples(st.floats(0, 0.0009), st.floats(0, 0.0009)),
    st.integers(0, 2**32 - 1),
)
def test_common_time_is_true_within_the_stated_uncertainty(
    fleet_: list[Robot], loss: float, delays_s: tuple[float, float], seed: int
) -> None:
    air = Air(loss, lambda sender, receiver: delays_s[sender < receiver])
    runs = fleet(fleet_, SECONDS, seed, air)
    alignment = align_runs(runs)
    for clock, error_ns in zip(alignment.clocks, errors_ns(alignment, runs, fleet_), strict=True):
        assert error_ns <= clock.uncertainty_ns + 1
        assert clock.violations == 0
        assert clock.uncertainty_ns < 10_000_000


THREE = [
    Robot(Clock(3 * YEAR_S * S, 40.0), 10.0),
    Robot(Clock(0, -50.0), -20.0),
    Robot(Clock(10 * YEAR_S * S, 50.0), 5.0, reboots_s=(8.0,)),
]


def test_clocks_ten_years_and_100_ppm_apart_agree_within_two_milliseconds() -> None:
    runs = fleet(THREE, SECONDS, 1)
    alignment = align_runs(runs)
    assert max(errors_ns(alignment, runs, THREE)) < 1_000_000
    assert alignment.clocks[2].boots == 2
    assert alignment.clocks[1].drift_ppm == pytest.approx(90.0, abs=20.0)


def test_a_rate_that_wanders_with_the_temperature_is_followed() -> None:
    there = [Robot(Clock(drift_ppm=20.0)), Robot(Clock(YEAR_S * S, 0.0, wander_ns=4e6))]
    runs = fleet(there, 480.0, 11)
    alignment = align_runs(runs)
    times_s = np.linspace(0.0, 480.0, 100)
    own, true = (np.array([robot.clock.at_ns(t) for t in times_s]) for robot in (there[1], there[0]))
    off_ns = np.abs(alignment.common_ns_array(runs[1], own) - true).max()
    assert off_ns <= alignment.clocks[1].uncertainty_ns < 2_000_000
    straight = np.polyfit(times_s, own - own[0] - times_s * 1e9, 1)
    bent_ns = np.abs(own - own[0] - times_s * 1e9 - np.polyval(straight, times_s)).max()
    assert off_ns < bent_ns / 2  # than the best line


def test_the_order_in_which_runs_are_given_changes_nothing() -> None:
    runs = fleet(THREE, SECONDS, 2)
    one, other = align_runs(runs), align_runs(runs[::-1])
    assert one.clocks == other.clocks


@settings(max_examples=6)
@given(st.integers(-10 * YEAR_S * S, 10 * YEAR_S * S), st.integers(0, 2))
def test_setting_a_clock_changes_its_offset_and_nothing_else(shift_ns: int, who: int) -> None:
    there = [
        dataclasses.replace(robot, clock=Clock(20 * YEAR_S * S, 30.0 * k)) for k, robot in enumerate(THREE)
    ]
    runs, moved = (fleet(there, 6.0, 3) for _ in range(2))
    moved[who].told = [raw._replace(log_time_ns=raw.log_time_ns + shift_ns) for raw in moved[who].told]
    before, after = align_runs(runs), align_runs(moved)
    times = np.array([raw.log_time_ns for raw in runs[who].told])
    root_shift_ns = shift_ns if who == 0 else 0  # the reference takes common time along
    common = before.common_ns_array(runs[who], times) + root_shift_ns
    assert (after.common_ns_array(moved[who], times + shift_ns) == common).all()
    for a, b in zip(before.clocks, after.clocks, strict=True):
        assert dataclasses.replace(a, offset_ns=0) == dataclasses.replace(b, offset_ns=0)


def test_a_listener_that_nobody_hears_is_aligned_by_what_it_hears() -> None:
    listener = dataclasses.replace(THREE[1], least_latency_s=0.0005)
    there = [THREE[0], listener, THREE[2]]
    runs = fleet(there, SECONDS, 4, Air(deaf=frozenset({(1, 0), (1, 2)})))
    alignment = align_runs(runs)
    assert errors_ns(alignment, runs, there)[1] <= alignment.clocks[1].uncertainty_ns < 2_500_000


def test_robots_that_do_not_hear_each_other_are_aligned_through_a_third() -> None:
    deaf = frozenset({(0, 2), (2, 0)})
    runs = fleet(THREE, SECONDS, 5, Air(deaf=deaf))
    alignment = align_runs(runs)
    assert alignment.clocks[2].through == runs[1].name
    assert errors_ns(alignment, runs, THREE)[2] <= alignment.clocks[2].uncertainty_ns


def test_a_robot_without_radio_traffic_is_refused_by_name() -> None:
    runs = fleet(THREE, 5.0, 6, Air(deaf=frozenset({(2, 0), (2, 1), (0, 2), (1, 2)})))
    with pytest.raises(HippomatError, match=f"no radio traffic links {runs[2].name} .*--trust-clocks"):
        align_runs(runs)


def test_frames_that_two_logs_claim_to_have_sent_align_nobody() -> None:
    twins = [THREE[0], dataclasses.replace(THREE[1], radio_id=0), THREE[2]]
    runs = fleet(twins, 5.0, 7, Air(deaf=frozenset({(2, 0), (2, 1)})))
    with pytest.raises(HippomatError, match="no radio traffic"):
        align_runs(runs)


def test_any_robot_can_be_the_reference() -> None:
    runs = fleet(THREE, SECONDS, 8)
    alignment = align_runs(runs, reference=2)
    assert alignment.reference == runs[2].name
    assert max(errors_ns(alignment, runs, THREE, reference=2)) < 1_000_000
    with pytest.raises(HippomatError, match="there is no run of robot 7"):
        align_runs(runs, reference=7)
    with pytest.raises(HippomatError, match="there is no run of robot 7: there are those of 1"):
        align_runs(runs[1:2], reference=7)


def test_one_run_and_trusted_clocks_are_left_as_they_are() -> None:
    runs = fleet(THREE, 2.0, 9)
    for alignment in (align_runs(runs[:1]), Alignment.trusting(runs)):
        assert alignment.common_ns(runs[0], 1_234_567_890_123_456_789) == 1_234_567_890_123_456_789
    with pytest.raises(HippomatError, match="not among the runs"):
        align_runs(runs[:1]).common_ns(runs[1], 0)


@given(
    st.integers(-(2**60), 2**60),
    st.integers(-(2**60), 2**60),
    st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=5),
    st.lists(st.integers(-(10**13), 10**13), min_size=1, max_size=20),
)
def test_a_clock_map_and_its_inverse_cancel(
    origin_ns: int, shift_ns: int, extras: list[float], since_ns: list[int]
) -> None:
    knots = np.arange(len(extras)) * 60e9
    map_ = ClockMap(origin_ns, shift_ns, knots, np.array(extras))
    own = origin_ns + np.array(since_ns, np.int64)
    assert np.abs(map_.inverse(map_(own)) - own).max() <= 1
    assert (constant(shift_ns)(own) == own + shift_ns).all()
