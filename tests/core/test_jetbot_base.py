"""Laws of the base link's codec."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hippomat_core.errors import WireError
from hippomat_core.wire import jetbot_base
from hippomat_core.wire.jetbot_base import BaseFrame, Decoder, Feedback

INT16 = st.integers(-32768, 32767)


def triples(count: int) -> st.SearchStrategy[tuple[int, ...]]:
    return st.tuples(*[INT16] * count)


FEEDBACKS = st.builds(
    Feedback,
    gyro=triples(3),
    accel=triples(3),
    attitude_ddeg=triples(3),
    odom_x_mm=INT16,
    odom_y_mm=INT16,
    odom_yaw_mrad=INT16,
    delta_x_mm=INT16,
    delta_y_mm=INT16,
    delta_yaw_mrad=INT16,
    wheels=triples(4),
    reserved=st.integers(0, 65535),
)
KINDS = [(kind, size) for kind, sizes in jetbot_base.SIZES.items() for size in sizes]
FRAMES = st.sampled_from(KINDS).flatmap(
    lambda ks: st.binary(min_size=ks[1] - 5, max_size=ks[1] - 5).map(lambda body: BaseFrame(ks[0], body))
)
PIECES = st.lists(st.one_of(FRAMES.map(BaseFrame.encode), st.binary(max_size=12)), max_size=8)


def chunked(data: bytes, cuts: list[int]) -> list[bytes]:
    places = sorted({cut % (len(data) + 1) for cut in cuts} | {0, len(data)})
    return [data[a:b] for a, b in itertools.pairwise(places)]


def decoded(chunks: list[bytes]) -> tuple[list[BaseFrame], int, int, int]:
    decoder = Decoder()
    frames = [frame for chunk in chunks for frame in decoder.feed(chunk)]
    return frames, decoder.skipped_bytes, decoder.bad_checksums, decoder.pending


@given(PIECES, st.lists(st.integers(0, 500), max_size=12))
def test_any_chunking_of_a_base_stream_gives_the_same_frames_and_counts(
    pieces: list[bytes], cuts: list[int]
) -> None:
    stream = b"".join(pieces)
    assert decoded(chunked(stream, cuts)) == decoded([stream])


@given(PIECES)
def test_every_byte_of_a_base_stream_is_in_a_frame_or_counted_or_pending(pieces: list[bytes]) -> None:
    stream = b"".join(pieces)
    frames, skipped, _, pending = decoded([stream])
    assert sum(len(frame.encode()) for frame in frames) + skipped + pending == len(stream)


@given(FEEDBACKS)
def test_feedback_survives_its_frame(feedback: Feedback) -> None:
    data = jetbot_base.encode_feedback(feedback)
    assert len(data) == 0x2D
    assert data[:4] == b"\xaa\x55\x2d\x01"
    (frame,) = Decoder().feed(data)
    assert jetbot_base.decode_feedback(frame) == feedback
    assert frame.encode() == data


@given(st.floats(-32, 32), st.floats(-32, 32))
def test_velocity_survives_its_frame_to_a_thousandth(v_mps: float, wz_radps: float) -> None:
    (frame,) = Decoder().feed(jetbot_base.encode_velocity(v_mps, wz_radps))
    v, wz = jetbot_base.decode_velocity(frame)
    assert abs(v - v_mps) <= 0.000501
    assert abs(wz - wz_radps) <= 0.000501


@given(st.lists(FRAMES, min_size=1, max_size=5), st.binary(max_size=30).filter(lambda b: 0xAA not in b))
def test_noise_before_base_frames_is_skipped_and_counted(frames: list[BaseFrame], noise: bytes) -> None:
    found, skipped, bad, pending = decoded([noise, *[frame.encode() for frame in frames]])
    assert found == frames
    assert (skipped, bad, pending) == (len(noise), 0, 0)


@given(FEEDBACKS, st.integers(0, 44), st.integers(1, 255))
def test_base_decoder_resynchronises_after_a_corrupt_byte(feedback: Feedback, at: int, flip: int) -> None:
    whole = jetbot_base.encode_feedback(feedback)
    broken = bytearray(whole)
    broken[at] ^= flip
    calm = jetbot_base.encode_feedback(Feedback())  # zeros hold no false header
    frames, skipped, _, _ = decoded([bytes(broken), calm, calm, calm])
    assert frames[-2:] == [BaseFrame(1, calm[4:-1])] * 2
    assert skipped > 0


def test_the_vendor_protocols_velocity_frame_has_these_bytes() -> None:
    assert jetbot_base.encode_velocity(0.2, -1.5).hex() == "aa550b1100c80000fa24" + "01"


def test_velocity_is_clipped_to_what_the_frame_can_hold() -> None:
    (frame,) = Decoder().feed(jetbot_base.encode_velocity(1e6, -1e6))
    assert jetbot_base.decode_velocity(frame) == (32.767, -32.767)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_velocity_that_is_no_number_is_refused(value: float) -> None:
    with pytest.raises(WireError, match="not a finite number"):
        jetbot_base.encode_velocity(value, 0.0)


def test_a_value_outside_int16_is_refused_in_feedback() -> None:
    with pytest.raises(WireError, match="does not fit"):
        jetbot_base.encode_feedback(Feedback(odom_x_mm=40_000))


def test_a_frame_of_a_size_that_its_type_does_not_have_is_refused() -> None:
    with pytest.raises(WireError, match="known sizes"):
        BaseFrame(0x11, b"").encode()
    with pytest.raises(WireError, match="expected a base frame of type 0x01"):
        jetbot_base.decode_feedback(BaseFrame(0x11, bytes(6)))
