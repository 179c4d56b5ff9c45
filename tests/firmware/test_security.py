"""What a fleet key promises: who is believed, what a restart remembers, and that the key stays inside."""

from __future__ import annotations

import pytest
from radio_desk import MAC, a_radio, a_state, hear, mac_of, messages, send
from sealed_desk import CIPHER, FLEET, KEY, sealed_frame

from hippomat_core.wire import codec, link
from hippomat_core.wire import frames as air
from hippomat_sim.radio import Memory, Radio
from hippomat_sim.radio.cipher import CipherPort

A_TASK = air.TasksFrame((air.TaskSlot(0, 4, 1, 2, 3, 4),))
PIECE = 4  # bytes of the key that nothing may show in a row


def a_keyed(robot: int = 3, **more: object) -> Radio:
    return a_radio(robot=robot, fleet=FLEET, key=KEY, **more)


def restarted(radio: Radio) -> Radio:
    """The same radio after power off and on."""
    return Radio(MAC, 0xBEEF, radio.memory.counted())


def drops(radio: Radio) -> dict[str, int]:
    counters = radio.counters
    names = ("foreign", "malformed", "seal", "forged", "replayed", "impostor", "babble")
    found = {name: getattr(counters, f"dropped_{name}") for name in names}
    return {name: count for name, count in found.items() if count}


def air_frames(radio: Radio, from_us: int, until_us: int) -> list[bytes]:
    found, now_us = [], from_us
    while now_us <= until_us:
        radio.tick(now_us)
        if (frame := radio.air_tx(now_us)) is not None:
            found.append(frame)
            radio.air_done(now_us, True)
        now_us = max(radio.next_us(now_us), now_us + 1)
    return found


def test_a_sealed_frame_reaches_the_host_opened_and_says_that_it_was_authentic():
    radio = a_keyed()
    hear(radio, 10, sealed_frame(5, 1, 1, a_state(8)))
    (heard,) = messages(radio, link.Heard)
    header, body = codec.decode_frame(heard.frame)
    assert (header.sealed, header.sender, body.x_cm) == (True, 5, 8)


def test_two_radios_with_one_key_understand_each_other_and_a_third_with_another_does_not():
    sender, receiver = a_keyed(robot=1), Radio(mac_of(2), 5, Memory(robot=2, fleet=FLEET, key=KEY))
    stranger = Radio(mac_of(3), 5, Memory(robot=3, fleet=FLEET, key=bytes(range(16))))
    send(sender, a_state(8))
    (frame,) = air_frames(sender, 0, 500_000)
    for radio in (receiver, stranger):
        radio.air_rx(500_000, -50, MAC, frame)
    assert [codec.decode_frame(one.frame)[1].x_cm for one in messages(receiver, link.Heard)] == [8]
    assert messages(stranger, link.Heard) == []
    assert drops(stranger) == {"forged": 1}


def test_every_frame_of_a_radio_with_a_key_is_sealed_whatever_it_carries():
    radio = a_keyed(robot=0)
    send(radio, A_TASK)
    send(radio, a_state(1))
    frames = air_frames(radio, 0, 404_000)
    for robot in (1, 2):
        hear(radio, 405_000, sealed_frame(robot, 1, 1, a_state(2), time_us=405_000))
    frames += air_frames(radio, 405_001, 449_000)
    radio.press_button(450_000)
    frames += air_frames(radio, 450_000, 900_000)
    kinds = {codec.decode_header(frame).kind for frame in frames}
    assert kinds == {air.STATE, air.RELAY, air.TASKS, air.STOP}
    assert all(codec.decode_header(frame).sealed for frame in frames)
    assert not any(codec.encode_body(A_TASK) in frame for frame in frames)


def test_the_largest_state_goes_out_sealed_in_250_bytes():
    largest = a_state(1, n=64, m=80)
    body = codec.encode_body(largest)
    sealed = sealed_frame(1, 1, 1, largest)
    assert len(sealed) == 16 + len(body) + 8 <= air.MAX_FRAME
    radio = a_keyed(robot=1, slots=64, round_ms=300)
    send(radio, largest, 900_000)
    (frame,) = air_frames(radio, 900_000, 2_000_000)
    assert len(frame) == len(sealed)


GOOD = sealed_frame(5, 1, 1, a_state())
BAD = {
    "of another fleet": (sealed_frame(5, 1, 1, a_state(), fleet=8), "foreign"),
    "of another version": (b"\x39" + GOOD[1:], "foreign"),
    "shorter than a header": (GOOD[:15], "malformed"),
    "empty": (b"", "malformed"),
    "longer than a frame": (GOOD.ljust(251, b"\0"), "malformed"),
    "not sealed": (b"\x21" + GOOD[1:-8], "seal"),
    "cut": (GOOD[:-1], "forged"),
    "shorter than its tag": (GOOD[:20], "forged"),
    "with a byte more": (GOOD + b"\0", "forged"),
    "of another key": (sealed_frame(5, 1, 1, a_state(), key=bytes(16)), "forged"),
    "of another MAC": (sealed_frame(5, 1, 1, a_state(), mac=mac_of(6)), "forged"),
}


@pytest.mark.parametrize(("frame", "cause"), BAD.values(), ids=BAD)
def test_a_bad_frame_is_counted_under_its_cause_and_not_shown(frame, cause):
    radio = a_keyed()
    radio.air_rx(0, -50, mac_of(5), frame)
    assert drops(radio) == {cause: 1}
    assert messages(radio, link.Heard) == []


def test_a_sealed_frame_means_nothing_to_an_open_fleet():
    radio = a_radio(robot=3, fleet=FLEET)
    hear(radio, 0, sealed_frame(5, 1, 1, a_state()))
    assert drops(radio) == {"seal": 1}


def test_a_frame_with_a_right_tag_and_a_body_that_cannot_be_is_malformed():
    radio = a_keyed()
    head = codec.encode_header(air.Header(air.RELAY, True, FLEET, 5, 1, 1, 0))
    nonce = mac_of(5) + bytes([1, 0, 0, 0]) + bytes([1, 0, 0])
    radio.air_rx(0, -50, mac_of(5), head + CIPHER.seal(KEY, nonce, head, b"\xff" * 30))
    assert drops(radio) == {"malformed": 1}


def test_an_unsealed_stop_does_not_stop_a_fleet_with_a_key_and_a_sealed_one_does():
    radio = a_keyed()
    plain = air.Header(air.STOP, False, FLEET, air.OPERATOR, 1, 1, 0)
    radio.air_rx(0, -50, mac_of(99), codec.encode_frame(plain, air.StopFrame(1, 255, 0)))
    assert not radio.condition(0).flags & link.FLAG_STOPPED
    stop = sealed_frame(air.OPERATOR, 1, 1, air.StopFrame(1, 255, 0), mac=mac_of(99), kind=air.STOP)
    radio.air_rx(1, -50, mac_of(99), stop)
    assert radio.condition(1).flags & link.FLAG_STOPPED


def test_a_forged_frame_under_our_own_id_does_not_silence_us_and_a_genuine_one_does():
    radio = a_keyed(robot=3)
    forged = sealed_frame(3, 1, 1, a_state(), mac=mac_of(50), key=bytes(16))
    radio.air_rx(0, -50, mac_of(50), forged)
    assert not radio.condition(0).flags & link.FLAG_PASSIVE
    radio.air_rx(1, -50, mac_of(50), sealed_frame(3, 1, 1, a_state(), mac=mac_of(50)))
    assert radio.condition(1).flags & link.FLAG_PASSIVE


def test_a_forged_frame_from_the_future_moves_no_clock():
    radio = a_keyed()
    hear(radio, 1000, sealed_frame(5, 1, 1, a_state(), key=bytes(16), time_us=10**12))
    assert radio.condition(1000).fleet_time_us == 1000


def test_a_receiver_that_restarts_refuses_the_older_boots_it_has_kept():
    radio = a_keyed()
    hear(radio, 0, sealed_frame(5, 41, 1, a_state()))
    hear(radio, 1, sealed_frame(5, 42, 7, a_state()))
    assert radio.dirty == 4
    radio.kept(4, True)
    radio = restarted(radio)
    for sequence in range(1, 200):
        hear(radio, sequence, sealed_frame(5, 41, sequence, a_state()))
    assert drops(radio) == {"replayed": 199}
    hear(radio, 900, sealed_frame(5, 43, 1, a_state()))
    assert radio.counters.received == 1
    hear(radio, 901, sealed_frame(5, 42, 9, a_state()))
    assert drops(radio) == {"replayed": 200}


def test_an_older_boot_stays_refused_however_long_its_sender_is_silent():
    radio = a_keyed()
    hear(radio, 0, sealed_frame(5, 42, 7, a_state()))
    hear(radio, 3_600_000_000, sealed_frame(5, 41, 8, a_state()))
    assert drops(radio) == {"replayed": 1}


def test_operators_are_told_apart_by_mac_and_their_older_boots_are_kept_too():
    radio = a_keyed()

    def tasks(operator: int, boot: int, sequence: int) -> None:
        mac = mac_of(operator)
        radio.air_rx(0, -50, mac, sealed_frame(air.OPERATOR, boot, sequence, A_TASK, mac=mac))

    tasks(90, 5, 1)
    tasks(91, 3, 1)
    assert radio.counters.received == 2
    radio = restarted(radio)
    tasks(92, 1, 1)
    tasks(90, 4, 2)
    tasks(91, 2, 2)
    assert (radio.counters.received, drops(radio)) == (1, {"replayed": 2})


def test_right_after_its_own_restart_a_replay_of_the_present_boot_passes_once_until_a_newer_frame_came():
    """A limit, not a promise: a flash page a frame would be the price of more."""
    radio = a_keyed()
    old = [sealed_frame(5, 42, sequence, a_state()) for sequence in (1, 2, 3)]
    for frame in old:
        hear(radio, 0, frame)
    radio = restarted(radio)
    hear(radio, 0, old[1])
    hear(radio, 0, old[1])
    assert (radio.counters.received, drops(radio)) == (1, {"replayed": 1})
    hear(radio, 1, sealed_frame(5, 42, 500, a_state()))
    for frame in old:
        hear(radio, 2, frame)
    assert (radio.counters.received, drops(radio)) == (2, {"replayed": 4})


@pytest.mark.parametrize("robot", [3, link.NO_ROBOT])
def test_a_radio_with_a_key_takes_no_identity_from_a_hello(robot):
    radio = a_keyed(robot=robot, channel=6)
    radio.usb_rx(0, link.encode_message(link.Hello(link.LINK_VERSION, 4, 9, 11, 100, 5)))
    (reply,) = messages(radio, link.HelloReply)
    assert (reply.robot, reply.fleet, reply.channel) == (robot, FLEET, 6)
    assert (radio.memory.robot, radio.memory.fleet, radio.memory.channel) == (robot, FLEET, 6)
    assert not reply.flags & link.FLAG_OPEN


def test_no_piece_of_the_key_leaves_the_radio_by_usb_or_air():
    radio = Radio(MAC, 7, Memory(boot_counter=1))
    told = bytearray()
    given = link.Provision(link.LINK_VERSION, 3, FLEET, 6, 6, KEY, 1_790_000_000)
    radio.usb_rx(0, link.encode_message(given))
    radio.kept(radio.dirty, True)
    told += radio.usb_tx()
    radio = Radio(MAC, 8, radio.memory.counted())
    for second in range(5):
        start_us = second * 1_000_000
        radio.usb_rx(start_us, link.encode_message(link.Hello(link.LINK_VERSION, 3, FLEET, 6, 100, 5)))
        radio.usb_rx(start_us, link.encode_message(link.AskPeers()))
        hear(radio, start_us, sealed_frame(5, 1, second + 1, a_state(), time_us=start_us))
        hear(radio, start_us, sealed_frame(5, 1, second + 1, a_state(), key=bytes(16)))
        send(radio, a_state(second), start_us)
        radio.press_button(start_us)
        told += b"".join(air_frames(radio, start_us, start_us + 999_000)) + radio.usb_tx()
    assert len(told) > 5000
    assert not any(KEY[k : k + PIECE] in told for k in range(len(KEY) - PIECE + 1))
    assert not any(KEY[::-1][k : k + PIECE] in told for k in range(len(KEY) - PIECE + 1))


def test_no_text_about_a_radio_names_its_key():
    memory = Memory(robot=3, fleet=FLEET, key=KEY, boot_counter=1)
    radio = Radio(MAC, 7, memory)
    given = link.Provision(link.LINK_VERSION, 3, FLEET, 6, 6, KEY, 1)
    texts = [f"{value!r} {value}" for value in (memory, radio, radio.memory, given, CipherPort())]
    for name in (KEY.hex(), KEY.hex(" "), repr(KEY), str(list(KEY)), str(tuple(KEY)), "key=b"):
        assert not any(name in text for text in texts), name
