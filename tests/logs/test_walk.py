"""What stands inside a chunk: reading it and counting it take the same bytes for the same messages."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hippomat_core.errors import LogError
from hippomat_logs.mcap_writer import CHANNEL, MESSAGE, SCHEMA
from hippomat_logs.strict_walk import BATCH, batches
from hippomat_logs.walk import Contents, RawMessage, counted_inside, messages_inside

TOPICS = {1: "/one", 2: "/two"}
ERRORS = (LogError, struct.error, UnicodeDecodeError, KeyError)  # what a damaged chunk may raise


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def message(channel: int, data: bytes) -> bytes:
    return record(MESSAGE, struct.pack("<HIQQ", channel, 7, 11, 13) + data)


DESCRIPTIONS = record(SCHEMA, struct.pack("<H", 1) + text("a/msg/A") + text("ros2msg") + text("")) + b"".join(
    record(CHANNEL, struct.pack("<HH", number, 1) + text(topic) + text("cdr") + struct.pack("<I", 0))
    for number, topic in TOPICS.items()
)


def read(inside: bytes) -> Counter[str]:
    return Counter(message.topic for message in messages_inside(inside, Contents()))


def counted(inside: bytes) -> Counter[str]:
    contents = Contents()
    assert list(counted_inside(inside, contents)) == []
    assert contents.messages == sum(contents.counts.values())
    return Counter({contents.channels[number].topic: count for number, count in contents.counts.items()})


@pytest.mark.parametrize("of_inside", [read, counted])
def test_a_message_too_short_to_be_one_is_damage(of_inside: object) -> None:
    assert callable(of_inside)
    short = record(MESSAGE, struct.pack("<H", 1))  # a channel and no more, which the next record hides
    with pytest.raises(LogError, match="message of 2 bytes inside a chunk"):
        of_inside(DESCRIPTIONS + short + message(2, b"abc"))


@given(
    st.lists(st.tuples(st.sampled_from(sorted(TOPICS)), st.binary(max_size=40)), max_size=12),
    st.lists(st.tuples(st.integers(0, 400), st.integers(0, 255)), max_size=2),
)
def test_what_is_counted_is_what_is_read(
    messages: list[tuple[int, bytes]], changes: list[tuple[int, int]]
) -> None:
    inside = bytearray(DESCRIPTIONS + b"".join(message(channel, data) for channel, data in messages))
    for at, value in changes:
        inside[at % len(inside)] = value
    found: list[object] = []
    for of_inside in (read, counted):
        try:
            found.append(of_inside(bytes(inside)))
        except ERRORS as error:
            found.append((type(error), str(error)))
    assert found[0] == found[1]
    if not changes:
        assert found[0] == Counter(TOPICS[channel] for channel, _ in messages)


def test_what_stands_before_a_damaged_message_is_given_out_before_the_damage_is_told() -> None:
    def messages() -> Iterator[RawMessage]:
        for number in range(BATCH + 3):
            yield RawMessage(number, 0, "/one", b"")
        raise LogError("damaged")

    given_out = batches(messages())
    numbers = [message.number for batch in (next(given_out), next(given_out)) for message in batch]
    assert numbers == list(range(BATCH + 3))
    with pytest.raises(LogError, match="damaged"):
        next(given_out)
    assert list(batches(())) == []
