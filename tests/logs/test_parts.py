"""Parts of a run on a disk that fails now and then: whatever the history, the log tells what it lacks."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_samples import CONFIG, START_NS, WALL_NS, new_recorder

from hippomat_core import messages as m
from hippomat_core.errors import HippomatError
from hippomat_logs.direct_recorder import DirectRecorder
from hippomat_logs.manifest import run_manifest
from hippomat_logs.parts import Encoded, PartSeries
from hippomat_logs.reader import Run, open_runs
from hippomat_logs.records import DropRecord
from hippomat_logs.recovery import recover_directory
from hippomat_logs.schema import TOPICS, MessageStore
from hippomat_logs.sink import FaultyDisk, FullDiskSink, Sink, file_sinks

STORE = MessageStore()
TICK = TOPICS[m.Tick]
MANIFEST = {**run_manifest(CONFIG, session_id="5e551011"), "wall_offset_ns": "0"}
PART_BYTES = 600  # a few flushes


def tick(number: int) -> Encoded:
    return Encoded(TICK, number, WALL_NS + number, STORE.encode(m.Tick(START_NS + number)))


def series_on(open_sink: object) -> PartSeries:
    series = PartSeries(open_sink, "robot02", MANIFEST, STORE, PART_BYTES)  # type: ignore[arg-type]
    series.open()
    return series


def kept_and_named(run: Run) -> tuple[set[int], set[int]]:
    """Numbers of the records that are there, and of those that drop records name."""
    kept: set[int] = set()
    named: set[int] = set()
    for record in run.records_in_order():  # raises where a number is missing without a word
        if isinstance(record.message, DropRecord):
            named |= set(range(record.message.first, record.message.last + 1))
        else:
            kept.add(record.number)
    return kept, named


faults = st.lists(st.tuples(st.integers(3, 60), st.integers(1, 12)), max_size=5)
steps = st.lists(st.tuples(st.integers(0, 12), st.sampled_from((0.1, 0.4, 1.1))), min_size=1, max_size=20)


@given(faults=faults, steps=steps)
def test_whatever_fails_when_the_log_is_complete_or_says_what_is_missing(
    faults: list[tuple[int, int]], steps: list[tuple[int, float]]
) -> None:
    failing = {at + k for at, length in faults for k in range(length)}
    with tempfile.TemporaryDirectory() as directory:
        series = series_on(FaultyDisk(Path(directory), failing))
        number, now_s = 0, 0.0
        for count, pause_s in steps:
            records = [tick(number + 1 + k) for k in range(count)]
            number, now_s = number + count, now_s + pause_s
            series.add_all(records, now_s)
            series.flush(now_s)
        series.close(now_s, {})
        if series.abandoned:
            assert series.warning or series.problem
        recover_directory(directory)
        (run,) = open_runs([Path(directory)])
        kept, named = kept_and_named(run)
        assert not kept & named
        assert kept | named <= set(range(1, number + 1))
        unnamed = number - len(kept) - len(named)  # the tail of a run whose disk never came back
        assert len(named) + unnamed == series.lost_records
        if unnamed:
            assert run.recovered
            assert kept | named == set(range(1, number - unnamed + 1))


def test_a_disk_that_is_full_when_a_part_ends_goes_on_in_that_part(tmp_path: Path) -> None:
    files, opened = file_sinks(tmp_path), 0

    def open_sink(name: str) -> Sink:
        nonlocal opened
        opened += 1
        return FullDiskSink(files(name), 10**9 if opened == 1 or opened > 3 else 0)

    series = series_on(open_sink)
    problems = []
    for number in range(1, 41):
        series.add(tick(number), number * 0.4)
        series.flush(number * 0.4)
        problems.append(series.problem)
    series.close(41.0, {})
    assert any("goes on in this one" in problem for problem in problems)
    assert problems[-1] == ""  # there was room for the next part later
    assert (series.lost_records, series.abandoned) == (0, [])
    (run,) = open_runs([tmp_path])
    assert kept_and_named(run) == (set(range(1, 41)), set())
    assert list(tmp_path.glob("*.active")) == []
    assert not run.recovered


def test_a_disk_that_stays_full_from_a_rotation_on_leaves_a_log_that_can_be_replayed(tmp_path: Path) -> None:
    files, opened = file_sinks(tmp_path), 0

    def open_sink(name: str) -> Sink:
        nonlocal opened
        opened += 1
        return FullDiskSink(files(name), 25_000 if opened == 1 else 0)

    series = series_on(open_sink)
    for number in range(1, 401):
        series.add(tick(number), number * 0.4)
        series.flush(number * 0.4)
    series.close(401.0, {})
    assert series.lost_records > 0
    recover_directory(tmp_path)
    (run,) = open_runs([tmp_path])
    kept, _ = kept_and_named(run)
    assert run.recovered
    assert len(kept) == 400 - series.lost_records


def test_a_disk_that_cannot_sync_is_named_for_the_rest_of_the_run(tmp_path: Path) -> None:
    series = series_on(FaultyDisk(tmp_path, {1 + 2 + 1}))  # opened, its manifest, and then the second sync
    for number in range(1, 6):
        series.add(tick(number), number * 0.1)
        series.flush(number * 0.1)
    assert series.problem == ""
    assert "left for recovery: Input/output error" in series.warning
    series.close(1.0, {})
    recover_directory(tmp_path)
    (run,) = open_runs([tmp_path])
    assert kept_and_named(run) == (set(range(1, 6)), set())


def test_a_part_that_cannot_be_begun_leaves_no_file(tmp_path: Path) -> None:
    series = series_on(FaultyDisk(tmp_path, {3, 5, 6}))
    series.add(tick(1), 0.0)
    series.flush(0.0)  # fails, and so does the part that should follow
    series.close(0.1, {})
    assert series.problem
    assert [path.name for path in tmp_path.iterdir()] == ["robot02_000.mcap.active"]


def test_a_lost_drop_record_is_not_counted_on_top_of_what_it_names(tmp_path: Path) -> None:
    series = series_on(FaultyDisk(tmp_path, range(3, 1000)))
    drop = Encoded(TOPICS[DropRecord], 10, WALL_NS, STORE.encode(DropRecord(3, 10, "queue full")))
    series.add_all([tick(1), tick(2), drop], 0.0)
    series.flush(0.0)
    assert series.lost_records == 2


def test_what_mcap_cannot_hold_costs_its_batch_and_is_named(tmp_path: Path) -> None:
    series = series_on(file_sinks(tmp_path))
    series.add_all([tick(1), tick(2)], 0.0)
    series.add_all([tick(3), tick(4)._replace(log_time_ns=1 << 70)], 0.1)
    series.add_all([tick(5)], 0.2)
    series.close(0.3, {})
    recover_directory(tmp_path)
    (run,) = open_runs([tmp_path])
    assert kept_and_named(run) == ({1, 2, 5}, {3, 4})
    assert series.lost_records == 2
    assert "left for recovery: error:" in series.warning


@pytest.mark.parametrize("wall_ns", [-(1 << 62), (1 << 63) - 1])
def test_a_clock_that_is_off_by_centuries_costs_no_record(tmp_path: Path, wall_ns: int) -> None:
    recorder = new_recorder(tmp_path)
    recorder._offset_ns = wall_ns  # the name of a file holds no such year, a clock that steps may
    for k in range(5):
        recorder.put(START_NS + k, m.Tick(START_NS + k))
    status = recorder.close()
    assert (status.records, status.lost, status.problem) == (5, 0, "")
    (run,) = open_runs([tmp_path])
    assert kept_and_named(run) == (set(range(1, 6)), set())


def test_a_stamp_that_is_no_number_costs_its_record_alone(tmp_path: Path) -> None:
    recorder = new_recorder(tmp_path)
    for stamp_ns in (START_NS, None, START_NS + 1):
        recorder.put(stamp_ns, m.Tick(START_NS))
    status = recorder.close()
    assert (status.records, status.lost) == (3, 1)
    (run,) = open_runs([tmp_path])
    assert kept_and_named(run) == ({1, 3}, {2})


def test_an_error_of_the_recorder_itself_is_counted_and_leaves_a_log_to_recover(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = new_recorder(tmp_path)
    recorder.put(START_NS, m.Tick(START_NS))

    def broken(_now_s: float) -> None:
        raise ValueError("a mistake")

    monkeypatch.setattr(recorder._series, "flush", broken)
    recorder._thread.join(0.6)
    for k in range(1, 10):
        recorder.put(START_NS + k, m.Tick(START_NS + k))
    status = recorder.close()
    assert (status.records, status.lost) == (10, 10)
    assert status.problem == "recording ended: ValueError: a mistake"
    (run,) = open_runs([tmp_path])
    assert kept_and_named(run) == (set(), set())
    assert run.recovered
    assert list(tmp_path.glob("*.active")) == []


def test_a_simulated_run_ends_where_its_disk_fails_and_says_why(tmp_path: Path) -> None:
    clocks = {"wall_ns": WALL_NS, "stamp_ns": 0}
    disk = FaultyDisk(tmp_path, {3})
    recorder = DirectRecorder(tmp_path, MANIFEST, config=CONFIG, open_sink=disk, **clocks)  # type: ignore[arg-type]
    recorder.put(0, m.Tick(0))
    with pytest.raises(HippomatError, match=r"cannot record into .*Input/output error"):
        recorder.put(10**9, m.Tick(10**9))
