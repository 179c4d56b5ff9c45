"""open_run(): what stands in the columns is what rosbags decodes, message by message, whatever the layout."""

from __future__ import annotations

import dataclasses
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_samples import CONFIG, START_NS, new_recorder, sample
from recorded_data import data_folder
from recorded_run import record_run
from rosbags.highlevel import AnyReader

import hippomat_logs
from hippomat_core import messages as m
from hippomat_core.config import LogConfig
from hippomat_core.errors import HippomatError, LogError
from hippomat_logs import open_run
from hippomat_logs.cdr_layout import fields_of_type
from hippomat_logs.column_table import NUMBER, ROW, TIME, Table, table_of
from hippomat_logs.opened_run import group_runs
from hippomat_logs.reader import reading_store
from hippomat_logs.records import SerialRecord
from hippomat_logs.schema import TOPICS, type_name


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_every_record_is_in_the_columns_as_it_was_encoded(seed: int) -> None:
    store, rng = reading_store(), np.random.default_rng(seed)
    for kind in TOPICS:
        records = [sample(kind, rng) for _ in range(8)]
        payloads = [store.encode(record) for record in records]
        table = table_of("/x", store.fields(type_name(kind)), [1] * 8, range(8), payloads)
        for row, record in enumerate(records):
            assert_same(table, row, record)


def assert_same(table: Table, row: int, record: Any, prefix: str = "") -> None:
    """Row `row` of a table holds the values of a message."""
    for name in names_of(record):
        value, path = getattr(record, name), prefix + name
        if path in table.children:
            child = table.child(path)
            rows = np.flatnonzero(child[ROW] == row)
            assert len(rows) == len(value)
            for inner, element in zip(rows, value, strict=True):
                assert_same(child, int(inner), element)
        elif names_of(value):
            assert_same(table, row, value, path + ".")
        elif isinstance(value, (tuple, list)) and path not in table.columns:
            assert len(value) == 0
        else:
            expected = np.frombuffer(value, np.uint8) if isinstance(value, bytes) else value
            equal_nan = getattr(np.asarray(expected).dtype, "kind", "") == "f"
            assert np.array_equal(table[path][row], expected, equal_nan=equal_nan), path


def names_of(value: Any) -> list[str]:
    """Field names of a message of ours or of rosbags'."""
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return []
    return [f.name for f in dataclasses.fields(value) if f.name != "__msgtype__" and not f.name.isupper()]


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_our_encoder_and_rosbags_make_the_same_bytes(seed: int) -> None:
    store, rng = reading_store(), np.random.default_rng(seed)
    for kind in TOPICS:
        record = sample(kind, rng)
        theirs = record
        if isinstance(record, SerialRecord):  # rosbags wants an array where we have bytes
            theirs = dataclasses.replace(record, data=np.frombuffer(record.data, np.uint8))  # type: ignore[arg-type]
        assert store.encode(record) == store.encode_standard(theirs, type_name(kind))


@pytest.mark.parametrize(
    "name", ["tilt_laser.bag", "example-lz4.bag", "ros2_94_topics.mcap", "cdr_test_0.mcap"]
)
def test_what_others_recorded_is_read_as_rosbags_reads_it(name: str) -> None:
    path = data_folder() / "bags" / name
    tables = open_run(path).tables()
    seen: dict[str, int] = {}
    with AnyReader([path]) as reader:
        for connection, time_ns, data in reader.messages():
            row = seen[connection.topic] = seen.get(connection.topic, -1) + 1
            if row % 7 == 0:  # every seventh: the comparison, not the reading, takes its time
                table = tables[connection.topic]
                assert table[TIME][row] == time_ns
                assert_same(table, row, reader.deserialize(data, connection.msgtype))
    assert {topic: len(table) - 1 for topic, table in tables.items() if len(table)} == seen


def test_a_channel_that_cannot_be_read_is_named_and_costs_nothing_else() -> None:
    run = open_run(data_folder() / "bags" / "topics_and_services.mcap")
    assert set(run.left_out) == {"/add_two_ints/_service_event", "/add_two_ints2/_service_event"}
    assert len(run["/parameter_events"]) == 7
    with pytest.raises(LogError, match="/add_two_ints/_service_event: its definition is a service's"):
        run.table("/add_two_ints/_service_event")


def test_parts_are_one_run_and_a_repeated_map_is_there_once(tmp_path: Path) -> None:
    config = dataclasses.replace(CONFIG, log=LogConfig(part_s=0.001, expected_min=0.0))
    recorder = new_recorder(tmp_path, lossless=True, config=config)
    recorder.put(START_NS, m.MapReceived(START_NS, 1, 2, 2, 0.1, 0.0, 0.0, np.zeros(4, np.int8)))
    for k in range(900):
        recorder.put(START_NS + k, m.Tick(START_NS + k))
        if k % 300 == 299:
            wait_for_a_part(recorder)
    recorder.close()
    run = open_run(tmp_path)
    assert len(run.sources) >= 2
    assert run["/hippo/event/tick"]["stamp_ns"].tolist() == [START_NS + k for k in range(900)]
    assert len(run["/map"]) == len(run["/tf_static"]) == 1
    assert sum(len(batch) for batch in run.batches("/hippo/event/tick", rows=100)) == 900


def wait_for_a_part(recorder: Any) -> None:
    import time

    name, until_s = recorder.status().file, time.monotonic() + 10.0
    while recorder.status().file == name and time.monotonic() < until_s:
        time.sleep(0.02)


def test_times_bound_a_table(tmp_path: Path) -> None:
    record_run(tmp_path, ticks=40)
    run = open_run(tmp_path)
    whole = run["/hippo/event/tick"]
    part = run.table("/hippo/event/tick", start_s=0.5, stop_s=1.0)
    begun_ns, _ = run.span_ns
    seconds = (whole[TIME] - begun_ns) / 1e9
    assert part[NUMBER].tolist() == whole[NUMBER][(seconds >= 0.5) & (seconds < 1.0)].tolist()


def test_tables_become_structured_arrays_and_data_frames(tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    record_run(tmp_path, ticks=20)
    table = open_run(tmp_path)["/odom"]
    rows = table.to_numpy()
    assert rows["pose.pose.position.x"].dtype == np.float64
    assert table.to_pandas()["pose.pose.position.x"].tolist() == rows["pose.pose.position.x"].tolist()
    assert open_run(tmp_path)["/scan"].stacked("ranges").shape[1] == 360
    with pytest.raises(HippomatError, match="has no column 'nothing'; it has log_time_ns"):
        table["nothing"]


def test_a_topic_or_run_that_is_not_there_is_named(tmp_path: Path) -> None:
    record_run(tmp_path / "a", ticks=3)
    with pytest.raises(HippomatError, match=r"has no topic '/nothing'; it has /hippo/"):
        open_run(tmp_path / "a").table("/nothing")
    record_run(tmp_path / "b", ticks=3)
    (copy,) = (tmp_path / "b").glob("*.mcap")
    copy.write_bytes(copy.read_bytes())
    assert len(group_runs([tmp_path / "a"])) == 1
    with pytest.raises(HippomatError, match="holds no log"):
        open_run(empty_directory(tmp_path))
    with pytest.raises(AttributeError):
        _ = hippomat_logs.nothing


def empty_directory(tmp_path: Path) -> Path:
    (tmp_path / "none").mkdir()
    return tmp_path / "none"


def test_big_endian_messages_are_read_too() -> None:
    from rosbags.typesys import Stores, get_typestore

    fields = fields_of_type(get_typestore(Stores.ROS2_JAZZY).fielddefs, "std_msgs/msg/Header")
    big = b"\0\0\0\0" + struct.pack(">iII", -5, 7, 6) + b"laser\0"
    little = b"\0\1\0\0" + struct.pack("<iII", 9, 8, 4) + b"map\0"
    table = table_of("/h", fields, [1, 2], [0, 0], [big, little])
    assert table["stamp.sec"].tolist() == [-5, 9]
    assert table["frame_id"].tolist() == ["laser", "map"]


@given(st.binary(max_size=60))
def test_bytes_that_are_no_message_are_refused_by_name(data: bytes) -> None:
    fields = reading_store().fields(type_name(m.RoundDecided))
    with pytest.raises(LogError, match=r"ends before its last field|longer than its message"):
        table_of("/x", fields, [1], [1], [data])
