"""STOP and RESUME: raised, flooded, latched, answered and kept, by several of the firmware's own radios."""

from __future__ import annotations

import random
from dataclasses import replace
from itertools import pairwise

import pytest
from radio_desk import a_radio, a_state, frame_of, hear, mac_of, messages, sent_until, stop_frame

from hippomat_core.wire import codec, link
from hippomat_core.wire import frames as air
from hippomat_sim.radio import Memory, Radio

STOP = link.encode_message(link.Command(air.STOP, 0, 0))


def resume(counter: int) -> bytes:
    return link.encode_message(link.Command(air.RESUME, counter, 0))


def latch(radio: Radio, now_us: int = 0) -> tuple[int, int]:
    condition = radio.condition(now_us)
    assert bool(condition.flags & link.FLAG_STOPPED) == (condition.stop_counter > condition.stop_resumed)
    return condition.stop_counter, condition.stop_resumed


def test_a_stop_goes_out_at_once_twenty_times_in_300_ms_without_waiting_for_a_slot_or_for_time():
    radio = a_radio(robot=3)
    radio.usb_rx(1000, STOP)
    sent = sent_until(radio, 1000, 300_000)
    assert sent[0].at_us == 1000
    assert [one.header.kind for one in sent] == [air.STOP] * 20
    pauses = [after.at_us - before.at_us for before, after in pairwise(sent)]
    assert min(pauses) >= 5_000
    assert max(pauses) <= 15_000
    counter, resumed = latch(radio)
    assert 1 <= counter <= 16
    assert resumed == 0
    assert {(one.body.counter, one.body.origin) for one in sent} == {(counter, 255)}
    assert messages(radio, link.Status)[-1].stop_counter == counter


def test_after_the_burst_it_goes_on_once_a_round_until_every_live_robot_shows_it():
    radio = a_radio(robot=3)
    for robot in (0, 1):
        hear(radio, 0, frame_of(robot, 1, a_state()))
    radio.usb_rx(1000, STOP)
    assert len(sent_until(radio, 1000, 1_000_000)) > 23
    counter = latch(radio)[0]
    hear(radio, 1_000_000, frame_of(0, 2, a_state(stop=(True, counter))))
    assert len(sent_until(radio, 1_000_001, 1_500_000)) > 2
    hear(radio, 1_500_001, frame_of(1, 2, a_state(stop=(True, counter))))
    assert len(sent_until(radio, 1_500_002, 2_500_000)) <= 1


def test_whoever_hears_a_stop_sends_it_on_and_tells_its_host():
    radio = a_radio(robot=3)
    hear(radio, 0, stop_frame(5, 1, 1, counter=4))
    assert len(messages(radio, link.Heard)) == 1
    assert messages(radio) == []
    sent = sent_until(radio, 0, 250_000)
    assert {(one.header.kind, one.body.counter) for one in sent} == {(air.STOP, 4)}
    assert latch(radio) == (4, 0)


def test_a_resume_names_the_stop_that_it_answers_and_no_other():
    radio = a_radio(robot=3)
    radio.usb_rx(0, STOP)
    counter = latch(radio)[0]
    radio.usb_rx(0, resume(counter + 1))
    radio.usb_rx(0, resume(counter - 1))
    assert latch(radio) == (counter, 0)
    radio.usb_rx(0, resume(counter))
    assert latch(radio) == (counter, counter)
    hear(radio, 1, stop_frame(5, 1, 1, counter=counter + 1))
    hear(radio, 2, stop_frame(5, 1, 2, counter=counter, resume=True))
    assert latch(radio) == (counter + 1, counter)


def test_late_stops_that_were_resumed_stop_nobody_and_are_told_so():
    radio = a_radio(robot=3, stop_counter=5, stop_resumed=5)
    hear(radio, 0, stop_frame(6, 1, 1, counter=3))
    assert latch(radio) == (5, 5)
    answers = [one for one in sent_until(radio, 0, 400_000) if one.header.kind == air.RESUME]
    assert [one.body.counter for one in answers] == [5]


def test_an_operator_who_had_not_heard_the_fleet_yet_stops_it_all_the_same():
    """His counter begins at 1; the fleet has resumed 50 already."""
    dongle, robot = a_radio(robot=255), a_radio(robot=3, stop_counter=50, stop_resumed=50)
    dongle.usb_rx(0, STOP)
    exchange([dongle, robot], 0, 400_000, loss=0.0)
    assert latch(robot) == latch(dongle)
    assert latch(robot)[0] > latch(robot)[1] >= 50


@pytest.mark.parametrize("informed", [1, 4, 10])
def test_a_stop_by_one_who_knew_nothing_holds_although_others_who_knew_nothing_sent_it_on(informed):
    fresh = [Radio(mac_of(90 + k), k + 1, Memory(robot=255 - 255 * k, boot_counter=1)) for k in range(2)]
    known = Memory(slots=20, boot_counter=1, stop_counter=50, stop_resumed=50)
    fleet = [Radio(mac_of(k), 9 + k, replace(known, robot=k)) for k in range(1, 1 + informed)]
    fresh[0].usb_rx(0, STOP)
    exchange([*fresh, *fleet], 0, 2_000_000, loss=0.3)
    assert all(counter > 50 >= resumed for counter, resumed in map(latch, [*fresh, *fleet]))


def test_a_radio_that_missed_the_last_stop_and_its_resume_stops_rather_than_guesses():
    radio = a_radio(robot=3, stop_counter=4)
    hear(radio, 0, stop_frame(5, 1, 1, counter=9, resume=True))
    counter, resumed = latch(radio)
    assert counter > resumed == 9


def test_a_stop_raised_in_a_stopped_fleet_outlives_the_resume_of_the_first():
    radio = a_radio(robot=3)
    hear(radio, 0, stop_frame(5, 1, 1, counter=4))
    radio.press_button(1)
    hear(radio, 2, stop_frame(5, 1, 2, counter=4, resume=True))
    counter, resumed = latch(radio)
    assert counter > 4 > resumed


def test_a_robot_that_is_heard_later_and_does_not_show_the_stop_is_told_it():
    dongle = a_radio(robot=255)
    dongle.usb_rx(0, STOP)
    sent_until(dongle, 0, 70_000_000)
    hear(dongle, 70_000_001, frame_of(2, 1, a_state()))
    assert len(sent_until(dongle, 70_000_001, 71_000_000)) >= 4


def test_where_nobody_is_heard_the_stop_goes_on_for_a_minute():
    dongle = a_radio(robot=255)
    dongle.usb_rx(0, STOP)
    sent = sent_until(dongle, 0, 90_000_000)
    assert 59_000_000 < sent[-1].at_us < 61_000_000


def test_those_who_forward_a_stop_do_not_all_begin_at_once():
    radios = [Radio(mac_of(k), k + 1, Memory(robot=k, boot_counter=1)) for k in range(20)]
    firsts = []
    for radio in radios:
        hear(radio, 0, stop_frame(40, 1, 1, counter=4))
        firsts.append(sent_until(radio, 0, 20_000)[0].at_us)
    assert len(set(firsts)) > 15
    assert max(firsts) < 2_000


def test_nobody_answers_a_stop_without_a_counter():
    radio = a_radio(robot=3)
    hear(radio, 0, stop_frame(5, 1, 1, counter=0))
    assert sent_until(radio, 0, 200_000) == []


def test_the_state_of_a_resumed_fleet_also_shows_a_stale_operator_what_to_raise():
    dongle = a_radio(robot=255)
    dongle.usb_rx(0, STOP)
    hear(dongle, 1, frame_of(2, 1, a_state(stop=(False, 19))))
    assert (latch(dongle)[0] > 19, latch(dongle)[1]) == (True, 19)


def test_a_late_joiner_learns_the_stop_from_a_state_and_a_resume_too():
    radio = a_radio(robot=3)
    hear(radio, 0, frame_of(2, 1, a_state(stop=(True, 9))))
    assert latch(radio) == (9, 0)
    hear(radio, 1, frame_of(2, 2, a_state(stop=(False, 8))))
    assert latch(radio) == (9, 0)
    hear(radio, 2, frame_of(2, 3, a_state(stop=(False, 9))))
    assert latch(radio) == (9, 9)


def test_the_latch_outlives_a_reboot():
    radio = a_radio(robot=3)
    radio.usb_rx(0, STOP)
    assert radio.dirty == 8
    again = Radio(mac_of(3), 1, radio.memory.counted())
    assert latch(again) == latch(radio)
    assert latch(again)[0] > 0


def test_a_latch_that_could_not_be_stored_is_tried_again_every_second():
    radio = a_radio(robot=3)
    radio.usb_rx(0, STOP)
    radio.kept(8, False)
    assert radio.dirty == 0
    sent_until(radio, 0, 999_000)
    radio.kept(radio.dirty, False)
    sent_until(radio, 999_001, 2_000_000)
    assert radio.dirty == 8


def test_the_last_stop_is_never_resumed():
    radio = a_radio(robot=3, stop_counter=65_534, stop_resumed=65_534)
    radio.usb_rx(0, STOP)
    radio.usb_rx(0, resume(65_535))
    hear(radio, 0, stop_frame(5, 1, 1, counter=65_535, resume=True))
    assert latch(radio) == (65_535, 65_534)


def test_the_button_stops_under_the_robots_own_name():
    radio = a_radio(robot=3)
    radio.press_button(5)
    (first, *_) = sent_until(radio, 5, 100_000)
    assert (first.header.kind, first.body.origin, first.body.reason) == (air.STOP, 3, 1)


def test_the_stop_of_a_passive_twin_stops_the_fleet_and_its_twin():
    twin, other = a_radio(robot=3), Radio(mac_of(9), 1, Memory(robot=1, boot_counter=1))
    hear(twin, 0, frame_of(3, 1, a_state()))
    hear(other, 0, frame_of(3, 1, a_state()))
    twin.press_button(10)
    (first, *_) = sent_until(twin, 10, 100_000)
    assert (first.header.sender, first.body.origin) == (air.OPERATOR, 3)
    frame = codec.encode_frame(first.header, first.body)
    hear(other, 20, frame, mac_of(0))
    assert latch(other)[0] > latch(other)[1]


def test_a_stop_is_heeded_whoever_sends_it():
    """Under an id that another radio has, under our own, and from one that babbles."""
    radio = a_radio(robot=3)
    hear(radio, 0, frame_of(1, 1, a_state()))
    hear(radio, 1, stop_frame(1, 7, 1, counter=4), mac_of(77))
    assert latch(radio) == (4, 0)
    hear(radio, 2, stop_frame(3, 7, 1, counter=5))
    assert latch(radio) == (5, 0)
    for sequence in range(1, 400):
        hear(radio, 3, frame_of(2, sequence, a_state()))
    hear(radio, 4, stop_frame(2, 1, 401, counter=6))
    assert latch(radio) == (6, 0)


def exchange(radios: list[Radio], from_us: int, until_us: int, loss: float, seed: int = 1) -> dict[int, int]:
    """Radios side by side in steps of 0.5 ms; the time at which each first latched, by its place."""
    draw = random.Random(seed)
    macs = [mac_of(100 + number) for number in range(len(radios))]
    latched: dict[int, int] = {}
    for now_us in range(from_us, until_us, 500):
        for number, radio in enumerate(radios):
            radio.tick(now_us)
            frame = radio.air_tx(now_us)
            if frame is None:
                continue
            radio.air_done(now_us + 200, True)
            for other, receiver in enumerate(radios):
                if other != number and draw.random() >= loss:
                    receiver.air_rx(now_us + 400, -50, macs[number], frame)
        for number, radio in enumerate(radios):
            radio.usb_tx()
            if number not in latched and latch(radio)[0] > latch(radio)[1]:
                latched[number] = now_us - from_us
    return latched


@pytest.mark.parametrize("loss", [0.3, 0.5])
def test_a_stop_reaches_thirty_radios_within_300_ms_under_loss(loss):
    radios = [Radio(mac_of(100 + k), k + 1, Memory(robot=k, slots=30, boot_counter=1)) for k in range(30)]
    radios[7].usb_rx(0, STOP)
    latched = exchange(radios, 0, 150_000, loss)
    assert len(latched) == 30
    assert max(latched.values()) < 100_000


def test_a_resumed_fleet_stays_resumed_although_some_missed_it():
    radios = [Radio(mac_of(100 + k), k + 1, Memory(robot=k, boot_counter=1)) for k in range(5)]
    radios[0].usb_rx(0, STOP)
    exchange(radios, 0, 300_000, 0.3)
    counter = latch(radios[0])[0]
    radios[1].usb_rx(300_000, resume(counter))
    exchange(radios, 300_000, 700_000, 0.3, seed=2)
    assert [latch(radio) for radio in radios] == [(counter, counter)] * 5


def test_frames_of_a_stop_decode_as_the_golden_wire_says():
    frame = stop_frame(255, 3, 1, counter=7)
    header, body = codec.decode_frame(frame)
    assert (header.sender, header.kind, body.counter) == (air.OPERATOR, air.STOP, 7)
