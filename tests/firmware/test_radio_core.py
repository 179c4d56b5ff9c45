"""What a radio sends, passes on, drops and counts: the firmware's C, driven through its binding."""

from __future__ import annotations

import numpy as np
import pytest

from hippomat_core.errors import WireError
from hippomat_core.wire import cobs, codec, link
from hippomat_core.wire import frames as air
from hippomat_sim.radio import Identity, Radio

MAC = bytes([0x10, 0x20, 0x30, 0x40, 0x50, 0x60])


def a_radio(robot: int = 3, boot_counter: int = 7, **more: int) -> Radio:
    return Radio(MAC, 0xC0FFEE, boot_counter, robot, **more)


def state_body(x_cm: int) -> bytes:
    one = np.ones(1, np.uint8)
    claim = air.AirClaim(air.NO_SLOT, 0, 0, 0, False, 0, 0, 0, 0, 0)
    nothing = np.zeros(0, np.uint8)
    frame = air.StateFrame(0, 0, x_cm, 0, 0, 0, 0, claim, one, one, 0, 0, 0, nothing, 0, one, 1, 2, 3)
    return codec.encode_body(frame)


def stop_frame(sender: int, boot: int, sequence: int, fleet: int = 1) -> bytes:
    header = air.Header(air.STOP, fleet, sender, boot, sequence, 0)
    return codec.encode_frame(header, air.StopFrame(1, 255, 0))


def send(radio: Radio, kind: int, body: bytes) -> None:
    radio.usb_rx(0, link.encode_message(link.SendBody(kind, body)))


def messages(radio: Radio) -> list[link.LinkMessage]:
    decoder = cobs.FrameDecoder()
    found = [link.decode_message(payload) for payload in decoder.feed(radio.usb_tx())]
    assert decoder.skipped_bytes == 0
    return found


def test_a_newer_state_replaces_an_unsent_one():
    radio = a_radio()
    for x_cm in (1, 2, 3):
        send(radio, air.STATE, state_body(x_cm))
    header, frame = codec.decode_frame(radio.air_tx(1_000))
    assert frame.x_cm == 3
    assert (header.sender, header.fleet, header.boot, header.sequence) == (3, 1, 7, 1)
    assert header.fleet_time_us == 1_000
    assert radio.counters.replaced == 2
    radio.air_done(1_500, True)
    assert radio.air_tx(2_000) is None


def test_one_frame_is_in_flight_at_a_time():
    radio = a_radio()
    send(radio, air.STATE, state_body(1))
    send(radio, air.TASKS, codec.encode_body(air.TasksFrame((air.TaskSlot(0, 1, 1, 2, 3, 4),))))
    assert radio.air_tx(0) is not None
    assert radio.air_tx(400) is None
    radio.air_done(500, True)
    assert codec.decode_frame(radio.air_tx(600))[0].sequence == 2
    assert messages(radio) == [link.Sent(500, air.STATE, 1, True)]


def test_a_frame_whose_callback_stays_away_is_given_up_after_50_ms():
    radio = a_radio()
    send(radio, air.STATE, state_body(1))
    send(radio, air.STOP, codec.encode_body(air.StopFrame(1, 255, 0)))
    assert codec.decode_frame(radio.air_tx(1_000))[0].kind == air.STOP
    radio.tick(50_999)
    assert radio.air_tx(50_999) is None
    radio.tick(51_000)
    assert radio.counters.send_failed == 1
    assert link.Sent(51_000, air.STOP, 1, False) in messages(radio)
    assert codec.decode_frame(radio.air_tx(51_001))[0].kind == air.STATE


def test_a_callback_with_nothing_in_flight_is_ignored():
    radio = a_radio()
    radio.air_done(5, True)
    assert radio.counters.sent == 0
    assert messages(radio) == []


def test_stop_overtakes_everything_and_finds_room_in_a_full_queue():
    radio = a_radio()
    tasks = [codec.encode_body(air.TasksFrame((air.TaskSlot(0, k, 1, 2, 3, 4),))) for k in range(9)]
    for body in tasks:
        send(radio, air.TASKS, body)
    assert radio.counters.send_failed == 1
    send(radio, air.STATE, state_body(1))
    send(radio, air.STOP, codec.encode_body(air.StopFrame(1, 255, 0)))
    send(radio, air.RESUME, codec.encode_body(air.StopFrame(2, 255, 0)))
    assert radio.counters.send_failed == 3
    kinds, bodies = [], []
    while (data := radio.air_tx(0)) is not None:
        kinds.append(codec.decode_frame(data)[0].kind)
        bodies.append(data[16:])
        radio.air_done(0, True)
    assert kinds == [air.STOP, air.RESUME, air.STATE] + [air.TASKS] * 6
    assert bodies[3:] == tasks[:6]


def test_a_frame_heard_reaches_the_host_whole_with_time_and_rssi():
    radio = a_radio()
    frame = stop_frame(5, 1, 9)
    radio.air_rx(123_456, -71, frame)
    assert messages(radio) == [link.Heard(123_456, -71, frame)]
    assert radio.counters.received == 1


def test_a_frame_not_newer_than_the_last_of_its_sender_and_boot_is_dropped():
    radio = a_radio()
    for sequence in (9, 9, 8, 10, 10):
        radio.air_rx(0, -50, stop_frame(5, 1, sequence))
    radio.air_rx(0, -50, stop_frame(6, 1, 9))
    assert radio.counters.received == 3
    assert radio.counters.dropped_duplicate == 3


def test_after_a_reboot_of_the_sender_its_low_sequence_numbers_are_new():
    radio = a_radio()
    radio.air_rx(0, -50, stop_frame(5, 1, 5000))
    radio.air_rx(1, -50, stop_frame(5, 2, 1))
    assert radio.counters.received == 2


def test_a_late_copy_from_before_a_reboot_is_still_a_duplicate():
    radio = a_radio()
    for boot, sequence in ((1, 5000), (2, 1), (1, 5000), (2, 1), (2, 2)):
        radio.air_rx(0, -50, stop_frame(5, boot, sequence))
    assert radio.counters.received == 3
    assert radio.counters.dropped_duplicate == 2


def test_sequence_numbers_wrap_around():
    radio = a_radio()
    for sequence in (2**24 - 1, 0, 2**24 - 1):
        radio.air_rx(0, -50, stop_frame(5, 1, sequence))
    assert (radio.counters.received, radio.counters.dropped_duplicate) == (2, 1)


def test_foreign_and_malformed_frames_are_dropped_and_counted_apart():
    radio = a_radio()
    good = stop_frame(5, 1, 1)
    radio.air_rx(0, -50, stop_frame(5, 1, 1, fleet=2))
    radio.air_rx(0, -50, bytes([0x24]) + good[1:])
    radio.air_rx(0, -50, good[:-1])
    radio.air_rx(0, -50, good + b"\0")
    radio.air_rx(0, -50, b"")
    radio.air_rx(0, -50, good)
    counters = radio.counters
    assert (counters.dropped_foreign, counters.dropped_malformed, counters.received) == (2, 3, 1)


def test_a_frame_under_our_own_id_is_passed_on_for_the_host_to_judge():
    radio = a_radio(robot=3)
    radio.air_rx(0, -50, stop_frame(3, 99, 1))
    assert len(messages(radio)) == 1


def test_the_status_comes_once_per_second_with_the_boot_id():
    radio = a_radio()
    for now_us in range(0, 3_000_001, 10_000):
        radio.tick(now_us)
    found = messages(radio)
    assert [status.uptime_us for status in found] == [0, 1_000_000, 2_000_000, 3_000_000]
    assert {(status.boot_id, status.boot_counter, status.robot) for status in found} == {(0xC0FFEE, 7, 3)}
    assert found[0].flags == 1


def test_a_radio_without_an_id_adopts_the_one_in_the_hello():
    radio = a_radio(robot=255)
    radio.usb_rx(0, link.encode_message(link.Hello(link.LINK_VERSION, 4, 9, 11)))
    (reply,) = messages(radio)
    assert (reply.robot, reply.fleet, reply.channel) == (4, 9, 11)
    assert (reply.mac, reply.boot_id, reply.protocol_version) == (MAC, 0xC0FFEE, air.PROTOCOL_VERSION)
    assert radio.identity == Identity(4, 9, 11)


def test_a_radio_with_an_id_answers_with_its_own():
    radio = a_radio(robot=3, channel=6)
    radio.usb_rx(0, link.encode_message(link.Hello(link.LINK_VERSION, 4, 9, 11)))
    (reply,) = messages(radio)
    assert (reply.robot, reply.fleet, reply.channel) == (3, 1, 6)


def test_a_hello_of_another_link_version_is_answered_and_changes_nothing():
    radio = a_radio(robot=255)
    radio.usb_rx(0, link.encode_message(link.Hello(link.LINK_VERSION + 1, 4, 9, 11)))
    (reply,) = messages(radio)
    assert (reply.link_version, reply.robot, reply.fleet) == (link.LINK_VERSION, 255, 1)


def test_a_listener_hears_the_fleet_it_was_asked_for_and_never_transmits():
    radio = a_radio(robot=255)
    radio.usb_rx(0, link.encode_message(link.Hello(link.LINK_VERSION, 255, 9, 11)))
    send(radio, air.STATE, state_body(1))
    assert radio.air_tx(0) is None
    radio.air_rx(1, -50, stop_frame(5, 1, 1, fleet=9))
    assert [type(message) for message in messages(radio)] == [link.HelloReply, link.Heard]
    assert radio.counters.send_failed == 1
    assert radio.identity == Identity(255, 9, 11)


def test_messages_that_find_the_usb_ring_full_are_dropped_whole_and_counted():
    radio = a_radio()
    for sequence in range(1, 1001):
        radio.air_rx(sequence, -50, stop_frame(5, 1, sequence))
    found = messages(radio)
    assert 300 < len(found) < 1000
    assert radio.counters.dropped_usb == 1000 - len(found)
    assert [message.radio_time_us for message in found] == list(range(1, len(found) + 1))
    radio.air_rx(2000, -50, stop_frame(5, 1, 2000))
    assert [message.radio_time_us for message in messages(radio)] == [2000]


def test_noise_and_malformed_messages_from_the_host_are_counted_and_survived():
    radio = a_radio()
    radio.usb_rx(0, b"AT\r\n\0")
    radio.usb_rx(0, cobs.encode(b"\x77"))
    radio.usb_rx(0, cobs.encode(b"\x02\x04\x01\x02\x03"))  # a STOP of three bytes
    broken = bytearray(cobs.encode(b"\x01\x01\x04\x09\x0b"))
    broken[2] ^= 2
    radio.usb_rx(0, bytes(broken))
    send(radio, air.STATE, state_body(1))
    counters = radio.counters
    assert (counters.usb_skipped_bytes, counters.usb_bad_checksums) == (5 + len(broken), 1)
    assert counters.dropped_usb == 2
    assert radio.air_tx(0) is not None


def test_messages_may_arrive_in_any_pieces():
    radio = a_radio()
    for byte in link.encode_message(link.SendBody(air.STATE, state_body(8))):
        radio.usb_rx(0, bytes([byte]))
    assert codec.decode_frame(radio.air_tx(0))[1].x_cm == 8


def test_the_binding_names_a_value_that_does_not_fit():
    with pytest.raises(WireError, match="robot = 64 is neither"):
        a_radio(robot=64)
    with pytest.raises(WireError, match=r"HelloReply.mac length = 5 is outside 6 .. 6"):
        Radio(b"12345", 1, 1)
