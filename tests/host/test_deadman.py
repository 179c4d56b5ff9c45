"""Laws of the dead man's switch: whatever happens, an old command is never given out."""

from hypothesis import given
from hypothesis import strategies as st

from hippomat_core.wire.jetbot_base import BaseFrame, Decoder, encode_velocity
from hippomat_host.deadman import PERIOD_NS, TIMEOUT_NS, ZERO, Deadman

FAST = encode_velocity(0.2, 1.0)
(FAST_FRAME,) = Decoder().feed(FAST)
GAPS = st.lists(st.tuples(st.integers(0, 400_000_000), st.booleans()), max_size=40)


@given(GAPS)
def test_a_velocity_is_given_out_only_while_its_command_is_young(steps: list[tuple[int, bool]]) -> None:
    deadman, now_ns, commanded_ns = Deadman(), 0, None
    for gap_ns, commands in steps:
        now_ns += gap_ns
        if commands:
            deadman, commanded_ns = deadman.commanded(now_ns, FAST_FRAME), now_ns
        deadman, frame = deadman.output(now_ns)
        if frame not in (b"", ZERO):
            assert frame == FAST
            assert commanded_ns is not None
            assert now_ns - commanded_ns < TIMEOUT_NS


@given(GAPS)
def test_no_two_frames_are_further_apart_than_a_period_when_polled_on_time(
    steps: list[tuple[int, bool]],
) -> None:
    deadman, now_ns = Deadman(), 0
    for _, commands in steps:
        if commands:
            deadman = deadman.commanded(now_ns, FAST_FRAME)
        deadman, frame = deadman.output(now_ns)
        assert frame
        now_ns = deadman.next_ns
        assert deadman.output(now_ns - 1)[1] == b""


def test_a_stopped_daemon_means_zeros_well_within_300_ms() -> None:
    deadman = Deadman().commanded(0, FAST_FRAME)
    frames = []
    for now_ns in range(0, 300_000_000, 1_000_000):
        deadman, frame = deadman.output(now_ns)
        frames += [(now_ns, frame)] if frame else []
    assert frames[0] == (0, FAST)
    first_zero_ns = next(now_ns for now_ns, frame in frames if frame == ZERO)
    assert TIMEOUT_NS <= first_zero_ns <= TIMEOUT_NS + PERIOD_NS
    assert all(frame == ZERO for now_ns, frame in frames if now_ns >= first_zero_ns)


def test_before_the_first_command_there_are_only_zeros() -> None:
    assert Deadman().output(10**12)[1] == ZERO


def test_what_is_no_velocity_is_no_command() -> None:
    assert Deadman().commanded(5, BaseFrame(0x12, bytes(6))) == Deadman()
