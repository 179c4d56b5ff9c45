"""Laws of the wire codecs in Python: round trips, strictness, chunking, resynchronisation."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from wire_values import air_frames, link_messages, plain

from hippomat_core.errors import WireError
from hippomat_core.wire import cobs, codec, link
from hippomat_core.wire import frames as air

quick = settings(max_examples=60, deadline=None, derandomize=True)

LARGEST_STATE = air.StateFrame(
    *(5, 31, -1, -1, -1, 255, 255),
    air.AirClaim(79, 65535, 255, 65535, True, 3, -1, -1, -1, 65535),
    np.full(80, 255, np.uint8),
    np.full(80, 3, np.uint8),
    *(65535, 65535, 255),
    np.full(12, 26, np.uint8),
    2**64 - 1,
    np.full(64, 3, np.uint8),
    *(2**32 - 1, 2**32 - 1, 65535),
)
ROW = air.RelayRow(
    *(31, 255, 5, 29, 9, 8, True, 3, True, False, -1, 2, -3, 255, np.arange(30, dtype=np.uint8))
)


@given(air_frames)
@quick
def test_a_decoded_frame_is_the_encoded_one(pair):
    data = codec.encode_frame(*pair)
    assert len(data) <= air.MAX_FRAME - air.TAG_BYTES
    assert plain(codec.decode_frame(data)) == plain(pair)


@given(air_frames, st.data())
@quick
def test_whatever_decodes_encodes_to_the_same_bytes(pair, data):
    frame = bytearray(codec.encode_frame(*pair))
    for _ in range(data.draw(st.integers(1, 3))):
        frame[data.draw(st.integers(0, len(frame) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    cut = bytes(frame[: data.draw(st.integers(0, len(frame)))]) if data.draw(st.booleans()) else bytes(frame)
    try:
        decoded = codec.decode_frame(cut)
    except WireError:
        return
    assert codec.encode_frame(*decoded) == cut


@given(st.binary(max_size=250))
@quick
def test_random_bytes_decode_or_raise_wire_error(data):
    try:
        codec.decode_frame(data)
    except WireError:
        pass
    else:
        assert codec.encode_frame(*codec.decode_frame(data)) == data


@given(link_messages)
@quick
def test_a_decoded_link_message_is_the_encoded_one(message):
    (payload,) = cobs.FrameDecoder().feed(link.encode_message(message))
    assert link.decode_message(payload) == message


@given(st.one_of(st.binary(max_size=260), link_messages.map(link.encode_payload)), st.integers(0, 2000))
@quick
def test_whatever_link_payload_decodes_encodes_to_the_same_bytes(payload, flip):
    mutable = bytearray(payload)
    if mutable:
        mutable[flip % len(mutable)] ^= 1 << flip % 8
    try:
        message = link.decode_message(bytes(mutable))
    except WireError:
        return
    assert link.encode_payload(message) == bytes(mutable)


@given(st.lists(st.binary(max_size=80), max_size=5), st.binary(max_size=40), st.data())
@quick
def test_any_chunking_gives_the_same_frames_and_every_byte_is_accounted_for(payloads, noise, data):
    stream = bytearray(b"".join(cobs.encode(payload) for payload in payloads))
    if data.draw(st.booleans()):
        at = data.draw(st.integers(0, len(stream)))
        stream[at:at] = noise
    whole = cobs.FrameDecoder()
    expected = list(whole.feed(bytes(stream)))
    chunked = cobs.FrameDecoder()
    found, at = [], 0
    while at < len(stream):
        size = data.draw(st.integers(1, 30))
        found += chunked.feed(bytes(stream[at : at + size]))
        at += size
    assert found == expected
    assert (chunked.skipped_bytes, chunked.bad_checksums) == (whole.skipped_bytes, whole.bad_checksums)
    tail = len(stream) - (bytes(stream).rfind(b"\0") + 1)
    taken = sum(len(cobs.encode(payload)) for payload in expected)
    assert taken + whole.skipped_bytes + tail == len(stream)


@given(st.binary(max_size=600))
@example(b"")
@example(b"\1" * 254)
@example(b"\1" * 254 + b"\0")
@example(b"\1" * 508)
@example(b"\1" * 253 + b"\0")
@quick
def test_stuffing_removes_zeros_and_is_undone(data):
    stuffed = cobs.stuff(data)
    assert 0 not in stuffed
    assert cobs.unstuff(stuffed) == data


@given(st.binary(max_size=300))
@quick
def test_only_what_stuffing_produces_is_unstuffed(stuffed):
    plain_bytes = cobs.unstuff(stuffed)
    assert plain_bytes is None or cobs.stuff(plain_bytes) == stuffed


def test_stuffing_matches_the_published_examples():
    assert cobs.stuff(b"\0") == b"\1\1"
    assert cobs.stuff(b"\x11\x22\0\x33") == b"\3\x11\x22\2\x33"
    assert cobs.stuff(bytes(range(1, 255))) == b"\xff" + bytes(range(1, 255))
    assert cobs.unstuff(b"\xff" + bytes(range(1, 255)) + b"\1") is None


def test_a_decoder_resynchronises_behind_noise_and_counts_it():
    decoder = cobs.FrameDecoder()
    good = cobs.encode(b"\1\2")
    broken = bytearray(good)
    broken[1] ^= 4
    assert list(decoder.feed(b"ESP-ROM:esp32s3\r\n\0" + bytes(broken) + good)) == [b"\1\2"]
    assert decoder.bad_checksums == 1
    assert decoder.skipped_bytes == 18 + len(good)


def test_endless_noise_is_counted_and_not_kept():
    decoder = cobs.FrameDecoder()
    for _ in range(100):
        assert not list(decoder.feed(b"\7" * 100))
    assert decoder.skipped_bytes == 10_000
    assert list(decoder.feed(b"\0" + cobs.encode(b"a"))) == [b"a"]


def test_frames_are_decoded_even_when_nobody_iterates():
    decoder = cobs.FrameDecoder()
    decoder.feed(b"noise\0")
    assert decoder.skipped_bytes == 6


def test_the_largest_state_leaves_room_for_the_tag():
    assert len(codec.encode_body(LARGEST_STATE)) == 174
    assert plain(codec.decode_body(air.STATE, codec.encode_body(LARGEST_STATE))) == plain(LARGEST_STATE)


def test_five_relay_rows_of_thirty_tasks_fill_a_frame_with_its_tag():
    header = air.Header(air.RELAY, False, 1, 2, 3, 4, 5)
    full = air.RelayFrame(32, 2**32 - 1, (ROW,) * 5)
    assert len(codec.encode_frame(header, full)) + air.TAG_BYTES == air.MAX_FRAME
    with pytest.raises(WireError, match="RELAY rows = 6 are more than 5, the most at N = 32, M = 30"):
        codec.encode_frame(header, air.RelayFrame(32, 0, (ROW,) * 6))
    with pytest.raises(WireError, match="RELAY rows = 5 are more than 4, the most at N = 33, M = 30"):
        codec.encode_frame(header, air.RelayFrame(33, 0, (ROW,) * 5))


def test_two_relay_rows_fit_at_the_largest_fleet():
    row = dataclasses.replace(ROW, costs=np.zeros(80, np.uint8))
    body = codec.encode_body(air.RelayFrame(64, 2**64 - 1, (row,) * 2))
    assert len(body) == 2 + 8 + 2 * 94


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"robot": 32}, "RELAY.robot = 32 is outside 0 .. 31"),
        ({"slot": 30}, "RELAY.slot = 30 is outside 0 .. 29"),
        ({"tag": 0}, "RELAY.tag = 0 is outside 1 .. 3"),
        ({"localized": 2}, "RELAY.localized = 2 is not a bool"),
        ({"slot": air.NO_SLOT}, "has no slot: its other fields must be 0"),
        ({"costs": np.zeros(29, np.uint8)}, "RELAY.costs has shape (29,)"),
    ],
)
def test_a_relayed_row_that_does_not_fit_is_named(change, message):
    with pytest.raises(WireError) as caught:
        codec.encode_body(air.RelayFrame(32, 0, (ROW, dataclasses.replace(ROW, **change))))
    assert message in str(caught.value)


def test_held_rows_are_of_the_roster():
    with pytest.raises(WireError, match=r"RELAY.held = 8 is outside 0 .. 7"):
        codec.encode_body(air.RelayFrame(3, 8, (dataclasses.replace(ROW, robot=0),)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x_cm": 40000}, "STATE.x_cm = 40000 is outside -32768 .. 32767"),
        ({"status": 6}, "STATE.status = 6 is outside 0 .. 5"),
        ({"flags": 32}, "STATE.flags = 32 is outside 0 .. 31"),
        ({"speed_2cmps": 1.5}, "STATE.speed_2cmps = 1.5 must be a whole number"),
        ({"costs": np.zeros(81, np.uint8)}, "must hold 1 .. 80 values"),
        ({"costs": np.full(80, 256)}, "STATE.costs[0] = 256 is outside 0 .. 255"),
        ({"costs": np.zeros(80)}, "STATE.costs is of type float64"),
        ({"task_states": np.full(80, 4)}, "STATE.task_states[0] = 4 is outside 0 .. 3"),
        ({"intent_steps": np.full(13, 1)}, "must hold 0 .. 12 values"),
        ({"intent_steps": np.full(2, 27)}, "STATE.intent_steps[0] = 27 is outside 0 .. 26"),
        ({"endorsed": np.zeros(10, np.uint8)}, "STATE.heard = 18446744073709551615 is outside 0 .. 1023"),
        ({"claim": dataclasses.replace(air.NO_CLAIM, cost=3)}, "has no slot: its other fields must be 0"),
        ({"claim": dataclasses.replace(LARGEST_STATE.claim, slot=80)}, "STATE.claim.slot = 80 is outside"),
        ({"claim": dataclasses.replace(LARGEST_STATE.claim, tag=0)}, "STATE.claim.tag = 0 is outside 1 .. 3"),
    ],
)
def test_a_value_that_does_not_fit_is_named(change, message):
    with pytest.raises(WireError) as caught:
        codec.encode_body(dataclasses.replace(LARGEST_STATE, **change))
    assert message in str(caught.value)


def test_a_header_of_another_kind_or_version_is_refused():
    header = air.Header(air.TASKS, False, 1, 2, 3, 4, 5)
    with pytest.raises(WireError, match=r"Header.kind = 3 does not go with a StopFrame"):
        codec.encode_frame(header, air.StopFrame(1, 2, 3))
    data = codec.encode_frame(dataclasses.replace(header, kind=air.RESUME), air.StopFrame(1, 2, 3))
    with pytest.raises(WireError, match="version = 1 is not 2"):
        codec.decode_frame(bytes([0x15]) + data[1:])


def test_a_sealed_frames_body_is_read_like_an_open_one():
    header = air.Header(air.STOP, True, 1, air.OPERATOR, 3, 4, 5)
    data = codec.encode_frame(header, air.StopFrame(1, 2, 3))
    assert data[0] == 0x2C
    assert codec.decode_frame(data) == (header, air.StopFrame(1, 2, 3))


def test_an_operator_sends_no_state_and_no_relay():
    with pytest.raises(WireError, match=r"Header.kind = 1 is not sent by an operator"):
        codec.encode_header(air.Header(air.STATE, False, 1, air.OPERATOR, 3, 4, 5))


@pytest.mark.parametrize(
    ("message", "error"),
    [
        (link.Hello(2, 64, 1, 6, 100, 5), "robot = 64 is neither 0 .. 63 nor 255"),
        (link.Hello(2, 3, 1, 15, 100, 5), "channel = 15 is outside 1 .. 14"),
        (link.Hello(2, 3, 1, 6, 100, 33), "slots = 33 are outside 1 .. 32, what a round of 100 ms has room"),
        (link.Hello(2, 3, 1, 6, 40, 5), "round_ms = 40 is outside 50 .. 1000"),
        (link.SendBody(air.STOP, bytes(4)), "SendBody.kind = 4 is not STATE or TASKS"),
        (link.SendBody(air.STATE, bytes(227)), "SendBody.body length = 227 is outside 1 .. 226"),
        (link.Provision(2, 3, 1, 6, 54, b"", 0), "rate_mbps = 54 is not one of (6, 12, 24)"),
        (link.Provision(2, 3, 1, 6, 6, b"short", 0), "key length = 5 is not 16 (0: OPEN)"),
        (link.Provision(2, 3, 1, 6, 6, bytes(16), 0), "protects nothing: OPEN is an empty key"),
        (link.Provision(2, 3, 1, 6, 6, b"", 2**32), "Provision.unix_s = 4294967296 is outside"),
        (link.Command(air.STATE, 0, 0), "Command.kind = 1 is not STOP or RESUME"),
        (link.Command(air.STOP, 1, 0), "Command.counter = 1 is not 0"),
        (link.PeerReport(64, bytes(6), 1, 2, -3, 4, 5, 6, 7), "PeerReport.robot = 64 is no sender"),
        (link.Provisioned(2, 1), "Provisioned.stored = 2 is outside 0 .. 1"),
    ],
)
def test_a_message_that_says_what_cannot_be_is_named(message, error):
    with pytest.raises(WireError) as caught:
        link.encode_payload(message)
    assert error in str(caught.value)


def test_a_key_is_shown_nowhere():
    key = b"do not show this"
    assert "show" not in repr(link.Provision(2, 3, 1, 6, 6, key, 0))
    with pytest.raises(WireError) as caught:
        link.encode_payload(link.Provision(2, 3, 1, 6, 6, key + key, 0))
    assert "show" not in str(caught.value)


def test_decoded_arrays_cannot_be_changed():
    frame = codec.decode_body(air.STATE, codec.encode_body(LARGEST_STATE))
    for array in (frame.costs, frame.task_states, frame.intent_steps, frame.endorsed):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
