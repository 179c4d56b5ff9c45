"""Laws of the lidar link's codec."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hippomat_core.errors import WireError
from hippomat_core.wire import rplidar
from hippomat_core.wire.rplidar import Health, Info, Sweep, SweepDecoder

SAMPLES = st.lists(
    st.tuples(st.integers(0, 63), st.integers(0, 32767), st.integers(0, 65535)), min_size=1, max_size=40
)


def sweep_of(samples: list[tuple[int, int, int]]) -> Sweep:
    quality, angle, distance = zip(*samples, strict=True)
    return Sweep(np.array(quality, np.uint8), np.array(angle, np.uint16), np.array(distance, np.uint16))


SWEEPS = SAMPLES.map(sweep_of)
LONG = sweep_of([(15, 64 * k, 4000 + k) for k in range(60)])
INFOS = st.builds(
    Info,
    *[st.integers(0, 255)] * 4,
    serial=st.binary(min_size=16, max_size=16),
)


def same(found: list[Sweep], expected: list[Sweep]) -> bool:
    return [sweep.encode() for sweep in found] == [sweep.encode() for sweep in expected]


def chunked(data: bytes, cuts: list[int]) -> list[bytes]:
    places = sorted({cut % (len(data) + 1) for cut in cuts} | {0, len(data)})
    return [data[a:b] for a, b in itertools.pairwise(places)]


def decoded(chunks: list[bytes]) -> tuple[list[Sweep], int, int]:
    decoder = SweepDecoder()
    sweeps = [sweep for chunk in chunks for sweep in decoder.feed(chunk)]
    return sweeps, decoder.skipped_bytes, decoder.bad_checksums


@given(st.lists(SWEEPS, min_size=1, max_size=4))
def test_sweeps_behind_a_descriptor_survive_their_bytes(sweeps: list[Sweep]) -> None:
    stream = rplidar.encode_scan_descriptor() + b"".join(s.encode() for s in sweeps)
    found, skipped, bad = decoded([stream, LONG.encode()[:5]])  # the next start bit completes the last
    assert same(found, sweeps)
    assert (skipped, bad) == (0, 0)


@given(
    st.lists(
        st.one_of(SWEEPS.map(Sweep.encode), st.binary(max_size=20), st.just(rplidar.SCAN_DESCRIPTOR)),
        max_size=6,
    ),
    st.lists(st.integers(0, 1500), max_size=12),
)
def test_any_chunking_of_a_scan_gives_the_same_sweeps_and_counts(
    pieces: list[bytes], cuts: list[int]
) -> None:
    stream = b"".join(pieces)
    found, *counts = decoded(chunked(stream, cuts))
    whole, *whole_counts = decoded([stream])
    assert same(found, whole)
    assert counts == whole_counts


@given(st.binary(max_size=60), SWEEPS)
def test_scan_decoder_resynchronises_behind_any_noise(noise: bytes, sweep: Sweep) -> None:
    stream = rplidar.SCAN_DESCRIPTOR + LONG.encode() * 2 + noise + LONG.encode() * 4 + sweep.encode()
    found, _, _ = decoded([stream])
    assert same(found[:1], [LONG])
    assert same(found[-1:], [LONG])


@given(st.integers(0, 299), st.integers(0, 7))
def test_a_flipped_bit_in_a_scan_costs_at_most_two_sweeps(at: int, bit: int) -> None:
    stream = bytearray(rplidar.SCAN_DESCRIPTOR + LONG.encode() * 6)
    stream[7 + 300 + at] ^= 1 << bit
    found, _, _ = decoded([bytes(stream)])
    assert sum(same([sweep], [LONG]) for sweep in found) >= 3


def test_a_byte_lost_from_a_scan_is_noticed_and_its_sweep_dropped() -> None:
    data = LONG.encode()
    stream = rplidar.SCAN_DESCRIPTOR + data + data[:100] + data[101:] + data * 3
    found, skipped, bad = decoded([stream])
    assert same(found, [LONG] * len(found))
    assert len(found) >= 2
    assert skipped == 4
    assert bad == 1


def test_a_scan_that_is_already_running_is_decoded_without_its_descriptor() -> None:
    found, skipped, _ = decoded([LONG.encode()[33:] + LONG.encode() * 2 + LONG.encode()[:5]])
    assert same(found, [LONG] * 2)
    assert skipped == 2


def test_a_restarted_scan_is_no_damage() -> None:
    piece = rplidar.SCAN_DESCRIPTOR + LONG.encode() * 2
    found, skipped, bad = decoded([piece, piece])
    assert same(found, [LONG] * 2)
    assert (skipped, bad) == (0, 0)


def test_a_sweep_without_end_is_dropped() -> None:
    rest = LONG.encode()[5:]
    endless = LONG.encode() + rest * (rplidar.MAX_SWEEP_SAMPLES // 59 + 1)
    for chunks in ([rplidar.SCAN_DESCRIPTOR, endless, LONG.encode(), LONG.encode()],):
        assert same(decoded(chunks)[0], [LONG])
        assert same(decoded([b"".join(chunks)])[0], [LONG])


@given(INFOS, st.binary(max_size=10))
def test_info_is_found_behind_noise(info: Info, noise: bytes) -> None:
    data = rplidar.encode_info(info)
    assert rplidar.find_info(noise + data) == info
    assert rplidar.find_info(noise + data[:-1]) is None


@given(st.integers(0, 2), st.integers(0, 65535))
def test_health_survives_its_bytes(status: int, error: int) -> None:
    data = rplidar.encode_health(Health(status, error))
    assert rplidar.find_health(data) == Health(status, error)
    assert rplidar.find_health(data[:-1]) is None


@given(st.lists(st.sampled_from(rplidar.COMMANDS), max_size=5), st.binary(max_size=9))
def test_requests_are_found_and_the_rest_counted(commands: list[int], noise: bytes) -> None:
    quiet = bytes(byte for byte in noise if byte != rplidar.START)
    decoder = rplidar.RequestDecoder()
    stream = quiet.join([b"", *map(rplidar.request, commands), b""])
    found = [command for byte in stream for command in decoder.feed(bytes([byte]))]
    assert found == commands
    assert decoder.skipped_bytes == len(stream) - 2 * len(commands)


def test_a_sample_that_does_not_fit_is_refused() -> None:
    one = np.array([1], np.uint16)
    start = np.array([True])
    with pytest.raises(WireError, match="quality 64"):
        rplidar.encode_samples(np.array([64], np.uint8), one, one, start)
    with pytest.raises(WireError, match="angle_q6 40000"):
        rplidar.encode_samples(np.array([1], np.uint8), np.array([40000], np.uint16), one, start)
