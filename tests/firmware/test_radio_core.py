"""What a radio sends, passes on, drops and counts: the firmware's C, driven through its binding."""

from __future__ import annotations

import pytest
from radio_desk import (
    LISTENED_US,
    MAC,
    a_radio,
    a_state,
    frame_of,
    hear,
    mac_of,
    messages,
    send,
    sent_until,
    stop_frame,
)

from hippomat_core.errors import WireError
from hippomat_core.wire import cobs, codec, link
from hippomat_core.wire import frames as air
from hippomat_sim.radio import Memory, Radio

SLOT_US = 2080  # of five robots at 100 ms
A_TASK = air.TasksFrame((air.TaskSlot(0, 4, 1, 2, 3, 4),))


def test_a_radio_listens_for_three_rounds_and_then_sends_its_state_in_its_slot():
    radio = a_radio(robot=3)
    for now_us in (0, 100_000, 200_000):
        send(radio, a_state(1), now_us)
        assert sent_until(radio, now_us, now_us + 99_000) == []
    send(radio, a_state(7), 299_000)
    (sent,) = sent_until(radio, 299_000, 500_000)
    assert LISTENED_US <= sent.at_us <= LISTENED_US + 100_000 + 3 * SLOT_US
    assert 3 * SLOT_US <= sent.at_us % 100_000 <= 3 * SLOT_US + 500
    assert (sent.header.sender, sent.header.fleet, sent.header.boot, sent.header.sequence) == (3, 1, 7, 1)
    assert sent.header.fleet_time_us == sent.at_us
    assert sent.body.x_cm == 7


def test_a_newer_state_replaces_an_unsent_one():
    radio = a_radio()
    for x_cm in (1, 2, 3):
        send(radio, a_state(x_cm))
    assert [sent.body.x_cm for sent in sent_until(radio, LISTENED_US, 500_000)] == [3]
    assert radio.counters.replaced == 2


def test_one_frame_is_in_flight_at_a_time():
    radio = a_radio()
    send(radio, a_state(1))
    send(radio, A_TASK)
    assert len(sent_until(radio, LISTENED_US, 340_000, done=False)) == 1
    radio.air_done(340_001, True)
    assert radio.counters.sent == 1


def test_a_frame_whose_callback_stays_away_is_given_up_after_50_ms():
    radio = a_radio(robot=0)
    send(radio, a_state(1))
    (first,) = sent_until(radio, LISTENED_US, 310_000, done=False)
    send(radio, A_TASK)
    sent_until(radio, 310_001, first.at_us + 49_999, done=False)
    assert radio.counters.send_failed == 0
    (second,) = sent_until(radio, first.at_us + 50_000, 700_000)
    assert radio.counters.send_failed == 1
    assert link.Sent(first.at_us + 50_000, air.STATE, 1, False) in messages(radio)
    assert second.header.kind == air.TASKS


def test_a_callback_with_nothing_in_flight_is_ignored():
    radio = a_radio()
    radio.air_done(5, True)
    assert radio.counters.sent == 0
    assert messages(radio) == []


def test_a_state_too_late_for_its_slot_goes_out_in_the_next_own_one():
    radio = a_radio(robot=0)
    sent_until(radio, LISTENED_US, 401_000)
    send(radio, a_state(1), 401_001)
    (sent,) = sent_until(radio, 401_001, 499_000)
    assert sent.body.x_cm == 1
    assert 400_000 + 5 * SLOT_US <= sent.at_us <= 400_000 + 5 * SLOT_US + 500


def test_a_state_that_waited_for_more_than_a_round_is_not_sent():
    radio = a_radio()
    send(radio, a_state(1), 0)
    assert sent_until(radio, 0, 900_000) == []
    assert radio.counters.send_failed == 1
    send(radio, a_state(2), 900_001)
    assert [sent.body.x_cm for sent in sent_until(radio, 900_001, 1_100_000)] == [2]


def test_tasks_go_out_in_relay_slots_and_what_finds_the_queue_full_is_counted():
    radio = a_radio()
    for _ in range(9):
        send(radio, A_TASK)
    assert radio.counters.send_failed == 1
    sent = sent_until(radio, LISTENED_US, 800_000)
    assert [one.header.kind for one in sent] == [air.TASKS] * 8
    assert {(one.at_us % 100_000 - 3 * SLOT_US) // (5 * SLOT_US) for one in sent} == {1, 2}


def test_the_radio_writes_into_a_state_whom_it_heard():
    radio = a_radio(robot=3)
    sent_until(radio, LISTENED_US, 400_000)
    for sender in (0, 1):
        hear(
            radio,
            401_000 + sender * 1000,
            frame_of(sender, 1, a_state(sender), time_us=401_000 + sender * 1000),
        )
    send(radio, a_state(9), 404_000)
    (sent,) = sent_until(radio, 404_000, 409_000)
    assert sent.body.heard == 0b11


def test_the_host_is_told_when_a_round_was_observed():
    radio = a_radio(robot=3)
    sent_until(radio, 0, 500_000)
    rounds = messages(radio, link.Round)
    assert [told.round for told in rounds] == [0, 1, 2, 3, 4]
    assert [told.fleet_time_us % 100_000 for told in rounds] == [15 * SLOT_US] * 5
    assert not any(told.agreed for told in rounds)


def test_a_frame_heard_reaches_the_host_whole_with_both_clocks_and_rssi():
    radio = a_radio()
    frame = frame_of(4, 9, a_state(5), time_us=123_000)
    radio.air_rx(123_456, -71, mac_of(4), frame)
    (heard,) = messages(radio, link.Heard)
    assert (heard.radio_time_us, heard.rssi_dbm, heard.frame) == (123_456, -71, frame)
    assert heard.fleet_time_us == 123_456
    assert radio.counters.received == 1


def test_a_frame_of_a_boot_is_taken_once_in_whatever_order_it_comes():
    radio = a_radio()
    for sequence in (9, 9, 8, 10, 8, 10, 80, 10, 16):
        hear(radio, 0, stop_frame(5, 1, sequence))
    hear(radio, 0, stop_frame(6, 1, 9))
    assert radio.counters.received == 5
    assert radio.counters.dropped_replayed == 5


def test_after_a_reboot_of_the_sender_its_low_sequence_numbers_are_new_and_its_old_frames_are_not():
    radio = a_radio()
    for boot, sequence in ((1, 5000), (2, 1), (1, 5001), (1, 5000), (2, 1), (2, 2)):
        hear(radio, 0, stop_frame(5, boot, sequence))
    assert radio.counters.received == 3
    assert radio.counters.dropped_replayed == 3
    assert radio.condition(0).rebooted == 1 << 5


def test_in_an_open_fleet_a_radio_that_lost_its_boot_counter_is_heard_again_after_three_seconds():
    radio = a_radio()
    hear(radio, 0, stop_frame(5, 900, 1))
    hear(radio, 2_900_000, stop_frame(5, 2, 1))
    hear(radio, 3_000_001, stop_frame(5, 2, 2))
    assert (radio.counters.received, radio.counters.dropped_replayed) == (2, 1)


def test_a_sequence_number_is_used_once_and_the_next_boot_counter_is_stored_before_the_first_follows():
    radio = a_radio(sequence=2**24 - 2)
    sent = []
    for second in range(1, 5):
        send(radio, a_state(second), second * 1_000_000)
        sent.append(sent_until(radio, second * 1_000_000, second * 1_000_000 + 990_000))
        if second == 2:
            assert radio.dirty == 2
            assert radio.memory.boot_counter == 8
            radio.kept(2, True)
    numbers = [[(one.header.boot, one.header.sequence) for one in of_second] for of_second in sent]
    assert numbers == [[(7, 2**24 - 1)], [], [(8, 1)], [(8, 2)]]


def test_foreign_and_malformed_frames_are_dropped_and_counted_apart():
    radio = a_radio()
    good = stop_frame(5, 1, 1)
    sealed = bytes([good[0] | 8]) + good[1:]
    bad = (stop_frame(5, 1, 1, fleet=2), bytes([0x34]) + good[1:], good[:-1], good + b"\0", b"", sealed)
    for frame in bad:
        radio.air_rx(0, -50, mac_of(5), frame)
    hear(radio, 0, good)
    counters = radio.counters
    assert (counters.dropped_foreign, counters.dropped_malformed) == (2, 3)
    assert (counters.dropped_seal, counters.received) == (1, 1)


def test_another_radio_under_our_own_id_makes_us_passive_and_the_status_says_so_at_once():
    radio = a_radio(robot=3)
    send(radio, a_state(1))
    hear(radio, 10, frame_of(3, 1, a_state(2)))
    (status,) = messages(radio, link.Status)
    assert status.flags & link.FLAG_PASSIVE
    assert status.duplicate == 1 << 3
    assert sent_until(radio, 20, 900_000) == []
    assert messages(radio, link.Heard) == []
    assert radio.counters.dropped_impostor == 1


def test_our_own_frame_come_back_is_no_duplicate_id():
    radio = a_radio(robot=3)
    radio.air_rx(0, -50, MAC, frame_of(3, 1, a_state(2)))
    assert not radio.condition(0).flags & link.FLAG_PASSIVE


def test_of_two_radios_under_one_id_the_first_is_heard_and_both_are_named():
    radio = a_radio()
    for sequence in range(1, 4):
        hear(radio, sequence, frame_of(1, sequence, a_state(1)))
        hear(radio, sequence, frame_of(1, 90 + sequence, a_state(2), boot=9), mac=mac_of(77))
    heard = [codec.decode_frame(message.frame)[1].x_cm for message in messages(radio, link.Heard)]
    assert heard == [1, 1, 1]
    assert radio.counters.dropped_impostor == 3
    assert radio.condition(5).duplicate == 1 << 1


def test_a_babbling_sender_is_cut_off_and_named_and_the_others_are_heard():
    radio = a_radio()
    for sequence in range(1, 1001):
        hear(radio, sequence * 500, frame_of(1, sequence, a_state(1)))
    hear(radio, 500_001, frame_of(2, 1, a_state(2)))
    counters = radio.counters
    assert counters.dropped_babble == 1000 - 240
    assert counters.received == 241
    assert radio.condition(500_002).babbling == 1 << 1
    hear(radio, 1_600_000, frame_of(1, 1001, a_state(1)))
    hear(radio, 2_700_000, frame_of(1, 1002, a_state(1)))
    assert radio.condition(2_700_001).babbling == 0


def test_the_status_comes_once_per_second_with_boot_firmware_and_who_is_alive():
    radio = a_radio()
    hear(radio, 0, frame_of(1, 1, a_state(1)))
    sent_until(radio, 0, 4_000_000)
    found = messages(radio, link.Status)
    assert [status.uptime_us for status in found] == [0, 1_000_000, 2_000_000, 3_000_000, 4_000_000]
    assert {(status.boot_id, status.boot_counter, status.robot) for status in found} == {(0xC0FFEE, 7, 3)}
    assert {status.firmware for status in found} == {"hippomat sim"}
    assert [status.alive for status in found] == [2, 2, 2, 2, 0]
    assert found[0].flags & link.FLAG_OPEN


def hello(robot: int = 4, fleet: int = 9, channel: int = 11, version: int = link.LINK_VERSION) -> bytes:
    return link.encode_message(link.Hello(version, robot, fleet, channel, 200, 20))


def test_a_radio_without_an_id_adopts_the_one_in_the_hello_and_has_it_stored():
    radio = a_radio(robot=255)
    radio.usb_rx(0, hello())
    (reply,) = messages(radio)
    assert (reply.robot, reply.fleet, reply.channel) == (4, 9, 11)
    assert (reply.mac, reply.boot_id, reply.protocol_version) == (MAC, 0xC0FFEE, air.PROTOCOL_VERSION)
    assert (reply.round_ms, reply.slots) == (200, 20)
    assert radio.dirty == 1
    assert (radio.memory.robot, radio.memory.fleet, radio.memory.channel) == (4, 9, 11)


def test_a_radio_with_an_id_answers_with_its_own_and_takes_the_rounds_of_its_host():
    radio = a_radio(robot=3, channel=6)
    radio.usb_rx(0, hello())
    (reply,) = messages(radio)
    assert (reply.robot, reply.fleet, reply.channel) == (3, 1, 6)
    assert (reply.round_ms, reply.slots) == (200, 20)


@pytest.mark.parametrize("memory", [{"provisioned": True}, {"key": bytes(range(16))}])
def test_what_was_provisioned_no_hello_changes(memory):
    radio = a_radio(robot=255, fleet=5, **memory)
    radio.usb_rx(0, hello())
    (reply,) = messages(radio)
    assert (reply.robot, reply.fleet) == (255, 5)


def test_a_hello_of_another_link_version_is_answered_and_changes_nothing():
    radio = a_radio(robot=255)
    radio.usb_rx(0, cobs.encode(bytes([1, link.LINK_VERSION + 1, 4, 9, 11])))
    (reply,) = messages(radio)
    assert (reply.link_version, reply.robot, reply.fleet) == (link.LINK_VERSION, 255, 1)


def test_a_listener_hears_the_fleet_it_was_asked_for_and_sends_no_state():
    radio = a_radio(robot=255)
    radio.usb_rx(0, hello(robot=255))
    send(radio, a_state(1))
    assert sent_until(radio, LISTENED_US, 900_000) == []
    hear(radio, 900_001, stop_frame(5, 1, 1, fleet=9))
    assert messages(radio, link.Heard)
    assert radio.counters.send_failed == 1


def provision(key: bytes = bytes(range(1, 17)), **more: int) -> link.Provision:
    given = {"robot": 4, "fleet": 9, "channel": 11, "rate_mbps": 12, "unix_s": 1_790_000_000} | more
    return link.Provision(
        link.LINK_VERSION,
        given["robot"],
        given["fleet"],
        given["channel"],
        given["rate_mbps"],
        key,
        given["unix_s"],
    )


def test_a_provisioning_is_stored_answered_and_then_the_radio_restarts():
    radio = a_radio(robot=3, peer_boots=tuple(range(64)))
    radio.usb_rx(0, link.encode_message(provision()))
    send(radio, a_state(1))
    assert sent_until(radio, LISTENED_US, 900_000) == []
    assert (radio.dirty, radio.wants_restart) == (15, False)
    assert messages(radio, link.Provisioned) == []
    radio.kept(15, True)
    assert not radio.wants_restart
    assert messages(radio) == [link.Provisioned(True, 1_790_000_000)]
    assert radio.wants_restart
    memory = radio.memory
    assert (memory.robot, memory.fleet, memory.channel, memory.rate_mbps) == (4, 9, 11, 12)
    assert (memory.key, memory.provisioned) == (bytes(range(1, 17)), True)
    assert memory.peer_boots == (0,) * 64


def test_a_provisioning_that_cannot_be_stored_is_answered_so():
    radio = a_radio(robot=3)
    radio.usb_rx(0, link.encode_message(provision()))
    radio.kept(15, False)
    assert link.Provisioned(False, 1_790_000_000) in messages(radio)


def test_the_boot_counter_never_goes_back_when_provisioned_again():
    radio = a_radio(robot=3, boot_counter=1_800_000_000)
    radio.usb_rx(0, link.encode_message(provision()))
    assert radio.memory.boot_counter == 1_800_000_000


def test_the_peers_are_reported_when_asked_for_and_a_status_closes_the_list():
    radio = a_radio()
    hear(radio, 1000, frame_of(1, 7, a_state(1), boot=12))
    hear(radio, 2000, stop_frame(255, 3, 1), mac=mac_of(99))
    messages(radio)
    radio.usb_rx(5000, link.encode_message(link.AskPeers()))
    robot, operator, status = messages(radio)
    assert (robot.robot, robot.mac, robot.boot, robot.sequence) == (1, mac_of(1), 12, 7)
    assert (robot.age_ms, robot.received, robot.rssi_dbm, robot.flags) == (4, 1, -50, 1)
    assert (operator.robot, operator.mac, operator.boot) == (255, mac_of(99), 3)
    assert isinstance(status, link.Status)


def test_messages_that_find_the_usb_ring_full_are_dropped_whole_and_counted():
    radio = a_radio()
    for at in range(1, 801):
        hear(radio, at * 10_000, frame_of(1, at, a_state(1)))
    found = messages(radio, link.Heard)
    assert 100 < len(found) < 800
    assert radio.counters.dropped_usb >= 800 - len(found)  # and some rounds
    hear(radio, 9_000_000, frame_of(1, 2000, a_state(1)))
    assert [message.radio_time_us for message in messages(radio, link.Heard)] == [9_000_000]


def test_noise_and_malformed_messages_from_the_host_are_counted_and_survived():
    radio = a_radio()
    radio.usb_rx(0, b"AT\r\n\0")
    radio.usb_rx(0, cobs.encode(b"\x77"))
    radio.usb_rx(0, cobs.encode(b"\x02\x04\x01\x02\x03\x04"))  # the radio makes STOP itself
    broken = bytearray(hello())
    broken[3] ^= 2
    radio.usb_rx(0, bytes(broken))
    send(radio, a_state(1))
    counters = radio.counters
    assert (counters.usb_skipped_bytes, counters.usb_bad_checksums) == (5 + len(broken), 1)
    assert counters.dropped_usb == 2
    assert len(sent_until(radio, LISTENED_US, 500_000)) == 1


def test_messages_may_arrive_in_any_pieces():
    radio = a_radio()
    for byte in link.encode_message(link.SendBody(air.STATE, codec.encode_body(a_state(8)))):
        radio.usb_rx(LISTENED_US, bytes([byte]))
    assert sent_until(radio, LISTENED_US, 500_000)[0].body.x_cm == 8


def test_the_binding_names_a_value_that_does_not_fit():
    with pytest.raises(WireError, match="robot = 64 is neither"):
        a_radio(robot=64)
    with pytest.raises(WireError, match=r"HelloReply.mac length = 5 is outside 6 .. 6"):
        Radio(b"12345", 1, Memory())


def test_the_key_is_in_no_text():
    key = bytes(range(1, 17))
    assert key.hex() not in repr(Memory(key=key))
    assert repr(key) not in repr(Memory(key=key))
