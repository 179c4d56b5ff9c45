"""Serial bytes become events; noise becomes counts; chunking changes neither."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from radio_samples import reply_of, status_of

from hippomat_core.messages import (
    BASE,
    LIDAR,
    RADIO,
    BaseFeedback,
    FrameSent,
    LinkNoise,
    RadioStatus,
    RoundEnded,
    ScanReceived,
    StopHeard,
    TasksHeard,
)
from hippomat_core.wire import cobs, jetbot_base, rplidar
from hippomat_core.wire.codec import encode_frame
from hippomat_core.wire.device_events import decoder_for
from hippomat_core.wire.frames import STOP, TASKS, Header, StopFrame, TasksFrame, TaskSlot
from hippomat_core.wire.link import Heard, PeerReport, Round, Sent, encode_message

HEADER = Header(TASKS, False, 1, 3, 7, 41, 123456)
TASKS_FRAME = TasksFrame((TaskSlot(2, 5, 1, -120, 40, 0),))
STATUS = status_of(uptime_us=99, dropped_usb=7)
REPLY = reply_of()
PEER = PeerReport(255, bytes(6), 1, 2, -40, 5, 6, 7, 1)
FEEDBACK = jetbot_base.Feedback(gyro=(1, -2, 3), odom_x_mm=-5, wheels=(1, 2, 3, -4), reserved=9)
SWEEP = rplidar.Sweep(
    np.full(50, 47, np.uint8), np.arange(50, dtype=np.uint16) * 460, np.arange(50, dtype=np.uint16) * 99
)
STREAMS = {
    RADIO: b"".join(map(encode_message, (STATUS, REPLY, PEER, Sent(7, TASKS, 9, True))))
    + encode_message(Heard(5, 6, -60, encode_frame(HEADER, TASKS_FRAME))),
    BASE: jetbot_base.encode_feedback(FEEDBACK) * 2,
    LIDAR: rplidar.encode_scan_descriptor() + SWEEP.encode() * 3,
}


def events(port: int, chunks: list[bytes]) -> list[Any]:
    decoder = decoder_for(port)
    return [event for chunk in chunks for event in decoder.events(77, chunk)]


def test_messages_of_the_radio_become_events() -> None:
    status, sent, tasks = events(RADIO, [STREAMS[RADIO]])
    assert isinstance(status, RadioStatus)
    assert (status.stamp_ns, status.uptime_us, status.dropped_usb) == (77, 99, 7)
    assert status.firmware == STATUS.firmware
    assert sent == FrameSent(77, 7, TASKS, 9, True)
    assert tasks == TasksHeard(77, 5, 6, -60, HEADER, TASKS_FRAME)


def test_stop_is_heard_as_stop() -> None:
    header = Header(STOP, False, 1, 3, 7, 42, 0)
    (event,) = events(RADIO, [encode_message(Heard(5, 6, -60, encode_frame(header, StopFrame(3, 255, 0))))])
    assert event == StopHeard(77, 5, 6, -60, header, StopFrame(3, 255, 0))


def test_the_end_of_a_round_is_an_event() -> None:
    (event,) = events(RADIO, [encode_message(Round(12, 1_300_000, 900, 0b10110, True))])
    assert event == RoundEnded(77, 12, 1_300_000, 900, 0b10110, True)


def test_feedback_of_the_base_becomes_an_event_that_encodes_to_the_same_bytes() -> None:
    first, second = events(BASE, [STREAMS[BASE]])
    assert isinstance(first, BaseFeedback)
    assert first.wheels.tolist() == [1, 2, 3, -4]
    assert jetbot_base.encode_feedback(first) + jetbot_base.encode_feedback(second) == STREAMS[BASE]


def test_a_commands_echo_is_no_feedback() -> None:
    assert events(BASE, [jetbot_base.encode_velocity(0.1, 0.0)]) == []


def test_whole_sweeps_become_scans() -> None:
    scans = events(LIDAR, [STREAMS[LIDAR]])
    assert [type(scan) for scan in scans] == [ScanReceived] * 2
    assert scans[0].distance_q2.tolist() == SWEEP.distance_q2.tolist()


@pytest.mark.parametrize("port", [RADIO, BASE, LIDAR])
def test_noise_is_one_event_behind_the_others_and_told_once(port: int) -> None:
    noise = b"\x01\x02\x03\x00"
    decoder = decoder_for(port)
    found = list(decoder.events(1, noise + STREAMS[port]))
    told = [event for event in found if isinstance(event, LinkNoise)]
    assert told == [LinkNoise(1, port, 4, 0)]
    assert found[-1] is told[0]
    assert [event for event in decoder.events(2, STREAMS[port]) if isinstance(event, LinkNoise)] == []


def test_an_intact_link_frame_with_a_wrong_message_is_noise() -> None:
    wrong = cobs.encode(b"\x99what")
    broken_air = encode_message(Heard(5, 6, -60, bytes(30)))
    assert events(RADIO, [wrong, broken_air]) == [
        LinkNoise(77, RADIO, 5, 0),
        LinkNoise(77, RADIO, 5 + 1 + 17 + 30, 0),
    ]


@given(st.sampled_from([RADIO, BASE, LIDAR]), st.lists(st.integers(0, 900), max_size=10))
def test_any_chunking_gives_the_same_events(port: int, cuts: list[int]) -> None:
    stream = STREAMS[port]
    places = sorted({cut % (len(stream) + 1) for cut in cuts} | {0, len(stream)})
    chunks = [stream[a:b] for a, b in itertools.pairwise(places)]
    assert list(map(repr, events(port, chunks))) == list(map(repr, events(port, [stream])))
