"""The real shell around the real core on a fake chip: frames, host port, wake-ups, heap, button, LED."""

from __future__ import annotations

import itertools

import pytest
from chip import KEY, UNIX_S, Chip, hello, identity_in_flash, keyed_flash, sealed, send_state, status_of
from radio_desk import a_state, frame_of, mac_of

from hippomat_core.wire import codec, link
from hippomat_core.wire import frames as air

ROBOT = {"identity": identity_in_flash()}
SLOT_US, ROUND_US = 2080, 100_000  # five slots in 100 ms
APART_US = 200  # a turn begins up to this late, a little different each time


def frames_of(robot: int, count: int, first: int = 1) -> list[bytes]:
    return [frame_of(robot, first + i, a_state(m=30)) for i in range(count)]


def times(of: Chip, word: str) -> list[int]:
    return [int(at) for at, *_ in of.said(word)]


# ---- the air -------------------------------------------------------------------------------------


def test_frames_heard_reach_the_host_with_their_rssi(chip):
    radio = chip(ROBOT).boot()
    (frame,) = frames_of(4, 1)
    radio.hear(mac_of(4), frame, -71)
    radio.run_ms(5)
    (heard,) = radio.messages(link.Heard)
    assert (heard.frame, heard.rssi_dbm) == (frame, -71)


def test_more_frames_than_the_queue_holds_are_counted_as_lost(chip):
    radio = chip(ROBOT).boot()
    for frame in frames_of(4, 60):
        radio.hear(mac_of(4), frame)
    status = status_of(radio)
    assert (status.received, status.dropped_usb) == (48, 12)


@pytest.mark.parametrize("n", [0, 251])
def test_a_frame_of_an_impossible_length_is_dropped_in_the_callback(chip, n):
    radio = chip(ROBOT).boot()
    radio.hear(mac_of(4), bytes(n))
    assert status_of(radio).dropped_usb == 1


def test_a_state_goes_out_at_the_start_of_its_slot(chip):
    """A FreeRTOS tick alone would be up to a millisecond late."""
    radio = chip(ROBOT).boot(400)
    late_us = []
    for _ in range(20):
        send_state(radio, 99.7)
    for _, frame in radio.sent():
        header = codec.decode_header(frame)
        late_us.append(header.fleet_time_us % ROUND_US - 3 * SLOT_US)
    assert len(late_us) == 20
    assert min(late_us) >= 0
    assert max(late_us) < 100 + APART_US


def test_the_alarm_is_set_for_what_the_core_wants_next(chip):
    radio = chip(ROBOT).boot(400)
    radio.tell("alarms")
    radio.run_ms(100)
    starts = {(int(at) - 3 * SLOT_US) % ROUND_US for (at,) in radio.said("alarm")}
    assert any(start <= APART_US or start >= ROUND_US - 2 for start in starts)
    assert len(radio.said("alarm")) < 30  # an alarm that stays as it is is not set again


def test_a_send_callback_that_stays_away_holds_up_one_frame_for_50_ms(chip):
    radio = chip(ROBOT).boot(400)
    radio.tell("espnow silent 1")
    send_state(radio, 100)
    send_state(radio, 100)
    send_state(radio, 100)
    assert len(radio.sent()) == 3
    status = status_of(radio)
    assert (status.sent, status.send_failed) == (2, 1)


def test_espnow_starts_anew_when_twenty_sends_had_no_callback(chip):
    radio = chip(ROBOT).boot(400)
    radio.tell("espnow silent 20")
    for _ in range(20):
        send_state(radio, 100)
    assert radio.said("espnow") == [["starts"]]
    for _ in range(3):
        send_state(radio, 100)
    assert radio.said("espnow") == [["starts"], ["ends"], ["starts"]]
    assert status_of(radio).sent == 3


def test_a_driver_without_memory_is_left_alone_for_longer_and_longer_and_then_started_anew(chip):
    radio = chip(ROBOT).boot(400)
    radio.tell("espnow no-memory 12")
    radio.tell("press")  # a STOP is flooded: there is always something to send
    radio.run_ms(1020)
    radio.tell("release")
    radio.run_ms(900)
    refused = times(radio, "refused")
    assert len(refused) == 12
    pauses_us = [b - a for a, b in itertools.pairwise(refused)]
    least = [2000, 4000, 8000, 16000, 32000, *[64000] * 6]
    assert all(pause >= want for pause, want in zip(pauses_us, least, strict=True))
    assert sum(pauses_us) < 1.3 * sum(least)
    assert radio.said("espnow") == [["starts"], ["ends"], ["starts"]]
    assert status_of(radio).sent >= 5


# ---- the host ------------------------------------------------------------------------------------


def test_a_host_that_does_not_read_loses_whole_messages_and_each_is_counted(chip):
    radio = chip(ROBOT).boot()
    radio.messages()
    radio.tell("closed")
    for frame in frames_of(4, 100):
        radio.hear(mac_of(4), frame)
        radio.run_ms(5)
    radio.tell("open")
    radio.run_ms(20)
    heard = radio.messages(link.Heard)  # and not a byte that belongs to none
    lost = status_of(radio).dropped_usb
    assert 20 < len(heard) < 40  # what the driver's ring holds
    assert 100 <= len(heard) + lost < 120  # rounds and the status among them


def test_a_host_that_pauses_for_15_ms_loses_nothing(chip):
    radio = chip(ROBOT).boot()
    radio.tell("closed")
    for frame in frames_of(4, 40):
        radio.hear(mac_of(4), frame)
    radio.run_ms(15)
    radio.tell("open")
    radio.run_ms(50)
    assert len(radio.messages(link.Heard)) == 40
    assert status_of(radio).dropped_usb == 0


def test_slots_are_met_while_no_host_reads(chip):
    radio = chip(ROBOT).boot(400)
    radio.tell("closed")
    for first in range(1, 100, 10):
        for frame in frames_of(4, 10, first):
            radio.hear(mac_of(4), frame)
        send_state(radio, 99.7)
    times_us = [codec.decode_header(frame).fleet_time_us for _, frame in radio.sent()]
    assert len(times_us) >= 10
    assert all(time_us % ROUND_US % SLOT_US < 700 for time_us in times_us)


def test_the_hello_names_the_commit(chip, request):
    radio = chip(ROBOT).boot()
    radio.host(hello())
    radio.run_ms(20)
    (reply,) = radio.messages(link.HelloReply)
    assert reply.git_hash == ("0a1b2c3d" if "clang" in request.node.name else "unknown")
    assert reply.mac == mac_of(3)


# ---- memory --------------------------------------------------------------------------------------


def test_nothing_is_taken_from_the_heap_after_the_start(chip):
    radio = chip(keyed_flash()).boot(5)
    radio.tell("heap")
    radio.tell("press")
    for i in range(12):
        radio.hear(mac_of(4), sealed(frame_of(4, i + 1, a_state(), boot=UNIX_S, time_us=radio.now_us)))
        radio.host(hello(slots=4 + i % 2))
        send_state(radio, 100)
    radio.run_ms(6000)
    radio.tell("heap")
    before, after = radio.said("taken")
    assert int(before[0]) > 4
    assert before == after
    assert {"identity", "stop", "peers"} <= radio.flash.keys()


# ---- the button ----------------------------------------------------------------------------------
def test_holding_the_button_for_a_second_sends_stop_once(chip):
    radio = chip(ROBOT).boot(500)
    radio.tell("press")
    radio.run_ms(900)
    assert radio.sent() == []
    radio.run_ms(3000)
    frames = [codec.decode_frame(frame) for _, frame in radio.sent()]
    status = status_of(radio)
    told = {(header.kind, body.counter, body.origin) for header, body in frames}
    assert told == {(air.STOP, status.stop_counter, 3)}
    assert status.flags & link.FLAG_STOPPED
    again = chip(radio.flash).boot()
    assert status_of(again).flags & link.FLAG_STOPPED


@pytest.mark.parametrize(
    ("presses", "stops"),
    [
        ([(0.98, 0.5)] * 3, False),
        ([(0.5, 0.005), (0.3, 0.01), (0.4, 1)], True),  # a contact that bounces
        ([(0.6, 0.03), (0.6, 1)], False),  # let go in between
    ],
)
def test_only_one_long_press_counts(chip, presses, stops):
    radio = chip(ROBOT).boot(500)
    for down_s, up_s in presses:
        radio.tell("press")
        radio.run_ms(1000 * down_s)
        radio.tell("release")
        radio.run_ms(1000 * up_s)
    assert bool(status_of(radio).flags & link.FLAG_STOPPED) == stops


def test_a_button_that_is_stuck_since_the_start_means_nothing(chip):
    radio = chip(ROBOT)
    radio.tell("press")
    assert not status_of(radio.boot(3000)).flags & link.FLAG_STOPPED


# ---- the LED -------------------------------------------------------------------------------------


def hear_the_fleet(radio: Chip) -> None:
    """Robot 4 is heard, and its time is ours."""
    plain = frame_of(4, radio.now_us // 1000, a_state(), boot=UNIX_S, time_us=radio.now_us - 400)
    radio.hear(mac_of(4), sealed(plain) if radio.flash["identity"].endswith(KEY) else plain)


def lights(radio: Chip, fleet: bool = False) -> str:
    """Two seconds of the LED, a letter each 100 ms: r, g, b, y, m, or . for off."""
    radio.run_ms(2000 - radio.now_us / 1000 % 2000)
    start_us = radio.now_us
    for _ in range(20):
        if fleet:
            hear_the_fleet(radio)
        radio.run_ms(100)
    changes = [
        (int(at), "".join(c for c, v in zip("rgb", rgb, strict=True) if v != "0"))
        for at, _, *rgb in radio.said("led")
    ]
    middles = range(start_us + 50_000, start_us + 2_000_000, 100_000)
    shown = [[light for at, light in changes if at < middle][-1] for middle in middles]
    return "".join({"": ".", "rg": "y", "rb": "m"}.get(light, light) for light in shown)


def stopped(radio: Chip) -> None:
    radio.host(link.Command(air.STOP, 0, 0))


def doubled(radio: Chip) -> None:
    radio.hear(mac_of(9), frame_of(3, 1, a_state()))


@pytest.mark.parametrize(
    ("flash", "broken", "event", "fleet", "seen"),
    [
        ({}, (), None, False, "b..................."),
        (ROBOT, (), None, False, "yyyyy.....yyyyy....."),
        (ROBOT, (), None, True, "...yyyyyyyyyyyyyyyyy"),
        (keyed_flash(), (), None, False, "ggggg.....ggggg....."),
        (keyed_flash(), (), None, True, "gggggggggggggggggggg"),
        (keyed_flash(), ("commit",), None, True, "r.r.r..............."),
        (ROBOT, (), doubled, False, "m.m................."),
        (ROBOT, (), stopped, True, "r.r.r.r.r.r.r.r.r.r."),
        (keyed_flash(), ("commit",), stopped, False, "r.r.r.r.r.r.r.r.r.r."),
    ],
)
def test_the_led_shows_the_state(chip, flash, broken, event, fleet, seen):
    radio = chip(flash, *broken).boot(400)
    if fleet:
        for _ in range(12):
            hear_the_fleet(radio)
            radio.run_ms(100)
    if event:
        event(radio)
    assert lights(radio, fleet) == seen
