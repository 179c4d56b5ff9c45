"""What a dead daemon leaves behind: everything that was whole is read again, and the rest is named."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from fused_lab import write_fleet
from log_samples import START_NS, new_recorder
from mcap.writer import Writer
from recorded_run import RecordedRun, record_run, recorded_log

from hippomat_core import messages as m
from hippomat_core.errors import HippomatError
from hippomat_logs.cli import main as logs
from hippomat_logs.lenient_walk import walk_leniently
from hippomat_logs.reader import mapped, open_runs, read_records
from hippomat_logs.recovery import recover, recover_directory
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.walk import Contents

RECORDING = """
import sys, time
sys.path.insert(0, {tests!r})
from pathlib import Path
from log_samples import START_NS, new_recorder
from hippomat_core import messages as m
recorder = new_recorder(Path(sys.argv[1]))
print("recording", flush=True)
k = 0
while True:
    recorder.put(START_NS + k, m.Tick(START_NS + k))
    k += 1
    print(time.monotonic(), flush=True)
    time.sleep(0.002)
"""


@pytest.fixture(scope="module")
def unfinished(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A part of several chunks whose process died before the end."""
    directory = tmp_path_factory.mktemp("unfinished")
    run = cut_off_run(directory, ticks=120)
    (path,) = directory.glob("*.active")
    data = path.read_bytes()
    run.recorder.close()
    return data


def cut_off_run(directory: Path, ticks: int) -> RecordedRun:
    """A run whose chunks are in the file, but not its end."""
    run = record_run(directory, ticks=ticks, close=False)
    for k in range(3):
        time.sleep(0.6)
        run.event(m.Tick(START_NS + 10**10 + k * 50_000_000))
    time.sleep(0.7)
    return run


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_recording_process_killed_at_any_moment_loses_less_than_a_second(tmp_path: Path, seed: int) -> None:
    program = RECORDING.format(tests=str(Path(__file__).parent))
    child = subprocess.Popen(
        [sys.executable, "-c", program, str(tmp_path)], stdout=subprocess.PIPE, text=True, bufsize=1
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "recording\n"
    lines: list[str] = []
    until_s = time.monotonic() + 1.0 + float(np.random.default_rng(seed).uniform(0, 1))
    while time.monotonic() < until_s:
        lines.append(child.stdout.readline())
    os.kill(child.pid, signal.SIGKILL)
    lines += child.stdout.readlines()
    child.wait()
    (line,) = recover_directory(tmp_path)
    assert "recovered" in line
    kept = sum(1 for _ in open_runs([tmp_path])[0].records_in_order())
    times = [float(text) for text in lines if text.strip()]
    assert kept > 0
    assert times[-1] - times[min(kept, len(times)) - 1] < 1.0


def test_a_recovered_run_is_reproduced(tmp_path: Path, unfinished: bytes) -> None:
    (tmp_path / "robot00_x_000.mcap.active").write_bytes(unfinished)
    recover_directory(tmp_path)
    (run,) = open_runs([tmp_path])
    report = replay_run(run, ReplayOptions(levels=("L0", "L1", "L2")))
    assert report.verdict == "reproduced L1 L2 of a log that is not whole"
    assert report.exit_code == 3
    assert "recovered" in report.results[0].detail


@pytest.mark.parametrize("seed", range(12))
def test_a_file_cut_anywhere_gives_back_every_whole_chunk(
    tmp_path: Path, unfinished: bytes, seed: int
) -> None:
    cut = int(np.random.default_rng(seed).integers(200, len(unfinished)))
    path = tmp_path / "robot00_x_000.mcap.active"
    path.write_bytes(unfinished[:cut])
    whole = Contents()
    with mapped(path) as data:
        salvaged = sum(message.topic.startswith("/hippo/") for message in walk_leniently(data, whole))
    lines = recover_directory(tmp_path)
    if not salvaged:
        return
    read = list(read_records(tmp_path / "robot00_x_000.mcap"))
    assert len(read) == salvaged
    assert [number for number, *_ in read] == list(range(1, salvaged + 1))
    damaged = (tmp_path / "robot00_x_000.mcap.damaged").exists()
    assert damaged == ("original in" in lines[0])


def test_a_chunk_damaged_in_the_middle_is_named_by_a_drop_record(tmp_path: Path, unfinished: bytes) -> None:
    broken = bytearray(unfinished)
    chunks = chunk_offsets(unfinished)
    assert len(chunks) >= 3
    broken[chunks[1] + 200] ^= 0x10
    (tmp_path / "robot00_x_000.mcap.active").write_bytes(broken)
    (line,) = recover_directory(tmp_path)
    assert "chunk at byte" in line
    (run,) = open_runs([tmp_path])
    report = replay_run(run, ReplayOptions(levels=("L0", "L1", "L2")))
    assert report.exit_code == 3
    assert "the chunk that held them is damaged" in report.results[0].detail
    assert (tmp_path / "robot00_x_000.mcap.damaged").read_bytes() == bytes(broken)


def chunk_offsets(data: bytes) -> list[int]:
    offsets, at = [], 8
    while at + 9 <= len(data):
        if data[at] == 6:
            offsets.append(at)
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return offsets


def test_a_log_that_is_being_recorded_is_left_alone(tmp_path: Path) -> None:
    recorder = new_recorder(tmp_path)
    (line,) = recover_directory(tmp_path)
    assert "live process" in line
    recorder.put(START_NS, m.Tick(START_NS))
    recorder.close()
    assert sum(1 for _ in open_runs([tmp_path])[0].records_in_order()) == 1


def test_recovery_is_done_once_by_whoever_holds_the_lock(tmp_path: Path, unfinished: bytes) -> None:
    path = tmp_path / "robot00_x_000.mcap.active"
    path.write_bytes(unfinished)
    with path.open("rb") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        assert "live process" in recover_directory(tmp_path)[0]
    assert "recovered" in recover_directory(tmp_path)[0]
    assert recover_directory(tmp_path) == []


def test_an_interrupted_recovery_is_done_again(tmp_path: Path, unfinished: bytes) -> None:
    (tmp_path / "robot00_x_000.mcap.active").write_bytes(unfinished)
    (tmp_path / "robot00_x_000.mcap.recovering").write_bytes(b"half of it")
    recover_directory(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["robot00_x_000.mcap"]


def test_garbage_and_empty_files_are_named_not_raised(tmp_path: Path) -> None:
    (tmp_path / "a.mcap.active").write_bytes(b"")
    (tmp_path / "b.mcap.active").write_bytes(b"no log at all")
    lines = recover_directory(tmp_path)
    assert "empty, removed" in lines[0]
    assert "its run manifest cannot be read, so nothing was made of it" in lines[1]
    assert [path.name for path in tmp_path.iterdir()] == ["b.mcap.damaged"]


def test_no_original_takes_the_place_of_an_earlier_one(tmp_path: Path) -> None:
    for number in range(3):
        (tmp_path / "b.mcap.active").write_bytes(bytes([number]) * 100)
        recover_directory(tmp_path)
    kept = {path.name: path.read_bytes()[0] for path in tmp_path.iterdir()}
    assert kept == {"b.mcap.damaged": 0, "b.mcap.damaged.2": 1, "b.mcap.damaged.3": 2}


def test_a_damaged_finished_log_gives_its_name_to_the_recovered_one(tmp_path: Path) -> None:
    record_run(tmp_path, ticks=20)
    (path,) = tmp_path.glob("*.mcap")
    data = bytearray(path.read_bytes())
    data[-40] ^= 1
    path.write_bytes(data)
    (outcome,) = recover(path)
    assert "kept" in outcome.line
    assert not outcome.stays_damaged
    original = path.with_name(path.name + ".damaged")
    assert original.read_bytes() == data
    assert sum(1 for _ in read_records(path)) > 100
    assert "whole, nothing to do" in recover(path)[0].line
    assert recover(tmp_path) == []
    path.write_bytes(data)
    with pytest.raises(HippomatError, match=r"damaged exists already"):
        recover(path)


def test_a_directory_is_recovered_damaged_logs_included_and_is_then_read_by_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for robot in ("robot0", "robot1", "robot2"):
        record_run(tmp_path / robot, ticks=20)
    (flipped,) = (tmp_path / "robot0").glob("*.mcap")
    data = bytearray(flipped.read_bytes())
    data[-40] ^= 1
    flipped.write_bytes(data)
    (left,) = (tmp_path / "robot1").glob("*.mcap")
    left.rename(left.with_name(left.name + ".active"))
    with (tmp_path / "theirs.mcap").open("wb") as theirs:
        writer = Writer(theirs)
        writer.start("ros2", "somebody else")
        writer.finish()
    assert logs(["info", str(tmp_path)]) == 3
    assert "was never finished, and is left out: `hippomat-logs recover" in capsys.readouterr().err
    lines = [outcome.line for outcome in recover(tmp_path)]
    assert len([line for line in lines if "recovered" in line]) == len(lines) == 2, lines
    for robot in ("robot0", "robot1", "robot2"):
        (path,) = (tmp_path / robot).glob("*.mcap")
        assert sum(1 for _ in read_records(path)) > 100


def test_a_fused_file_is_not_recovered_but_its_parts(tmp_path: Path) -> None:
    write_fleet(tmp_path / "runs", seconds=1.0)
    assert logs(["fuse", str(tmp_path / "runs"), "-o", str(tmp_path / "fleet.mcap")]) == 0
    with pytest.raises(HippomatError, match="recover the robots' own logs, and fuse them again"):
        recover(tmp_path / "fleet.mcap")
    assert recover(tmp_path) == []


@pytest.mark.parametrize("block", [0, 1])
def test_a_bad_block_of_the_disk_does_not_reach_both_manifests(tmp_path: Path, block: int) -> None:
    record_run(tmp_path, ticks=20)
    (path,) = tmp_path.glob("*.mcap")
    records = sum(1 for _ in read_records(path))
    data = bytearray(path.read_bytes())
    data[4096 * block : 4096 * (block + 1)] = bytes(4096)
    path.with_name(path.name + ".active").write_bytes(data)
    path.unlink()
    (outcome,) = recover(tmp_path)
    assert f"recovered, {records} records kept" in outcome.line


def test_a_log_without_any_manifest_is_kept_aside_and_nothing_is_made_of_it(tmp_path: Path) -> None:
    record_run(tmp_path, ticks=20)
    (path,) = tmp_path.glob("*.mcap")
    data = bytearray(path.read_bytes())
    data[0:16384] = bytes(16384)
    path.with_name(path.name + ".active").write_bytes(data)
    path.unlink()
    (outcome,) = recover(tmp_path)
    assert "its run manifest cannot be read, so nothing was made of it; kept as" in outcome.line
    assert outcome.stays_damaged
    assert [one.name for one in tmp_path.iterdir()] == [path.name + ".damaged"]


def flip_near_the_end(path: Path) -> bytes:
    """Damages the summary; every record stays readable."""
    data = bytearray(path.read_bytes())
    data[-40] ^= 1
    path.write_bytes(data)
    return bytes(data)


def test_a_damaged_log_whose_original_was_set_aside_before_is_named_and_the_others_are_recovered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, other = (recorded_log(tmp_path / robot, ticks=5) for robot in ("robot0", "robot1"))
    first.with_name(first.name + ".damaged").write_bytes(b"of an earlier recovery")
    damaged = flip_near_the_end(first)
    flip_near_the_end(other)
    assert logs(["recover", str(tmp_path)]) == 3
    said = " ".join(capsys.readouterr().out.split())
    assert f"{first}: is damaged and was not recovered: {first}.damaged exists already; move it" in said
    assert f"{other.name}: recovered" in said
    assert first.read_bytes() == damaged
    assert sum(1 for _ in read_records(other)) > 10
    assert logs(["recover", str(first)]) == 3
    assert "exists already; move it away first" in " ".join(capsys.readouterr().err.split())


def test_recover_ends_with_3_where_a_log_stays_damaged_and_still_does_the_other_paths(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "x_000.mcap.active").write_bytes(b"no log at all")
    other = recorded_log(tmp_path / "b", ticks=5)
    assert logs(["recover", str(tmp_path / "b")]) == 0
    flip_near_the_end(other)
    assert logs(["recover", str(tmp_path / "a"), str(tmp_path / "none"), str(tmp_path / "b")]) == 3
    assert sum(1 for _ in read_records(other)) > 10
    assert logs(["recover", str(tmp_path)]) == 0  # all that can be read is whole


def test_a_damaged_fused_file_in_a_directory_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_fleet(tmp_path / "runs", seconds=1.0)
    assert logs(["fuse", str(tmp_path / "runs"), "-o", str(tmp_path / "fleet.mcap")]) == 0
    flip_near_the_end(tmp_path / "fleet.mcap")
    assert logs(["recover", str(tmp_path)]) == 3
    assert "fleet.mcap: is a fused file" in " ".join(capsys.readouterr().out.split())


def test_a_path_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(HippomatError, match="no such file"):
        recover(tmp_path / "nothing")
