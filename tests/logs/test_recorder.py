"""The recorder: nothing is lost silently, the caller never waits, and every ROS tool opens what it wrote."""

from __future__ import annotations

import dataclasses
import os
import resource
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_samples import CONFIG, START_NS, new_recorder, record_samples, sample
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from recorded_run import record_run
from rosbags.highlevel import AnyReader

from hippomat_core import messages as m
from hippomat_core.config import LogConfig
from hippomat_logs.manifest import config_of, fingerprint, run_manifest
from hippomat_logs.reader import open_runs, read_records
from hippomat_logs.recorder import MIN_SYNC_S, PLUG_S, SYNC_S, period_s
from hippomat_logs.records import DropRecord, SerialRecord, TimingRecord
from hippomat_logs.recovery import recover_directory
from hippomat_logs.schema import CLASSES, DERIVED, EVENTS, differences
from hippomat_logs.sink import FileSink, FullDiskSink, file_sinks


def only_log(directory: Path) -> Path:
    (path,) = directory.glob("*.mcap")
    return path


def test_serial_bytes_are_those_of_the_call_whatever_becomes_of_the_buffer(tmp_path: Path) -> None:
    recorder, buffer = new_recorder(tmp_path, lossless=True), bytearray(b"moved")
    recorder.serial(START_NS, m.BASE, 0, 1, buffer)
    buffer[:] = b"later"
    recorder.close()
    assert [one.data for *_, one in read_records(only_log(tmp_path)) if type(one) is SerialRecord] == [
        b"moved"
    ]


@given(sync_s=st.floats(0.0, PLUG_S - MIN_SYNC_S - 0.05))
def test_a_pulled_plug_costs_half_a_second_on_slow_disks_too(sync_s: float) -> None:
    """What came right behind a sync's begin is on the disk when the next one ends."""
    assert MIN_SYNC_S <= period_s(sync_s) <= SYNC_S
    assert period_s(sync_s) + sync_s < PLUG_S


def test_everything_recorded_is_read_back_in_order(tmp_path: Path) -> None:
    recorder = new_recorder(tmp_path, lossless=True)
    given = record_samples(recorder, 60)
    status = recorder.close()
    assert (status.records, status.lost) == (240, 0)
    read = list(read_records(only_log(tmp_path)))
    assert [number for number, *_ in read] == list(range(1, 241))
    for value, (_, log_time_ns, _, message) in zip(given, read, strict=True):
        if isinstance(message, SerialRecord):
            assert message.data == value
        elif isinstance(message, TimingRecord):
            assert message.compute_ns == value
        else:
            assert list(differences(value, message)) == []
        assert log_time_ns - 1_700_000_000_000_000_000 == getattr(
            message, "stamp_ns", log_time_ns
        ) - START_NS or (type(message) not in EVENTS)


def test_rosbags_and_mcap_ros2_decode_every_topic(tmp_path: Path) -> None:
    record_run(tmp_path, ticks=30)
    path = only_log(tmp_path)
    topics: dict[str, int] = {}
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            assert reader.deserialize(raw, connection.msgtype) is not None
            topics[connection.topic] = topics.get(connection.topic, 0) + 1
        assert {c.topic for c in reader.connections} == set(CLASSES) | set(DERIVED)
    others: dict[str, int] = {}
    with path.open("rb") as file:
        decoders = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in decoders.iter_decoded_messages():
            assert message is not None
            others[channel.topic] = others.get(channel.topic, 0) + 1
    assert topics == others
    assert {"/scan", "/odom", "/tf", "/tf_static", "/map", "/hippo/event/tick"} <= set(topics)


def test_the_standard_topics_say_what_the_records_say(tmp_path: Path) -> None:
    record_run(tmp_path, ticks=30)
    with AnyReader([only_log(tmp_path)]) as reader:
        seen: dict[str, list[Any]] = {}
        for connection, _, raw in reader.messages():
            if connection.topic in DERIVED:
                seen.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    scan = seen["/scan"][0]
    assert scan.header.frame_id == "lidar"
    assert scan.ranges.shape == (360,)
    assert scan.ranges[0] == pytest.approx(1.5)
    assert scan.ranges[356] == pytest.approx(1.5)  # 4 degrees clockwise
    assert np.isinf(scan.ranges[1])
    grid = seen["/map"][0]
    assert (grid.info.width, grid.info.height, grid.data[0]) == (100, 100, 100)
    assert seen["/tf"][0].transforms[0].header.frame_id == "map"
    assert seen["/tf_static"][0].transforms[0].child_frame_id == "lidar"
    assert seen["/odom"][-1].pose.pose.position.x == pytest.approx(0.003 * 30, abs=0.01)


def test_the_manifest_says_what_the_run_was(tmp_path: Path) -> None:
    new_recorder(tmp_path).close()
    manifest = open_runs([tmp_path])[0].manifest
    assert config_of(manifest, "log") == CONFIG
    assert manifest["robot"] == "2"
    assert manifest["session_id"] == "5e551011"
    assert fingerprint()["numpy"] in manifest["fingerprint"]
    assert only_log(tmp_path).name.startswith("robot02_20231114T221320Z_")


def test_parts_rotate_by_size_and_are_one_run(tmp_path: Path) -> None:
    config = dataclasses.replace(CONFIG, log=LogConfig(part_mib=1))
    rng = np.random.default_rng(3)
    recorder = new_recorder(tmp_path, lossless=True, config=config)
    for k in range(30):
        recorder.serial(START_NS + k, m.BASE, 0, 1, rng.bytes(100_000))
        if k % 10 == 9:
            wait_until_written(recorder)
    recorder.close()
    run = open_runs([tmp_path])[0]
    assert len(run.paths) >= 2
    assert sum(1 for _ in run.records_in_order()) == 30


def wait_until_written(recorder: Any) -> None:
    """A rotation happens at a flush, at most half a second later."""
    threading.Event().wait(0.7)
    assert recorder.status().problem == ""


def test_a_full_queue_drops_counts_and_says_so_in_the_log(tmp_path: Path) -> None:
    recorder = new_recorder(tmp_path, queue_records=50)
    for k in range(2000):
        recorder.put(START_NS + k, m.Tick(START_NS + k))
    status = recorder.close()
    assert status.records == 2000
    assert status.lost > 0
    run = open_runs([tmp_path])[0]
    kept = [record for record in run.records_in_order() if not isinstance(record.message, DropRecord)]
    assert len(kept) == 2000 - status.lost
    assert "queue full" in run.lost[0]


def test_a_value_that_does_not_fit_costs_its_record_only(tmp_path: Path) -> None:
    recorder = new_recorder(tmp_path)
    recorder.put(START_NS, m.Tick(START_NS))
    recorder.put(START_NS, m.ConflictSeen(999, 0, 0, False, "tie"))
    recorder.put(START_NS + 1, m.Tick(START_NS + 1))
    status = recorder.close()
    assert "ConflictSeen" in status.problem
    run = open_runs([tmp_path])[0]
    assert [type(r.message).__name__ for r in run.records_in_order()] == ["Tick", "DropRecord", "Tick"]


def test_a_full_disk_does_not_stop_the_run_and_the_log_goes_on_when_there_is_room(tmp_path: Path) -> None:
    room = [30_000, 0, 10**9]  # bytes: the disk is full, still full, then somebody makes room
    files = file_sinks(tmp_path)
    recorder = new_recorder(tmp_path, open_sink=lambda name: FullDiskSink(files(name), room.pop(0)))
    rng = np.random.default_rng(1)
    for k in range(60):
        recorder.serial(START_NS + k, m.BASE, 0, 1, rng.bytes(2000))
        threading.Event().wait(0.05)
    status = recorder.close()
    assert status.records == 60
    assert 0 < status.lost < 60
    run = open_runs([tmp_path])[0]
    assert len(run.paths) >= 2
    kept = sum(isinstance(record.message, SerialRecord) for record in run.records_in_order())
    assert kept == 60 - status.lost
    assert "No space left on device" in run.lost[0]


def test_a_disk_that_is_full_from_some_moment_on_leaves_a_log_that_recovers(tmp_path: Path) -> None:
    files = file_sinks(tmp_path)
    sizes = iter([40_000] + [0] * 100)
    recorder = new_recorder(tmp_path, open_sink=lambda name: FullDiskSink(files(name), next(sizes)))
    rng = np.random.default_rng(1)
    for k in range(30):
        recorder.serial(START_NS + k, m.BASE, 0, 1, rng.bytes(2000))
        threading.Event().wait(0.05)
    status = recorder.close()
    assert "disk" in status.problem
    assert status.lost > 0
    run = open_runs([tmp_path])[0]
    assert 0 < sum(1 for _ in run.records_in_order()) < 30
    assert run.recovered


LIMITED = """
import sys
sys.path.insert(0, {tests!r})
from pathlib import Path
import numpy as np
from log_samples import START_NS, new_recorder
recorder = new_recorder(Path(sys.argv[1]))
rng = np.random.default_rng(1)
import time
for k in range(40):
    recorder.serial(START_NS + k, 1, 0, 1, rng.bytes(4000))
    time.sleep(0.05)
print(recorder.close())
"""


def test_a_file_size_limit_of_the_system_does_not_stop_the_process(tmp_path: Path) -> None:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (70_000, 70_000))

    child = subprocess.run(
        [sys.executable, "-c", LIMITED.format(tests=str(Path(__file__).parent)), str(tmp_path)],
        preexec_fn=limit,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert child.returncode == 0, child.stderr
    recover_directory(tmp_path)  # the child had no room left for that
    run = open_runs([tmp_path])[0]
    kept = sum(isinstance(record.message, SerialRecord) for record in run.records_in_order())
    assert kept >= 20


def test_a_failed_write_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    def fails() -> int:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        sink = FileSink(tmp_path, "x.mcap")
        sink.write(b"a" * 1000)
        sink.flush()
        sink.write(b"b" * 5000)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, before[1]))
        try:
            with pytest.raises(OSError, match="File too large"):
                sink.flush()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sink.abandon()
        return os.path.getsize(tmp_path / "x.mcap.active")

    assert fails() == 1000


def test_two_recorders_of_one_name_do_not_share_a_file(tmp_path: Path) -> None:
    first, second = new_recorder(tmp_path), new_recorder(tmp_path)
    first.close()
    second.close()
    assert len(list(tmp_path.glob("*.mcap"))) == 2


def test_a_directory_that_cannot_be_written_is_refused_at_the_start(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        new_recorder(tmp_path / "file" / "runs")


def test_the_sampled_values_cover_every_class(tmp_path: Path) -> None:
    del tmp_path
    rng = np.random.default_rng(0)
    assert {type(sample(kind, rng)) for kind in EVENTS} == set(EVENTS)
    assert run_manifest(CONFIG, session_id="x")["robot"] == "2"
