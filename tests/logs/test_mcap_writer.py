"""Our MCAP writer: the mcap package reads back what was written, with every checksum checked."""

from __future__ import annotations

import io
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, SeekingReader

from hippomat_logs.mcap_writer import McapWriter

MESSAGES = st.lists(
    st.tuples(st.integers(0, 2), st.integers(0, 2**32 - 1), st.integers(0, 2**62), st.binary(max_size=80)),
    max_size=60,
)


class Memory(io.BytesIO):
    """An output that keeps everything."""


def written(messages: list[tuple[int, int, int, bytes]], chunk_bytes: int, flush_every: int) -> bytes:
    output = Memory()
    writer = McapWriter(output, "ros2", "test", chunk_bytes)
    writer.add_metadata("facts", {"a": "1", "ä": "ö"})
    schema = writer.add_schema("std_msgs/msg/String", "ros2msg", b"string data")
    channels = [writer.add_channel(f"/topic{k}", "cdr", schema, {"k": str(k)}) for k in range(3)]
    for index, (channel, sequence, time_ns, data) in enumerate(messages):
        writer.add_message(channels[channel], sequence, time_ns, data)
        if index % flush_every == flush_every - 1:
            writer.flush()
    writer.add_attachment(5, "weights", "application/octet-stream", b"abc")
    writer.finish()
    return output.getvalue()


@given(MESSAGES, st.integers(50, 2000), st.integers(1, 20))
def test_the_mcap_package_reads_back_what_was_written(
    messages: list[tuple[int, int, int, bytes]], chunk_bytes: int, flush_every: int
) -> None:
    data = written(messages, chunk_bytes, flush_every)
    wanted = [(f"/topic{channel}", *rest) for channel, *rest in messages]
    plain: Any = NonSeekingReader(io.BytesIO(data), validate_crcs=True)
    assert [_row(*each) for each in plain.iter_messages(log_time_order=False)] == wanted
    seeking: Any = SeekingReader(io.BytesIO(data), validate_crcs=True)
    assert sorted(_row(*each) for each in seeking.iter_messages()) == sorted(wanted)
    summary = seeking.get_summary()
    assert summary.statistics.message_count == len(messages)
    if messages:
        assert summary.statistics.message_start_time == min(time_ns for _, _, time_ns, _ in messages)
    assert [record.metadata for record in seeking.iter_metadata()] == [{"a": "1", "ä": "ö"}]
    assert [record.data for record in seeking.iter_attachments()] == [b"abc"]


@given(MESSAGES)
def test_an_index_leads_to_the_messages_of_one_topic(messages: list[tuple[int, int, int, bytes]]) -> None:
    seeking: Any = SeekingReader(io.BytesIO(written(messages, 200, 7)), validate_crcs=True)
    found = sorted(_row(*each) for each in seeking.iter_messages(topics=["/topic1"]))
    assert found == sorted(("/topic1", *rest) for channel, *rest in messages if channel == 1)


def _row(_: Any, channel: Any, message: Any) -> tuple[str, int, int, bytes]:
    return channel.topic, message.sequence, message.log_time, bytes(message.data)
