"""Laws of the schedule: turns of a round, who shares one, what fits. Drives the C."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from c_values import ffi, lib
from hypothesis import given, settings
from hypothesis import strategies as st

laws = settings(max_examples=200, deadline=None, derandomize=True)

PHASES = lib.RC_PHASES
LATEST_US = lib.RC_SLOT_LATEST_US
FRAME_US = lib.rc_airtime_us(lib.RC_MAX_FRAME, 6)

robots = st.integers(0, lib.RC_MAX_ROBOTS - 1)
salts = st.integers(0, 2**32 - 1)
fleet_times = st.one_of(st.integers(0, 10**7), st.integers(0, 2**47))


def a_schedule(round_ms: int, slots: int) -> Any:
    return ffi.new("rc_schedule *", {"round_ms": round_ms, "slots": slots})


def fits(round_ms: int, slots: int) -> bool:
    return 3 * slots * lib.RC_SLOT_MIN_US <= round_ms * 1000


@st.composite
def schedules(draw: st.DrawFn) -> Any:
    round_ms = draw(st.integers(lib.RC_ROUND_MIN_MS, lib.RC_ROUND_MAX_MS))
    most = max(slots for slots in range(1, lib.RC_MAX_ROBOTS + 1) if fits(round_ms, slots))
    return a_schedule(round_ms, draw(st.integers(1, most)))


def turns_of(schedule: Any, robot: int, salt: int, begin_us: int, end_us: int) -> list[Any]:
    """All turns that begin in begin_us .. end_us, in the order in which they come up."""
    found = []
    turn = lib.rc_next_turn(schedule, robot, salt, begin_us)
    while turn.start_us < end_us:
        found.append(turn)
        turn = lib.rc_next_turn(schedule, robot, salt, turn.latest_us + 1)
    return found


def turns_in_round(schedule: Any, robot: int, salt: int, number: int) -> list[Any]:
    begin_us = lib.rc_round_start_us(schedule, number)
    return turns_of(schedule, robot, salt, begin_us, begin_us + schedule.round_ms * 1000)


def test_thirty_two_robots_fit_a_round_of_100_ms_and_one_more_does_not():
    assert lib.rc_schedule_valid(a_schedule(100, 32))
    assert not lib.rc_schedule_valid(a_schedule(100, 33))
    assert lib.rc_schedule_valid(a_schedule(200, 64))


@pytest.mark.parametrize(
    ("round_ms", "slots"), [(0, 5), (49, 5), (1001, 5), (65535, 5), (100, 0), (1000, 65), (1000, 255), (0, 0)]
)
def test_a_schedule_out_of_range_is_refused(round_ms, slots):
    assert not lib.rc_schedule_valid(a_schedule(round_ms, slots))


@given(st.integers(0, 65535), st.integers(0, 255))
@laws
def test_a_schedule_is_valid_if_and_only_if_its_shortest_slots_fit(round_ms, slots):
    in_range = 50 <= round_ms <= 1000 and 1 <= slots <= 64
    assert lib.rc_schedule_valid(a_schedule(round_ms, slots)) == (in_range and fits(round_ms, slots))


@given(schedules())
@laws
def test_all_slots_lie_within_the_round_and_leave_a_quarter_where_they_can(schedule):
    slot_us, round_us = lib.rc_slot_us(schedule), schedule.round_ms * 1000
    observed_us = lib.rc_observed_us(schedule)
    assert observed_us == PHASES * schedule.slots * slot_us <= round_us
    assert lib.RC_SLOT_MIN_US <= slot_us <= lib.RC_SLOT_MAX_US
    assert slot_us == lib.RC_SLOT_MIN_US or observed_us <= round_us * 3 / 4


def test_the_slots_of_30_robots_are_1040_us_and_those_of_few_no_longer_than_twice_that():
    assert lib.rc_slot_us(a_schedule(100, 30)) == 1040
    assert lib.rc_slot_us(a_schedule(100, 20)) == 1250
    assert lib.rc_slot_us(a_schedule(100, 5)) == 2080


def test_the_longest_frame_of_a_clock_that_is_off_by_the_promised_300_us_stays_in_its_slot():
    assert lib.RC_SLOT_MIN_US >= FRAME_US + 2 * 300


@given(schedules(), st.integers(0, 2**47))
@laws
def test_a_round_begins_at_a_multiple_of_its_length(schedule, fleet_us):
    number = lib.rc_round_of(schedule, fleet_us)
    begin_us = lib.rc_round_start_us(schedule, number)
    assert begin_us <= fleet_us < begin_us + schedule.round_ms * 1000
    assert begin_us == number * schedule.round_ms * 1000
    assert lib.rc_round_of(schedule, begin_us) == number


@given(schedules(), salts, st.integers(0, 2**24))
@laws
def test_turns_of_ids_with_a_slot_never_overlap(schedule, salt, number):
    turns = [
        (turn.start_us, turn.latest_us)
        for robot in range(schedule.slots)
        for turn in turns_in_round(schedule, robot, salt, number)
    ]
    turns.sort()
    assert len(turns) == PHASES * schedule.slots
    for (start_us, latest_us), (next_start_us, _) in itertools.pairwise(turns):
        assert start_us + LATEST_US == latest_us
        assert latest_us + FRAME_US < next_start_us


@given(schedules(), robots, salts, st.integers(0, 2**24))
@laws
def test_every_id_has_three_turns_in_a_round_one_of_each_phase_within_it(schedule, robot, salt, number):
    turns = turns_in_round(schedule, robot, salt, number)
    assert [(turn.round, turn.phase) for turn in turns] == [(number, phase) for phase in range(PHASES)]
    phase_us = schedule.slots * lib.rc_slot_us(schedule)
    for turn in turns:
        since_us = turn.start_us - lib.rc_round_start_us(schedule, number) - turn.phase * phase_us
        assert since_us >= 0
        assert turn.latest_us - turn.start_us == LATEST_US
        assert since_us + LATEST_US < phase_us


@given(schedules(), robots, salts, fleet_times)
@laws
def test_the_next_turn_is_the_first_that_is_not_over(schedule, robot, salt, fleet_us):
    number = lib.rc_round_of(schedule, fleet_us)
    begin_us = lib.rc_round_start_us(schedule, number)
    ahead = turns_of(schedule, robot, salt, begin_us, begin_us + 2 * schedule.round_ms * 1000)
    first = next(turn for turn in ahead if turn.latest_us >= fleet_us)
    turn = lib.rc_next_turn(schedule, robot, salt, fleet_us)
    assert (turn.round, turn.phase, turn.start_us, turn.latest_us) == (
        *(first.round, first.phase),
        *(first.start_us, first.latest_us),
    )


@pytest.mark.parametrize("robot", [3, 40])
def test_a_turn_may_be_taken_until_its_latest_start_and_is_skipped_from_then_on(robot):
    schedule = a_schedule(100, 5)
    turn = lib.rc_next_turn(schedule, robot, 1, 10**9)
    for fleet_us in (turn.start_us, turn.start_us + 1, turn.latest_us):
        assert lib.rc_next_turn(schedule, robot, 1, fleet_us).start_us == turn.start_us
    assert lib.rc_next_turn(schedule, robot, 1, turn.latest_us + 1).start_us > turn.latest_us


def test_the_last_turn_of_a_round_is_followed_by_the_first_of_the_next():
    schedule = a_schedule(100, 5)
    turn = lib.rc_next_turn(schedule, 4, 0, 99_999)
    assert (turn.round, turn.phase, turn.start_us) == (1, 0, 100_000 + 4 * 2080)


@pytest.mark.parametrize("same_salt", [False, True])
def test_ids_without_a_slot_vary_so_that_no_pair_meets_every_time(same_salt):
    schedule = a_schedule(100, 32)
    turns_us = {
        robot: [
            lib.rc_next_turn(schedule, robot, 7 if same_salt else 7 * robot, 100_000 * number).start_us
            for number in range(200)
        ]
        for robot in range(32, 64)
    }
    for one, other in itertools.combinations(turns_us.values(), 2):
        meetings = sum(abs(a - b) < FRAME_US for a, b in zip(one, other, strict=True))
        assert meetings < 30


def test_ids_without_a_slot_use_all_slots_and_all_of_the_first_half_millisecond():
    schedule = a_schedule(100, 8)
    slot_us, used, later_us = lib.rc_slot_us(schedule), [0] * 8, []
    for number in range(4000):
        for turn in turns_in_round(schedule, 50, 99, number):
            slot, late_us = divmod(turn.start_us - 100_000 * number, slot_us)
            used[slot - 8 * turn.phase] += 1
            later_us.append(late_us)
    assert all(1300 < times < 1700 for times in used)
    assert (min(later_us), max(later_us)) == (0, LATEST_US)
    assert abs(sum(later_us) / len(later_us) - LATEST_US / 2) < 10


def test_noise_is_the_same_everywhere_and_sets_every_bit_half_of_the_time():
    assert (lib.rc_noise(0, 0), lib.rc_noise(0, 1)) == (0x92CA2F0E, 0x3CD6E3F3)
    assert (lib.rc_noise(1, 0), lib.rc_noise(2**32 - 1, 2**32 - 1)) == (0x50653BED, 0xE2F916B5)
    for salt in (0, 1, 2**31):
        bits = [lib.rc_noise(salt, index) for index in range(4096)]
        assert len(set(bits)) > 4090
        for bit in range(32):
            assert 1850 < sum(value >> bit & 1 for value in bits) < 2250
