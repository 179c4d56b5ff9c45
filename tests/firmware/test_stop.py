"""STOP and RESUME: raised, flooded, latched, answered and kept, by several of the firmware's own radios."""

from __future__ import annotations

import random

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
    pauses = [after.at_us - before.at_us for before, after in zip(sent, sent[1:], strict=False)]
    assert min(pauses) >= 5_000
    assert max(pauses) <= 15_000
    assert {(one.body.counter, one.body.origin) for one in sent} == {(1, 255)}
    assert latch(radio) == (1, 0)
    assert messages(radio, link.Status)[-1].stop_counter == 1


def test_after_the_burst_it_goes_on_once_a_round_until_every_live_robot_shows_it():
    radio = a_radio(robot=3)
    for robot in (0, 1):
        hear(radio, 0, frame_of(robot, 1, a_state()))
    radio.usb_rx(1000, STOP)
    assert len(sent_until(radio, 1000, 1_000_000)) > 23
    hear(radio, 1_000_000, frame_of(0, 2, a_state(stop=(True, 1))))
    assert len(sent_until(radio, 1_000_001, 1_500_000)) > 2
    hear(radio, 1_500_001, frame_of(1, 2, a_state(stop=(True, 1))))
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
    radio.usb_rx(0, resume(2))
    radio.usb_rx(0, resume(0))
    assert latch(radio) == (1, 0)
    radio.usb_rx(0, resume(1))
    assert latch(radio) == (1, 1)
    hear(radio, 1, stop_frame(5, 1, 1, counter=2))
    hear(radio, 2, stop_frame(5, 1, 2, counter=1, resume=True))
    assert latch(radio) == (2, 1)


def test_late_stops_that_were_resumed_stop_nobody_and_are_told_so():
    radio = a_radio(robot=3, stop_counter=5, stop_resumed=5)
    hear(radio, 0, stop_frame(6, 1, 1, counter=3))
    assert latch(radio) == (5, 5)
    answers = [one for one in sent_until(radio, 0, 400_000) if one.header.kind == air.RESUME]
    assert [one.body.counter for one in answers] == [5]


def test_an_operator_who_had_not_heard_the_fleet_yet_stops_it_all_the_same():
    """His counter begins at 1; the fleet has resumed 5 already."""
    dongle, robot = a_radio(robot=255), a_radio(robot=3, stop_counter=5, stop_resumed=5)
    dongle.usb_rx(0, STOP)
    exchange([dongle, robot], 0, 400_000, loss=0.0)
    assert latch(robot) == latch(dongle) == (6, 5)


def test_the_state_of_a_resumed_fleet_also_shows_a_stale_operator_what_to_raise():
    dongle = a_radio(robot=255)
    dongle.usb_rx(0, STOP)
    hear(dongle, 1, frame_of(2, 1, a_state(stop=(False, 9))))
    assert latch(dongle) == (10, 9)


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
    assert latch(again) == (1, 0)


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


def test_a_passive_radio_still_stops_the_fleet():
    radio = a_radio(robot=3)
    hear(radio, 0, frame_of(3, 1, a_state()))
    radio.usb_rx(10, STOP)
    assert sent_until(radio, 10, 300_000)


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
    radios[1].usb_rx(300_000, resume(1))
    exchange(radios, 300_000, 700_000, 0.3, seed=2)
    assert [latch(radio) for radio in radios] == [(1, 1)] * 5


def test_frames_of_a_stop_decode_as_the_golden_wire_says():
    frame = stop_frame(255, 3, 1, counter=7)
    header, body = codec.decode_frame(frame)
    assert (header.sender, header.kind, body.counter) == (air.OPERATOR, air.STOP, 7)
