"""Laws of the air: who hears what, when, and that nothing but seed and calls decides it."""

from __future__ import annotations

import itertools
import math
import operator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hippomat_core.wire.cobs import FrameDecoder
from hippomat_core.wire.frames import STOP
from hippomat_core.wire.link import LINK_VERSION, Command, Hello, decode_message, encode_message
from hippomat_core.wire.link import Heard as HeardMessage
from hippomat_sim.carrier import DIFS_US, SENSE_US
from hippomat_sim.devices.virtual_radio import VirtualRadio
from hippomat_sim.medium import AirSettings, Happening, Heard, Left, Medium, airtime_us

sends = st.lists(
    st.tuples(st.integers(0, 3000), st.integers(0, 4), st.binary(min_size=16, max_size=250)), max_size=30
)


def happenings(
    frames: list[tuple[int, int, bytes]], air: AirSettings, seed: int, pauses: list[int]
) -> list[Happening]:
    """Send in time order, popping at the sends and at `pauses` in between."""
    medium, seen = Medium(5, air, seed), []
    calls = [(t, 1, sender, frame) for t, sender, frame in sorted(frames)] + [(t, 0, 0, b"") for t in pauses]
    for now_us, is_send, sender, frame in sorted(calls, key=lambda call: call[:2]):
        while (happening := medium.pop(now_us - 1)) is not None:
            seen.append(happening)
        if is_send:
            medium.send(now_us, sender, frame)
    while (happening := medium.pop(10**9)) is not None:
        seen.append(happening)
    assert medium.next_us() is None
    return seen


@pytest.mark.parametrize(("payload", "expected_us"), [(61, 170), (124, 254), (250, 422)])
def test_airtime_is_the_standards(payload: int, expected_us: int) -> None:
    assert airtime_us(payload) == expected_us


@given(sends, st.integers(0, 99), st.lists(st.integers(0, 4000), max_size=20))
@settings(max_examples=60)
def test_no_frame_reaches_its_sender_and_every_frame_leaves_once(
    frames: list[tuple[int, int, bytes]], seed: int, pauses: list[int]
) -> None:
    seen = happenings(frames, AirSettings(loss=0.3, duplicate=0.2), seed, pauses)
    left = [h for h in seen if isinstance(h, Left)]
    assert sorted((h.sender, h.frame) for h in left) == sorted((s, f) for _, s, f in frames)
    senders: dict[bytes, set[int]] = {}
    for h in left:
        senders.setdefault(h.frame, set()).add(h.sender)
    for h in seen:
        if isinstance(h, Heard):
            assert senders[h.frame] != {h.receiver}


@given(sends, st.integers(0, 99), st.lists(st.integers(0, 4000), max_size=20))
@settings(max_examples=60)
def test_what_happens_depends_on_seed_and_send_times_only_and_comes_in_time_order(
    frames: list[tuple[int, int, bytes]], seed: int, pauses: list[int]
) -> None:
    air = AirSettings(loss=0.2, duplicate=0.1, bursts="link", late=0.1, hidden=frozenset({(0, 1), (2, 4)}))
    seen = happenings(frames, air, seed, pauses)
    assert seen == happenings(frames, air, seed, [])
    assert [h.at_us for h in seen] == sorted(h.at_us for h in seen)


@given(sends, st.integers(0, 99))
@settings(max_examples=60)
def test_who_can_sense_a_transmission_does_not_start_within_it(
    frames: list[tuple[int, int, bytes]], seed: int
) -> None:
    left = [h for h in happenings(frames, AirSettings(), seed, []) if isinstance(h, Left)]
    on_air = sorted((h.at_us - airtime_us(len(h.frame)), h.at_us) for h in left)
    for (start, end), (next_start, _) in itertools.pairwise(on_air):
        assert next_start - start < SENSE_US or next_start >= end + DIFS_US


@given(sends, st.integers(0, 99))
@settings(max_examples=60)
def test_every_frame_is_accounted_for_at_every_receiver(
    frames: list[tuple[int, int, bytes]], seed: int
) -> None:
    medium = Medium(5, AirSettings(loss=0.3, hidden=frozenset({(0, 1), (0, 2), (3, 4)})), seed)
    for now_us, sender, frame in sorted(frames):
        medium.send(now_us, sender, frame)
    reached = 0
    while (ended := medium.pop_ended(10**9)) is not None:
        reached += len(set(ended.receivers.tolist()))
    counts = medium.counts
    assert sum(c.sent for c in counts) == len(frames)
    for station, c in enumerate(counts):
        missed = c.lost + c.collided + c.deaf + c.unreached
        assert c.received + missed == sum(other.sent for other in counts) - counts[station].sent
    assert sum(c.received for c in counts) == reached


@given(sends, st.integers(0, 99))
@settings(max_examples=30)
def test_a_transmission_told_at_once_is_the_same_as_its_receptions_one_by_one(
    frames: list[tuple[int, int, bytes]], seed: int
) -> None:
    air = AirSettings(loss=0.2, duplicate=0.1, late=0.2)
    one_by_one = [h for h in happenings(frames, air, seed, []) if isinstance(h, Heard)]
    medium = Medium(5, air, seed)
    for now_us, sender, frame in sorted(frames):
        medium.send(now_us, sender, frame)
    at_once = []
    while (ended := medium.pop_ended(10**9)) is not None:
        for at_us, receiver, rssi in zip(ended.arrivals_us, ended.receivers, ended.rssi_dbm, strict=True):
            at_once.append(Heard(int(at_us), int(receiver), int(rssi), ended.frame, ended.sender))
    by_time = operator.attrgetter("at_us", "receiver", "sender", "frame", "rssi_dbm")
    assert sorted(at_once, key=by_time) == sorted(one_by_one, key=by_time)


def test_the_loss_rate_is_what_was_asked_for_on_every_link() -> None:
    asked = {(0, 1): 0.5, (0, 2): 0.0}
    air = AirSettings(loss=0.1, duplicate=0.0, link_loss=asked)
    trials = 3000
    medium = Medium(4, air, seed=7)
    heard = [0] * 4
    for k in range(trials):
        medium.send(k * 1000, 0, bytes(50))
        while (happening := medium.pop(k * 1000 + 999)) is not None:
            if isinstance(happening, Heard):
                heard[happening.receiver] += 1
    for receiver, loss in ((1, 0.5), (2, 0.0), (3, 0.1)):
        five_sigma = 5 * math.sqrt(trials * loss * (1 - loss))
        assert abs(heard[receiver] - trials * (1 - loss)) <= five_sigma
    assert [c.received for c in medium.counts] == heard
    assert sum(c.lost for c in medium.counts) + sum(heard) == 3 * trials


def test_signal_falls_with_distance() -> None:
    medium = Medium(3, AirSettings(), seed=1)
    medium.positions_m = [(0.0, 0.0), (1.0, 0.0), (30.0, 0.0)]
    heard: dict[int, list[int]] = {1: [], 2: []}
    for number in range(50):
        medium.send(number * 10_000, 0, bytes(20))
        while (happening := medium.pop((number + 1) * 10_000 - 1)) is not None:
            if isinstance(happening, Heard):
                heard[happening.receiver].append(happening.rssi_dbm)
    near, far = sum(heard[1]) / len(heard[1]), sum(heard[2]) / len(heard[2])
    assert near == pytest.approx(-40, abs=2)
    assert far == pytest.approx(near - 22 * math.log10(30), abs=3)


def test_a_frame_goes_from_radio_to_radio_and_its_duplicate_is_dropped_by_the_firmware() -> None:
    medium = Medium(2, AirSettings(duplicate=1.0), seed=3)
    radios = [VirtualRadio(station, 3, medium) for station in range(2)]
    for robot, radio in enumerate(radios):
        radio.receive(0, encode_message(Hello(LINK_VERSION, robot, 1, 1, 100, 2)))
    radios[0].receive(1000, encode_message(Command(STOP, 0, 1)))
    left = []
    while (happening := medium.pop(4000)) is not None:
        if isinstance(happening, Left):
            left.append(happening.frame)
            radios[happening.sender].sent(happening.at_us)
        else:
            assert happening.receiver != happening.sender
            radio = radios[happening.receiver]
            radio.heard(happening.at_us, happening.rssi_dbm, happening.sender, happening.frame)
    assert radios[1].radio.counters.received == radios[1].radio.counters.dropped_replayed == 1
    messages = [decode_message(payload) for payload in FrameDecoder().feed(radios[1].for_host())]
    heard = [message for message in messages if isinstance(message, HeardMessage)]
    assert [message.frame for message in heard] == left
    assert [frame[0] & 7 for frame in left] == [STOP]
