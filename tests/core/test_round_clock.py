"""Which round it is: the radio's count, our own behind it, repeats, jumps and hold-ups."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import given, settings
from hypothesis import strategies as st

from hippomat_core.fleet.round_clock import RoundClock
from hippomat_core.messages import RoundEnded

ROUND = 100_000_000


@dataclass
class Clock:
    """A clock and the rounds that it ended, with the radio's count from `radio_ns` on."""

    clock: RoundClock
    radio_ns: int = 0  # our stamp at which the radio's own clock shows 0

    def __post_init__(self):
        self.ended: list[tuple[int, bool]] = []

    def told(self, number: int, sent_ns: int, read_ns: int | None = None) -> bool:
        """RoundEnded, sent by the radio at `sent_ns` of our clock."""
        stamp_ns = sent_ns + 1_000_000 if read_ns is None else read_ns
        event = RoundEnded(stamp_ns, number, 0, (sent_ns - self.radio_ns) // 1000, 0, True)
        self.clock, ends = self.clock.heard(event)
        if ends:
            self._ended(stamp_ns)
        return ends

    def tick(self, stamp_ns: int) -> bool:
        due = self.clock.due(stamp_ns)
        if due:
            self.clock = self.clock.ends_alone(stamp_ns)
            self._ended(stamp_ns)
        return due

    def _ended(self, stamp_ns: int) -> None:
        self.clock = self.clock.ended(stamp_ns)
        self.ended.append((self.clock.round, self.clock.common))


def with_radio(rounds: int = 3) -> Clock:
    """Rounds 10, 11 .. were told, at 0, 100 ms .."""
    clock = Clock(RoundClock(ROUND).started(-ROUND // 4), radio_ns=-(10**9))
    for k in range(rounds):
        assert clock.told(10 + k, k * ROUND)
    return clock


def test_without_a_radio_rounds_count_from_the_start():
    clock = Clock(RoundClock(ROUND).started(0))
    for k in range(12):
        clock.tick(k * ROUND // 2)
    assert clock.ended == [(k, False) for k in range(6)]


def test_the_radio_ends_rounds_and_ticks_do_not():
    clock = Clock(RoundClock(ROUND).started(0))
    assert clock.tick(0)
    for k in range(5):
        assert clock.told(700 + k, 20_000_000 + k * ROUND)
        assert not clock.tick(50_000_000 + k * ROUND)
        assert not clock.tick(100_000_000 + k * ROUND)
    assert clock.ended == [(0, False), *((700 + k, True) for k in range(5))]


def test_when_the_radio_falls_silent_rounds_go_on_by_our_own_clock_numbered_on():
    clock = with_radio()
    ticks = [clock.tick(k * ROUND // 2) for k in range(4, 12)]
    # the last was told at 2 rounds: ours end at 3.5, 4.5 .. and at the tick behind that
    assert ticks == [False, False, False, False, True, False, True, False]
    assert clock.ended[3:] == [(13, False), (14, False)]


def test_a_radio_that_comes_back_is_followed_and_no_round_ends_twice():
    clock = with_radio()
    assert clock.tick(3 * ROUND + 60_000_000)
    assert not clock.told(13, 3 * ROUND + 70_000_000), "that one ended by our own count"
    assert not clock.tick(4 * ROUND + 60_000_000), "the radio is heard again, if late"
    assert clock.told(14, 4 * ROUND + 70_000_000)
    assert [number for number, _ in clock.ended] == [10, 11, 12, 13, 14]


def test_a_number_that_repeats_or_goes_back_is_ignored():
    clock = with_radio()
    assert not clock.told(12, 3 * ROUND)
    assert not clock.told(9, 4 * ROUND)
    assert clock.told(13, 5 * ROUND)


def test_a_number_that_jumps_forward_is_followed():
    clock = with_radio()
    assert clock.told(90_000, 3 * ROUND)
    assert clock.told(90_001, 4 * ROUND)
    assert not clock.tick(5 * ROUND)
    assert clock.tick(6 * ROUND)
    assert clock.ended[-1] == (90_002, False)


def test_a_radio_that_restarts_counts_anew():
    clock = with_radio()
    clock.radio_ns = 3 * ROUND
    assert clock.told(2, 5 * ROUND)
    assert clock.told(3, 6 * ROUND)


def test_another_radio_counts_anew_though_it_runs_for_longer():
    clock = with_radio()
    clock.clock = clock.clock.new_radio()
    clock.radio_ns = -(10**12)
    assert clock.told(2, 5 * ROUND)


def test_of_rounds_told_after_a_hold_up_only_the_newest_ends():
    clock = with_radio()
    read_ns = 9 * ROUND + 30_000_000
    assert [clock.told(10 + k, k * ROUND, read_ns) for k in range(3, 10)] == [False] * 6 + [True]
    assert clock.ended[-1] == (19, True)
    assert clock.told(20, 10 * ROUND)


def test_a_held_up_round_is_ended_by_our_own_clock_if_a_tick_comes_first():
    clock = with_radio()
    assert clock.tick(9 * ROUND + 20_000_000)
    assert clock.ended[-1] == (18, False)
    read_ns = 9 * ROUND + 30_000_000
    assert [clock.told(10 + k, k * ROUND, read_ns) for k in range(3, 10)] == [False] * 6 + [True]
    assert clock.ended[-1] == (19, True)


def test_what_is_read_shows_for_how_long_it_was_held_up():
    clock = with_radio().clock
    radio_us = (10**9 + 2 * ROUND) // 1000
    assert clock.late_ns(2 * ROUND + 1_000_000, radio_us) == 0
    assert clock.late_ns(2 * ROUND + 501_000_000, radio_us) == 500_000_000
    assert RoundClock(ROUND).late_ns(10**9, 0) == 0, "without a radio's count nothing is known"


@given(st.floats(-300e-6, 300e-6), st.integers(0, 2**31))
@settings(max_examples=20, deadline=None)
def test_clocks_that_drift_apart_for_hours_are_no_hold_up(drift, seed):
    clock = RoundClock(ROUND).started(0)
    for k in range(3000):
        way_ns = (k * 7919 + seed) % 4_000_000
        stamp_ns = k * 20 * ROUND + way_ns  # every twentieth round, for 100 minutes
        radio_us = round(k * 20 * ROUND * (1 + drift)) // 1000 + 10**9
        clock, ends = clock.heard(RoundEnded(stamp_ns, k, 0, radio_us, 0, True))
        assert ends
        assert clock.late_ns(stamp_ns, radio_us) < 30_000_000
        clock = clock.ended(stamp_ns)


@given(st.integers(150_000_000, 10**12), st.integers(0, 2**31))
@settings(max_examples=30, deadline=None)
def test_a_step_between_the_clocks_that_lasts_is_followed_within_three_seconds(step_ns, seed):
    """A hold-up ends; the machine's clock that was set, or stood still, does not come back."""
    clock = with_radio()
    ended = []
    for k in range(3, 40):
        way_ns = (k * 7919 + seed) % 9_000_000
        ended.append(clock.told(10 + k, k * ROUND, k * ROUND + step_ns + way_ns))
    assert clock.clock.steps == 1
    assert ended == [False] * 20 + [True] * 17


def test_a_backlog_that_drains_slowly_is_no_step():
    clock = with_radio()
    for k in range(3, 60):
        held_ns = 2_000_000_000 - (k - 3) * 30_000_000
        clock.told(10 + k, k * ROUND, k * ROUND + held_ns)
    assert clock.clock.steps == 0


@given(
    st.lists(st.tuples(st.integers(0, 300_000_000), st.integers(0, 3), st.booleans()), max_size=60),
)
@settings(max_examples=200)
def test_whatever_the_radio_tells_rounds_only_go_forward(steps):
    clock, now_ns, number = with_radio(), 2 * ROUND, 12
    for wait_ns, ahead, tick in steps:
        now_ns += wait_ns
        number += ahead
        if tick:
            clock.tick(now_ns)
        else:
            clock.told(number, now_ns)
    numbers = [ended for ended, _ in clock.ended]
    assert numbers == sorted(set(numbers))
