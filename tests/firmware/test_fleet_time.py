"""Laws of one fleet clock: it never steps back, its inverse, what it makes of what it hears. Drives the C."""

from __future__ import annotations

import statistics
from typing import Any

import pytest
from c_values import ffi, lib
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hippomat_sim.air import airtime_us

laws = settings(max_examples=200, deadline=None, derandomize=True)

START_US = 10_000
ROUND_US = 100_000
SAMPLED, JUMPED, IGNORED = lib.RC_TIME_SAMPLED, lib.RC_TIME_JUMPED, lib.RC_TIME_IGNORED
STAMP_LIMIT_US = 2**48
JUMP_LIMIT_US = 2**47

own_times = st.integers(0, 10**13)
pauses = st.one_of(st.integers(0, 3), st.integers(0, 200_000), st.integers(0, 10**9))
stamps = st.one_of(st.integers(-5_000, 5_000), st.integers(0, 2**64 - 1))  # small ones: from own fleet time
rounds = st.one_of(st.just(ROUND_US), st.integers(50_000, 5_000_000), st.integers(0, 2**32 - 1))
steps = st.lists(
    st.one_of(
        st.tuples(st.just("hear"), pauses, stamps),
        st.tuples(st.just("close"), pauses, rounds),
    ),
    max_size=40,
)


def a_clock(own_us: int = 0) -> Any:
    time = ffi.new("rc_fleet_time *")
    lib.rc_fleet_time_init(time, own_us)
    return time


def at(time: Any, own_us: int) -> int:
    return int(lib.rc_fleet_time_at(time, own_us))


def hear(time: Any, own_us: int, ahead_us: int) -> int:
    """A frame without a way whose sender is ahead_us ahead of us."""
    return int(lib.rc_fleet_time_heard(time, own_us, at(time, own_us) + ahead_us, 0))


def live(time: Any, own_us: int, happened: list[tuple[str, int, int]]) -> int:
    """The own time after all of it; asserts on the way that fleet time never goes back."""
    shown_us = at(time, own_us)
    for what, pause_us, value in happened:
        for between_us in (own_us + pause_us // 3, own_us + pause_us):
            assert at(time, between_us) >= shown_us
            shown_us = at(time, between_us)
        own_us += pause_us
        if what == "close":
            lib.rc_fleet_time_end_round(time, own_us, value)
        else:
            stamp_us = value if value > 5_000 else max(0, shown_us + value)
            lib.rc_fleet_time_heard(time, own_us, stamp_us, 300)
        assert at(time, own_us) >= shown_us
        shown_us = at(time, own_us)
    return own_us


@given(own_times, steps)
@laws
def test_fleet_time_never_steps_back_whatever_is_heard_and_however_late_rounds_are_closed(own_us, happened):
    time = a_clock(own_us)
    end_us = live(time, own_us, happened)
    assert at(time, own_us) <= at(time, end_us) < 2**63
    assert abs(time.slew_us) <= lib.RC_MAX_SLEW_US


@given(own_times, steps, st.integers(0, 3_000_000))
@laws
def test_when_names_the_first_own_time_at_which_a_fleet_time_is_reached(own_us, happened, ahead_us):
    time = a_clock(own_us)
    live(time, own_us, happened)
    fleet_us = time.base_fleet_us + ahead_us
    found_us = lib.rc_fleet_time_when(time, fleet_us)
    assert at(time, found_us) >= fleet_us
    assert found_us == time.base_own_us or at(time, found_us - 1) < fleet_us
    assert lib.rc_fleet_time_when(time, at(time, found_us)) <= found_us


@given(st.integers(-500, 500), st.integers(0, 500_000), st.integers(1, 50_000))
@laws
def test_a_slew_spreads_evenly_and_is_complete_at_the_end_of_the_round(slew_us, into_us, rounds_later):
    time = a_clock(START_US)
    for _ in range(4):
        hear(time, START_US, 2 * slew_us)
    lib.rc_fleet_time_end_round(time, START_US, 500_000)
    assert time.slew_us == slew_us
    exact_us = into_us * slew_us / 500_000
    assert exact_us - 1 < at(time, START_US + into_us) - START_US - into_us <= exact_us
    end_us = START_US + 500_000 * rounds_later
    assert at(time, end_us) == end_us + slew_us


def test_a_sender_far_ahead_is_followed_at_once_and_one_far_behind_is_ignored():
    time = a_clock(50_000)
    assert hear(time, 60_000, lib.RC_JUMP_US + 1) == JUMPED
    assert at(time, 60_000) == 60_000 + lib.RC_JUMP_US + 1
    assert hear(time, 60_000, -lib.RC_JUMP_US - 1) == IGNORED
    assert at(time, 60_000) == 60_000 + lib.RC_JUMP_US + 1
    assert hear(time, 60_000, lib.RC_JUMP_US) == hear(time, 60_000, -lib.RC_JUMP_US) == SAMPLED
    assert (time.jumps, time.count) == (1, 2)


def test_the_way_of_a_frame_is_added_to_its_stamp():
    time = a_clock()
    assert lib.rc_fleet_time_heard(time, 1_000, 10**9, 364) == JUMPED
    assert at(time, 1_000) == 10**9 + 364


def test_a_jump_forgets_what_was_heard_on_the_clock_before():
    time = a_clock()
    hear(time, 0, 900)
    hear(time, 0, 10**6)
    lib.rc_fleet_time_end_round(time, ROUND_US, ROUND_US)
    assert (time.slew_us, time.count) == (0, 0)


@pytest.mark.parametrize("stamp_us", [JUMP_LIMIT_US, STAMP_LIMIT_US - 1, STAMP_LIMIT_US, 2**63, 2**64 - 1])
def test_a_poisoned_stamp_cannot_push_the_fleet_to_the_end_of_its_range(stamp_us):
    time = a_clock(10**12)
    assert lib.rc_fleet_time_heard(time, 10**12, stamp_us, 300) == IGNORED
    assert (at(time, 10**12), time.count) == (10**12, 0)


def test_a_stamp_that_no_frame_can_carry_is_not_wrapped_around():
    assert lib.rc_fleet_time_heard(a_clock(START_US), START_US, 2**64 - 300, START_US + 300) == IGNORED


def test_an_own_time_before_the_last_call_shows_what_that_showed():
    time = a_clock(START_US)
    assert [at(time, own_us) for own_us in (0, START_US - 1, START_US)] == [START_US] * 3


def test_a_fleet_that_has_grown_past_the_limit_of_jumps_still_keeps_together():
    time = a_clock(JUMP_LIMIT_US + 10**12)
    assert hear(time, JUMP_LIMIT_US + 10**12, 200) == SAMPLED
    assert hear(time, JUMP_LIMIT_US + 10**12, 5_000) == IGNORED


def reference_slew_us(aheads_us: list[int], round_us: int) -> int:
    """Half of the median of these and our own 0, both rounded towards 0."""
    median_us = int(statistics.median([*aheads_us, 0]))
    return max(-min(500, round_us // 1000), min(500, int(median_us / 2)))


@given(
    st.lists(st.integers(-1_000, 1_000), max_size=lib.RC_TIME_SAMPLES),
    st.sampled_from((50_000, 100_000, 5_000_000)),
)
@example([-1_000] * 4, 5_000_000)
@laws
def test_the_slew_is_half_the_median_and_our_own_clock_takes_part_in_it(aheads_us, round_us):
    time = a_clock(START_US)
    for ahead_us in aheads_us:
        assert hear(time, START_US, ahead_us) == SAMPLED
    lib.rc_fleet_time_end_round(time, START_US, round_us)
    assert time.slew_us == reference_slew_us(aheads_us, round_us)


@given(st.lists(st.integers(-90, 90), min_size=1, max_size=60))
@laws
def test_the_median_favours_neither_side(aheads_us):
    slews_us = []
    for sign in (1, -1):
        time = a_clock(START_US)
        for ahead_us in aheads_us:
            hear(time, START_US, sign * ahead_us)
        lib.rc_fleet_time_end_round(time, START_US, ROUND_US)
        slews_us.append(time.slew_us)
    assert slews_us[0] == -slews_us[1]


def test_of_more_samples_than_there_is_room_for_the_newest_count():
    time = a_clock(START_US)
    for ahead_us in [-80] * 100 + [60] * lib.RC_TIME_SAMPLES:
        hear(time, START_US, ahead_us)
    lib.rc_fleet_time_end_round(time, START_US, ROUND_US)
    assert time.median_us == 60


def test_what_is_left_of_a_slew_goes_on_in_the_next_round_and_is_not_ordered_twice():
    time = a_clock()
    hear(time, 0, 800)
    hear(time, 0, 800)
    lib.rc_fleet_time_end_round(time, 0, ROUND_US)
    assert time.slew_us == 400
    target_us = ROUND_US // 4 + 800  # what the others' clocks show a quarter of the round later
    assert lib.rc_fleet_time_heard(time, ROUND_US // 4, target_us, 0) == SAMPLED
    assert time.samples[0] == 400
    lib.rc_fleet_time_end_round(time, ROUND_US // 4, ROUND_US)
    assert time.slew_us == 300 + 100
    assert at(time, 2 * ROUND_US) == 2 * ROUND_US + 500


def test_a_round_that_is_closed_twice_slews_no_further():
    once, twice = a_clock(), a_clock()
    for time in (once, twice):
        hear(time, 0, 400)
        lib.rc_fleet_time_end_round(time, ROUND_US, ROUND_US)
    for own_us in (ROUND_US, ROUND_US + 7_000):
        lib.rc_fleet_time_end_round(twice, own_us, ROUND_US)
    assert at(twice, 4 * ROUND_US) == at(once, 4 * ROUND_US)


def test_agreed_means_heard_lately_near_the_others_and_three_rounds_after_a_jump():
    time = a_clock()
    agreed = []
    for number in range(16):
        if number == 1:
            hear(time, number * ROUND_US, 10**6)
        elif number < 6:
            hear(time, number * ROUND_US, 20)
        lib.rc_fleet_time_end_round(time, number * ROUND_US, ROUND_US)
        agreed.append(lib.rc_fleet_time_agreed(time))
    assert agreed == [False] * 3 + [True] * 12 + [False]
    hear(time, 16 * ROUND_US, 5)
    lib.rc_fleet_time_end_round(time, 16 * ROUND_US, ROUND_US)
    assert lib.rc_fleet_time_agreed(time)
    for _ in range(3):
        hear(time, 17 * ROUND_US, 900)
    lib.rc_fleet_time_end_round(time, 17 * ROUND_US, ROUND_US)
    assert not lib.rc_fleet_time_agreed(time)


def test_a_radio_that_is_alone_has_agreed_with_nobody():
    time = a_clock()
    for number in range(100):
        assert not lib.rc_fleet_time_agreed(time)
        lib.rc_fleet_time_end_round(time, number * ROUND_US, ROUND_US)


def test_airtimes_are_those_of_the_simulated_air_and_of_the_standard():
    assert [lib.rc_airtime_us(n, 6) for n in (61, 124, 250)] == [170, 254, 422]
    assert [lib.rc_airtime_us(n, 24) for n in (61, 124, 250)] == [62, 86, 126]
    for rate_mbps in (6, 12, 24):
        assert all(lib.rc_airtime_us(n, rate_mbps) == airtime_us(n, rate_mbps) for n in range(251))
