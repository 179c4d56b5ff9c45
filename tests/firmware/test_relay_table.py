"""One table of the real C: which rows are held and passed on, and what is believed of whom."""

from __future__ import annotations

import dataclasses

import pytest
from c_values import lib
from relay_fleet import Table, relay_body, row_bytes, row_of, state_body

from hippomat_core.wire import codec
from hippomat_core.wire import frames as air

START = lib.RC_LOSS_START / 255


def a_table(robot: int = 0, *, n: int = 5, rounds: int = 0) -> Table:
    """It has sent its STATE in this round; in `rounds` rounds before all were heard by all."""
    table = Table(robot)
    for number in range(1, rounds + 1):
        everybody(table, number, n)
    table.begin(rounds + 1)
    table.own(state_body(robot, n=n))
    return table


def everybody(table: Table, number: int, n: int) -> None:
    table.begin(number)
    for robot in range(n):
        body = state_body(robot, n=n, heard=(1 << n) - 1)
        if robot == table.robot:
            table.own(body)
        else:
            table.state(robot, body)


def relayed(table: Table) -> set[int]:
    frame = table.passed_on()
    return {row.robot for row in frame.rows} if frame else set()


def test_a_radio_without_a_state_of_its_own_keeps_nothing():
    table = Table(0)
    table.state(1, state_body(7))
    table.relay(1, relay_body(5, [1], [row_of(1, state_body(7))]))
    assert table.held == set()
    assert table.struct.direct == 1 << 1
    assert table.fill() == b""


def test_rows_are_kept_by_the_first_round_after_the_own_state():
    table = a_table()
    assert table.held == {0}
    table.state(3, state_body(7))
    assert table.held == {0, 3}
    assert table.row(3) == row_bytes(3, state_body(7))
    table.begin(2)
    assert table.held == set()


@pytest.mark.parametrize("other", [{"digest": 1}, {"n": 6}, {"m": 5}])
def test_a_robot_of_another_digest_or_size_has_no_row_needs_none_and_passes_none_on(other):
    table = a_table(2)
    table.state(0, state_body(7))
    table.state(1, state_body(8, **other))
    assert table.held == {0, 2}
    assert relayed(table) <= {0, 2}  # to nobody but robot 0
    before = table.bytes()
    table.relay(1, relay_body(5, [1, 3], [row_of(3, state_body(9))]))
    assert table.bytes() == before
    table.begin(2)
    table.state(0, state_body(7, heard=0b11111))
    table.state(1, state_body(8))
    assert table.held == {0, 1}


def test_a_relay_of_another_size_is_ignored():
    table = a_table(2)
    table.state(1, state_body(8))
    before = table.bytes()
    for n, m in ((6, 4), (5, 5)):
        table.relay(1, relay_body(n, [1, 3], [row_of(3, state_body(9, n=n, m=m))]))
    assert table.bytes() == before


def test_a_relay_of_a_robot_whose_state_was_never_heard_is_ignored():
    table = a_table(2)
    table.relay(1, relay_body(5, [1, 3], [row_of(3, state_body(9))]))
    assert table.held == {2}


@pytest.mark.parametrize("number", [0, 2, 2**32 - 1])
def test_frames_of_other_rounds_are_ignored(number):
    table = a_table(2)
    table.state(1, state_body(8))
    before = table.bytes()
    table.own(state_body(1, digest=1), number)
    table.state(0, state_body(7), number)
    table.relay(1, relay_body(5, [1, 3], [row_of(3, state_body(9))]), number)
    assert table.bytes() == before


def test_rows_of_earlier_rounds_are_not_held():
    table = a_table(2)
    table.state(1, state_body(8))
    old = dataclasses.replace(row_of(3, state_body(9)), age=1)
    table.relay(1, relay_body(5, [1], [old]))
    assert table.held == {1, 2}


def test_a_row_may_come_through_another_before_its_owner_and_the_first_one_stays():
    table = a_table(2)
    table.state(1, state_body(8))
    table.relay(1, relay_body(5, [1, 3], [row_of(3, state_body(9))]))
    assert table.held == {1, 2, 3}
    assert not table.struct.direct & 1 << 3
    table.state(3, state_body(10))
    assert table.struct.direct & 1 << 3
    assert table.row(3) == row_bytes(3, state_body(9))
    table.relay(1, relay_body(5, [1, 3], [row_of(3, state_body(11))]))
    table.state(3, state_body(12))
    assert table.row(3) == row_bytes(3, state_body(9))


def test_nobody_says_our_own_row():
    table = Table(2)
    table.own(state_body(0))
    table.begin(1)
    table.state(1, state_body(8))
    table.relay(1, relay_body(5, [1, 2], [row_of(2, state_body(9))]))
    assert table.held == {1}


def test_a_new_digest_of_our_own_forgets_the_rows_of_the_old_one():
    table = a_table(2)
    table.state(1, state_body(8))
    table.own(state_body(3, digest=1))
    assert table.held == {2}
    table.relay(1, relay_body(5, [1, 3], [row_of(3, state_body(9))]))
    assert table.held == {2}
    table.begin(2)
    table.own(state_body(3, digest=1))
    table.state(1, state_body(8, digest=1))
    assert table.held == {1, 2}


def test_an_operator_hears_but_holds_and_sends_nothing():
    table = Table(air.OPERATOR)
    for number in range(1, 200):
        table.begin(number)
        table.state(1, state_body(7))
        assert table.fill() == b""
    assert table.held == set()
    assert table.loss_from(1) == 0.0
    assert table.loss_from(2) == pytest.approx(START, abs=0.01)


def test_a_robot_beyond_its_own_n_holds_no_row_of_its_own_and_passes_none_on():
    table = Table(7)
    table.own(state_body(7, n=5))
    table.state(1, state_body(8))
    table.state(3, state_body(8))
    assert table.held == {1, 3}
    assert table.fill() == b""


def test_what_was_heard_is_of_this_round_below_our_id_and_of_the_last_above():
    table = a_table(2)
    for robot in (1, 4):
        table.state(robot, state_body(8))
    table.begin(2)
    table.state(0, state_body(8))
    assert table.heard_bits() == 1 << 0 | 1 << 4
    table.state(4, state_body(8))
    table.begin(4)  # the round before was missed
    assert table.heard_bits() == 0


def test_who_surely_lacks_a_row_comes_before_many_who_may():
    table = a_table(4, n=10)
    for robot in (0, 1, 2):
        table.state(robot, state_body(robot, n=10))
    table.state(3, state_body(3, n=10, heard=0b101))  # it lacks row 1, has 0 and 2
    frame = table.passed_on()
    assert frame is not None
    assert frame.rows[0].robot == 1
    assert frame.held == 0b11111


def test_a_bitmap_says_who_needs_nothing():
    table = a_table(2, n=3)
    table.state(0, state_body(7, n=3))
    table.state(1, state_body(8, n=3, heard=0b101))
    table.relay(0, relay_body(3, [0, 1, 2], [row_of(1, state_body(8, n=3))]))
    table.relay(1, relay_body(3, [0, 1, 2], [row_of(0, state_body(7, n=3))]))
    assert table.fill() == b""


def test_a_robot_that_agrees_no_more_needs_nothing_in_the_same_round():
    table = a_table(2, n=3)
    table.state(1, state_body(8, n=3))
    table.begin(2)
    table.own(state_body(2, n=3))
    table.state(1, state_body(8, n=3, digest=1))
    assert table.fill() == b""


def test_a_robot_needs_no_row_of_its_own_though_it_may_have_said_none():
    table = a_table(2, n=3, rounds=200)
    table.state(1, state_body(8, n=3, heard=7))
    table.relay(1, relay_body(3, [2], [row_of(2, state_body(2, n=3))]))
    assert table.fill() == b""


@pytest.mark.parametrize(("most", "rows"), [(4, set()), (5, {2})])
def test_a_need_below_two_percent_is_none(most, rows):
    table = a_table(2, n=3, rounds=200)
    table.struct.miss[2][0] = most - 1
    table.struct.miss[2][1] = 1
    assert relayed(table) == rows


def test_what_a_relay_shows_as_missing_is_passed_on():
    table = a_table(2, n=3, rounds=200)
    table.state(0, state_body(7, n=3, heard=7))
    table.state(1, state_body(8, n=3, heard=7))
    assert table.fill() == b""
    table.relay(0, relay_body(3, [0, 2], [row_of(2, state_body(2, n=3))]))
    assert relayed(table) == {1}


@pytest.mark.parametrize("robot", [0, 3, 11])
def test_ties_go_round_from_our_own_row(robot):
    table = a_table(robot, n=12)
    for other in set(range(12)) - {robot}:
        table.state(other, state_body(other, n=12))
    for k in range(12):
        for other in set(range(12)) - {robot}:
            table.struct.miss[k][other] = 100
    frame = table.passed_on()
    assert frame is not None
    assert [row.robot for row in frame.rows] == [(robot + j) % 12 for j in range(len(frame.rows))]


@pytest.mark.parametrize(("n", "m", "rows"), [(32, 30, 5), (33, 30, 4), (64, 80, 2), (14, 1, 14), (3, 30, 3)])
def test_a_frame_carries_as_many_rows_as_fit(n, m, rows):
    table = Table(0)
    table.own(state_body(0, n=n, m=m))
    for robot in range(1, n):
        table.state(robot, state_body(robot, n=n, m=m))
    body = table.fill()
    assert len(codec.decode_body(air.RELAY, body).rows) == rows


def test_a_late_state_is_not_taken_for_one_that_nobody_heard():
    table = a_table(4, rounds=200)
    for robot in (1, 2, 3):
        below = (1 << robot) - 1 & ~1  # all but robot 0, whose host is late
        table.state(robot, state_body(robot, heard=below | 1 << 4))
    assert table.fill() == b""
    table.state(0, state_body(0, heard=0b11110))
    assert table.fill() == b""


def test_a_silent_host_ends_relaying_after_thirty_rounds():
    table = a_table(0)
    sent = []
    for number in range(2, 40):
        table.begin(number)
        for robot in (1, 2):
            table.state(robot, state_body(robot))
        sent.append(table.fill() != b"")
    assert sent == [True] * 29 + [False] * 9


def test_the_loss_of_a_link_to_us_is_learned():
    table = Table(0)
    for number in range(1, 1000):
        table.begin(number)
        table.own(state_body(0))
        table.state(1, state_body(1))
        if number % 4:
            table.state(2, state_body(2))
    assert table.loss_from(1) == 0.0
    assert table.loss_from(2) == pytest.approx(0.25, abs=0.03)
    assert table.loss_from(3) == pytest.approx(START, abs=0.01)  # never heard: unknown


def test_the_losses_of_others_are_learned_from_their_bitmaps():
    """Robot 3 hears 1 and us always, robot 0 in half of the rounds, robot 4 never."""
    table = Table(2)
    for number in range(1, 2000):
        table.begin(number)
        table.state(0, state_body(0))
        table.state(1, state_body(1))
        table.own(state_body(2))
        table.state(3, state_body(3, heard=0b0110 | number // 4 % 2))
        table.state(4, state_body(4))
    loss = [table.struct.loss[k][3] / 65536 for k in range(5)]
    assert loss[1] < 0.001
    assert loss[2] < 0.001
    assert loss[4] > 0.999
    assert loss[0] == pytest.approx(0.5, abs=0.1)


def test_silence_of_a_host_is_no_loss_of_its_links():
    table = a_table(2, rounds=400)
    for number in range(402, 450):
        table.begin(number)
        table.own(state_body(2))
        table.state(3, state_body(3, heard=0b10110))
    assert table.struct.loss[0][3] == pytest.approx(0, abs=16)
