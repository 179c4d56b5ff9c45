"""Who shows that it is stopped, as a pure function of what a radio tells."""

from __future__ import annotations

import numpy as np
from radio_samples import status_of

from hippomat_core.wire import frames as air
from hippomat_core.wire.codec import encode_frame
from hippomat_core.wire.link import Heard
from hippomat_host.stop_watch import StopWatch

NONE = np.zeros(0, np.uint8)


def state(robot: int, stopped: bool, counter: int) -> Heard:
    flags = air.FLAG_STOPPED * stopped
    four, five = np.zeros(4, np.uint8), np.zeros(5, np.uint8)
    frame = air.StateFrame(
        *(air.IDLE, flags, 0, 0, 0, 0, 0, air.NO_CLAIM, four, four, 0, 0, 0, NONE),
        *(0, five, 1, 2, counter),
    )
    return Heard(0, 0, -50, encode_frame(air.Header(air.STATE, False, 1, robot, 1, 1, 0), frame))


def relay(sender: int, robot: int, stopped: bool, age: int = 0) -> Heard:
    row = air.RelayRow(
        *(robot, age, air.IDLE, air.NO_SLOT, 0, 0, False, 0, True, stopped, 0, 0, 0, 0), np.zeros(4, np.uint8)
    )
    frame = air.RelayFrame(5, 0, (row,))
    return Heard(0, 0, -50, encode_frame(air.Header(air.RELAY, False, 1, sender, 1, 1, 0), frame))


def test_a_robot_shows_a_stop_by_its_own_counter_or_a_later_one_and_only_since_then() -> None:
    watch = StopWatch(255)
    watch.hear(0.0, status_of(stop_counter=4, stop_resumed=3))
    for robot, stopped, counter in ((0, True, 4), (1, True, 5), (2, True, 3), (3, False, 4)):
        watch.hear(1.0, state(robot, stopped, counter))
    assert watch.shows_stop(0.5) == [0, 1]
    assert watch.shows_stop(1.0) == []
    assert watch.shows_go(0.5) == [3]
    assert watch.stopped == [0, 1, 2]
    assert watch.heard == [0, 1, 2, 3]
    assert watch.counter == 5


def test_a_relayed_row_speaks_for_a_robot_that_is_not_heard_and_is_as_old_as_it_says() -> None:
    watch = StopWatch(255)
    watch.hear(0.0, status_of(stop_counter=1, round_ms=100))
    watch.hear(1.0, relay(0, 3, stopped=True, age=5))
    assert watch.robots[3].at_s < 0.5
    assert watch.shows_stop(0.5) == []
    watch.hear(1.0, relay(0, 3, stopped=True))
    assert watch.shows_stop(0.5) == [3]
    watch.hear(1.1, state(3, False, 1))
    watch.hear(1.12, relay(0, 3, stopped=True))  # older than what it said itself
    assert watch.shows_stop(0.0) == []


def test_a_radio_that_is_alive_counts_as_heard_and_our_own_robot_does_not() -> None:
    watch = StopWatch(2)
    watch.hear(0.0, status_of(robot=2, alive=0b10110))
    watch.hear(0.0, relay(1, 2, stopped=False))
    assert watch.heard == [1, 4]


def test_counters_are_told_by_how_much_they_grew() -> None:
    watch = StopWatch(255)
    assert watch.grown("dropped_seal") == 0
    watch.hear(0.0, status_of(dropped_seal=100))
    watch.hear(1.0, status_of(dropped_seal=117))
    assert watch.grown("dropped_seal") == 17


def test_a_frame_that_is_none_is_nobodys() -> None:
    watch = StopWatch(255)
    watch.hear(0.0, Heard(0, 0, -50, bytes(30)))
    assert watch.heard == []


def test_a_radio_that_restarts_counts_anew() -> None:
    watch = StopWatch(255)
    watch.hear(0.0, status_of(boot_id=1, dropped_seal=100))
    watch.hear(1.0, status_of(boot_id=2, dropped_seal=3))
    assert watch.grown("dropped_seal") == 0
    watch.hear(2.0, status_of(boot_id=2, dropped_seal=8))
    assert watch.grown("dropped_seal") == 5
