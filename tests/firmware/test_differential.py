"""The firmware's C and the host's Python write the same bytes and accept the same bytes."""

from __future__ import annotations

import dataclasses
import os

import numpy as np
import pytest
from c_messages import c_message, c_understood
from c_values import RADIO, c_decode, c_encode, exactly, ffi, lib
from hypothesis import given, settings
from hypothesis import strategies as st
from wire_values import air_frames, from_host, i16, plain, to_host, u8, u16, u32

from hippomat_core.errors import WireError
from hippomat_core.wire import cobs, codec, link
from hippomat_core.wire import frames as air

# The run under the sanitizers, several times slower, asks for fewer.
EXAMPLES = int(os.environ.get("HIPPOMAT_EXAMPLES", "120"))
FROM_HOST = (link.Hello, link.SendBody, link.Provision, link.Command, link.AskPeers)
thorough = settings(max_examples=EXAMPLES, deadline=None, derandomize=True)

# Values that fit the C structs' integers, mostly wrong as frames.
any_claim = st.one_of(
    st.builds(air.AirClaim, u8, u16, u8, u16, st.booleans(), st.integers(0, 5), i16, i16, i16, u16),
    st.builds(air.AirClaim, st.just(255), *[st.integers(0, 1)] * 3, st.booleans(), *[st.integers(0, 1)] * 5),
)
small = st.integers(0, 1)
any_row = st.builds(
    lambda robot, status, slot, claim, flags, place: air.RelayRow(
        *(robot, 1, status, slot, *claim, *flags, *place, np.full(30, 9, np.uint8))
    ),
    *(st.integers(0, 5), st.integers(0, 7), st.sampled_from([0, 9, 29, 30, 255])),
    st.tuples(small, small, st.booleans(), st.integers(0, 4)),
    st.tuples(st.booleans(), st.booleans()),
    st.tuples(small, small, small, small),
)
any_task = st.builds(air.TaskSlot, st.integers(0, 85), u16, st.integers(0, 5), i16, i16, i16)


def both_agree(header: air.Header, frame: object) -> None:
    try:
        expected = codec.encode_frame(header, frame)
    except WireError:
        expected = None
    assert c_encode(header, frame) == expected


@given(air_frames)
@thorough
def test_both_encode_a_frame_to_the_same_bytes(pair):
    both_agree(*pair)
    assert c_encode(*pair) is not None


@given(air_frames, any_claim, st.integers(0, 40), st.integers(0, 7))
@thorough
def test_both_refuse_the_same_states(pair, claim, flags, status):
    header, frame = pair
    if isinstance(frame, air.StateFrame):
        both_agree(header, dataclasses.replace(frame, claim=claim))
        both_agree(header, dataclasses.replace(frame, flags=flags, status=status))
        both_agree(header, dataclasses.replace(frame, endorsed=frame.endorsed[:flags]))
        both_agree(header, dataclasses.replace(frame, intent_steps=np.full(status, flags, np.uint8)))


@given(st.lists(any_row, max_size=6), st.lists(any_task, max_size=22), st.integers(0, 66), st.integers(0, 64))
@thorough
def test_both_refuse_the_same_small_frames(rows, tasks, n, held):
    both_agree(air.Header(air.RELAY, False, 1, 2, 3, 4, 5), air.RelayFrame(n, held, tuple(rows)))
    both_agree(air.Header(air.TASKS, True, 1, 2, 3, 4, 5), air.TasksFrame(tuple(tasks)))


@given(
    st.sampled_from([air.RESUME, air.STOP]),
    st.booleans(),
    st.one_of(st.integers(60, 70), st.just(255)),
    st.integers(0, 2**25),
)
@thorough
def test_both_refuse_the_same_headers(kind, sealed, sender, sequence):
    header = air.Header(kind, sealed, 1, sender, 3, sequence, 2**48 - 1 + sequence % 2)
    both_agree(header, air.StopFrame(1, 2, 3))


@pytest.mark.parametrize("kind", range(16))
@pytest.mark.parametrize("sender", [0, 63, 64, 254, 255])
def test_both_accept_the_same_kinds_from_the_same_senders(kind, sender):
    data = bytes([air.PROTOCOL_VERSION << 4 | kind, 1, sender]) + bytes(13)
    try:
        expected = codec.decode_header(data)
    except WireError:
        expected = None
    header = ffi.new("rc_header *")
    accepted = lib.rc_header_decode(exactly(data), len(data), header)
    assert accepted == (expected is not None)
    assert not accepted or (header.kind, bool(header.sealed)) == (expected.kind, expected.sealed)
    assert accepted == (1 <= kind & 7 <= 5 and (sender < 64 or (sender == 255 and kind & 7 >= 3)))


@given(st.one_of(air_frames.map(lambda pair: codec.encode_frame(*pair)), st.binary(max_size=260)), st.data())
@thorough
def test_both_accept_the_same_bytes_and_read_the_same_values(data, draw):
    damaged = bytearray(data)
    for _ in range(draw.draw(st.integers(0, 3)) if damaged else 0):
        damaged[draw.draw(st.integers(0, len(damaged) - 1))] = draw.draw(u8)
    tried = bytes(damaged[: draw.draw(st.one_of(st.just(None), st.integers(0, len(damaged))))])
    try:
        expected = plain(codec.decode_frame(tried))
    except WireError:
        expected = None
    assert plain(c_decode(tried)) == expected
    assert lib.rc_frame_valid(exactly(tried), len(tried)) == (expected is not None)


@given(st.integers(0, 41), st.sampled_from([1, 3, 4]), u8)
@thorough
def test_both_judge_every_changed_byte_of_a_small_state_alike(index, keep, value):
    claim = air.AirClaim(0, 1, 2, 3, True, keep % 3 + 1, 4, 5, 6, 7)
    frame = air.StateFrame(
        *(1, 2, 3, 4, 5, 6, 7, claim, np.array([9], np.uint8), np.array([1], np.uint8), 8, 9, 0),
        *(np.array([13], np.uint8), 1, np.array([2], np.uint8), 10, 11, 12),
    )
    data = bytearray(codec.encode_frame(air.Header(air.STATE, False, 1, 2, 3, 4, 5), frame))
    data[16 + index] = value
    try:
        expected = plain(codec.decode_frame(bytes(data)))
    except WireError:
        expected = None
    assert plain(c_decode(bytes(data))) == expected


def with_zeros_at(length: int, places: list[int]) -> bytes:
    return bytes(0 if i in places else 1 + i % 255 for i in range(length))


payloads = st.one_of(
    st.binary(max_size=262),
    st.lists(st.sampled_from([0, 1, 255]), max_size=262).map(bytes),
    # rows of about 254 bytes that are not 0x00, the most that a block of COBS holds
    st.builds(with_zeros_at, st.integers(245, 260), st.lists(st.integers(0, 260), max_size=2)),
    st.builds(with_zeros_at, st.integers(245, 260), st.lists(st.integers(0, 12), max_size=2)),
)


@given(payloads)
@thorough
def test_both_frame_a_payload_alike(payload):
    out = ffi.new("uint8_t[]", lib.RC_LINK_MAX_ENCODED)
    size = lib.rc_cobs_encode(exactly(payload), len(payload), out)
    if len(payload) > cobs.MAX_PAYLOAD:
        assert size == 0
    else:
        assert bytes(ffi.buffer(out, size)) == cobs.encode(payload)


stream_parts = st.one_of(
    st.binary(max_size=270).map(cobs.stuff).map(lambda stuffed: stuffed + b"\0"),
    st.binary(max_size=260).map(cobs.encode),
    st.binary(max_size=40),
    st.integers(0, 3).map(lambda count: b"\xff" * (100 * count)),
    st.just(b"\xff" + b"\7" * 254 + b"\1\0"),
)


@given(st.lists(stream_parts, max_size=8).map(b"".join))
@thorough
def test_both_find_the_same_frames_in_any_stream(stream):
    python = cobs.FrameDecoder()
    expected = list(python.feed(stream))
    decoder = ffi.new("rc_cobs_decoder *")
    found = []
    for byte in stream:
        size = lib.rc_cobs_push(decoder, byte)
        if size >= 0:
            found.append(bytes(ffi.buffer(decoder.buffer, size)))
    assert found == expected
    assert decoder.skipped_bytes == python.skipped_bytes
    assert decoder.bad_checksums == python.bad_checksums


@given(st.one_of(from_host, to_host), st.integers(0, 2), st.data())
@thorough
def test_both_understand_the_same_messages_from_a_host(message, damages, data):
    payload = bytearray(link.encode_payload(message))
    for _ in range(damages):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.one_of(u8, small))
    tried = bytes(payload[: data.draw(st.one_of(st.just(None), st.integers(1, len(payload))))])
    try:
        expected = link.decode_message(tried)
    except WireError:
        expected = None
    assert c_understood(tried) == (expected if isinstance(expected, FROM_HOST) else None)


@given(to_host)
@thorough
def test_both_write_the_same_messages_to_a_host(message):
    assert c_message(message) == link.encode_payload(message)


@pytest.mark.parametrize("size", [0, 15, 16, 242, 243, 250])
def test_both_pass_on_the_same_lengths_of_frames(size):
    heard = link.Heard(1, 2, -3, bytes(size))
    assert bool(c_message(heard)) == (16 <= size <= 242)
    if not 16 <= size <= 242:
        with pytest.raises(WireError, match=r"Heard.frame length"):
            link.encode_payload(heard)


@pytest.mark.parametrize("round_ms", [0, 49, 50, 52, 53, 99, 100, 199, 200, 1000, 1001, 65535])
def test_both_accept_the_same_rounds(round_ms):
    for slots in range(256):
        payload = bytes([link.HELLO, 2, 3, 1, 6, round_ms & 255, round_ms >> 8, slots])
        try:
            expected = link.decode_message(payload)
        except WireError:
            expected = None
        assert c_understood(payload) == expected


@given(st.binary(max_size=600), st.lists(st.binary(min_size=1, max_size=255), max_size=4), u32)
@thorough
def test_a_radio_survives_anything_from_usb_and_air(noise, frames, seed):
    memory = ffi.new("uint64_t[]", (lib.rc_size() + 7) // 8)
    radio = ffi.cast("rc_radio *", memory)
    config = ffi.new("rc_config *", {"boot_kept": True})
    lib.rc_memory_init(ffi.addressof(config.memory))
    config.memory.identity.robot = seed % 70
    lib.rc_init(radio, 0, config)
    lib.rc_usb_rx(radio, 0, exactly(noise), len(noise))
    out = ffi.new("uint8_t[]", lib.RC_LINK_MAX_ENCODED)
    frame = ffi.new("uint8_t[]", lib.RC_MAX_FRAME)
    for at, data in enumerate(frames):
        lib.rc_air_rx(radio, at, -50, exactly(bytes(6)), exactly(data), len(data))
        lib.rc_usb_rx(radio, at, exactly(cobs.encode(b"\2" + data)), len(cobs.encode(b"\2" + data)))
        lib.rc_air_tx(radio, at, frame)
        lib.rc_tick(radio, at * seed)
    decoder = cobs.FrameDecoder()
    while size := lib.rc_usb_tx(radio, out, len(out)):
        for payload in decoder.feed(bytes(ffi.buffer(out, size))):
            link.decode_message(payload)
    assert decoder.skipped_bytes == 0


def test_the_library_under_test_is_the_one_that_was_asked_for():
    assert RADIO.path.is_file()
