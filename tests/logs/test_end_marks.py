"""The end mark of a damaged log outlives its recovery: it lacks its bad chunks, and not its end."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from log_samples import CONFIG, START_NS, WALL_NS

from hippomat_core import messages as m
from hippomat_logs.cli import main as logs
from hippomat_logs.examination import LOSS, REMARK, examine
from hippomat_logs.manifest import run_manifest
from hippomat_logs.mcap_writer import CHUNK, MAGIC, METADATA
from hippomat_logs.part import facts_crc32
from hippomat_logs.parts import Encoded, PartSeries
from hippomat_logs.reader import Run, open_runs, read_raw, read_records, reading_store
from hippomat_logs.records import DropRecord
from hippomat_logs.recovery import recover
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.schema import TOPICS
from hippomat_logs.shortfalls import ENDED_EARLY, shortfalls
from hippomat_logs.sink import file_sinks
from hippomat_logs.walk import Contents, records

CHUNKS, IN_EACH = 5, 4
LAST = CHUNKS * IN_EACH
MANIFEST = {
    **run_manifest(CONFIG, session_id="5e551011"),
    "wall_offset_ns": str(WALL_NS - START_NS),
    "started_ns": str(START_NS),
}


def write_ticks(directory: Path, part_bytes: int = 1 << 20) -> list[Path]:
    """A finished log of ticks 1 .. LAST, so many in each chunk; its parts."""
    store = reading_store()
    series = PartSeries(file_sinks(directory), "robot02", MANIFEST, store, part_bytes)
    series.open()
    for chunk in range(CHUNKS):
        for number in range(chunk * IN_EACH + 1, (chunk + 1) * IN_EACH + 1):
            tick = m.Tick(START_NS + number)
            series.add(Encoded(TOPICS[m.Tick], number, WALL_NS + number, store.encode(tick)), float(number))
        series.flush(float(chunk + 1) * IN_EACH)
    series.close(100.0, {"shed": "0", "worst_sync_ms": "7"})
    return sorted(directory.glob("*.mcap"))


def places(data: bytes, opcode: int) -> list[int]:
    """First bytes of these records."""
    at, found = len(MAGIC), []
    for kind, _, behind in records(memoryview(data), at, len(data) - len(MAGIC)):
        if kind == opcode:
            found.append(at)
        at = behind
    return found


def broken_contents(data: bytearray, chunk: int) -> None:
    """chunk: counted from 1."""
    data[places(bytes(data), CHUNK)[chunk - 1] + 60] ^= 0x10


def broken_length(data: bytearray, chunk: int) -> None:
    """Of both its record and its contents."""
    at = places(bytes(data), CHUNK)[chunk - 1]
    data[at + 8] ^= 0x10
    data[at + 60] ^= 0x10


def broken_summary(data: bytearray) -> None:
    data[-40] ^= 1


def recovered(path: Path, hurt: Callable[[bytearray], None]) -> Run:
    data = bytearray(path.read_bytes())
    hurt(data)
    path.write_bytes(data)
    recover(path)
    (run,) = open_runs([path.parent])
    return run


def kept_and_named(run: Run) -> tuple[list[int], list[tuple[int, int]]]:
    kept, named = [], []
    for record in run.records_in_order():
        if isinstance(record.message, DropRecord):
            named.append((record.message.first, record.message.last))
        else:
            kept.append(record.number)
    return kept, named


@pytest.mark.parametrize("hurt", [broken_contents, broken_length])
@pytest.mark.parametrize("chunk", range(1, CHUNKS + 1))
def test_a_log_with_a_bad_chunk_lacks_that_chunks_records_and_not_its_end(
    tmp_path: Path, hurt: Callable[[bytearray, int], None], chunk: int, capsys: pytest.CaptureFixture[str]
) -> None:
    (path,) = write_ticks(tmp_path)
    run = recovered(path, lambda data: hurt(data, chunk))
    first, last = (chunk - 1) * IN_EACH + 1, chunk * IN_EACH
    kept, named = kept_and_named(run)
    assert named == [(first, last)]
    assert kept == [number for number in range(1, LAST + 1) if not first <= number <= last]
    lost = f"records {first}..{last} lost: the chunk that held them is damaged"
    assert shortfalls(run) == [lost]
    level = replay_run(run, ReplayOptions(levels=("L0",))).results[0]
    assert (level.status, level.detail, level.notes) == ("not whole", lost, [])
    faults = examine(path).faults
    assert [text for kind, text in faults if kind == LOSS] == [lost]
    assert any(text.startswith("when it was recovered: ") for kind, text in faults if kind == REMARK)
    assert logs(["info", str(path), "--json"]) == 3
    (told,) = json.loads(capsys.readouterr().out)["runs"]
    assert told["state"]["text"].startswith("finished; when it was recovered: ")
    assert told["state"]["worst_sync_ms"] == 7


def test_all_records_can_be_lost_and_the_end_mark_still_tells_how_many_they_were(tmp_path: Path) -> None:
    (path,) = write_ticks(tmp_path)

    def broken_chunks(data: bytearray) -> None:
        for chunk in range(1, CHUNKS + 1):
            broken_contents(data, chunk)

    run = recovered(path, broken_chunks)
    assert kept_and_named(run) == ([], [(1, LAST)])
    assert [record[1] for record in read_records(path)] == [WALL_NS]


def test_damage_that_costs_no_record_leaves_a_whole_log(tmp_path: Path) -> None:
    (path,) = write_ticks(tmp_path)
    run = recovered(path, broken_summary)
    assert kept_and_named(run) == (list(range(1, LAST + 1)), [])
    assert shortfalls(run) == []
    assert examine(path).sound
    assert logs(["info", str(path)]) == 0


def end_mark(data: bytearray) -> int:
    return places(bytes(data), METADATA)[-1]


def damaged_mark(data: bytearray) -> None:
    data[data.index(b"last_record", end_mark(data)) + 15] ^= 1


def mark_without_checksum(data: bytearray) -> None:
    data[data.index(b"crc32", end_mark(data))] ^= 1


def cut_before_mark(data: bytearray) -> None:
    del data[end_mark(data) :]


@pytest.mark.parametrize("hurt", [damaged_mark, mark_without_checksum, cut_before_mark])
def test_a_log_whose_end_mark_is_lost_lacks_its_end(
    tmp_path: Path, hurt: Callable[[bytearray], None]
) -> None:
    (path,) = write_ticks(tmp_path)
    run = recovered(path, hurt)
    assert kept_and_named(run) == (list(range(1, LAST + 1)), [])
    assert shortfalls(run) == [ENDED_EARLY]
    assert (LOSS, ENDED_EARLY) in examine(path).faults


def test_an_end_mark_that_contradicts_the_records_is_not_believed(tmp_path: Path) -> None:
    (path,) = write_ticks(tmp_path)
    contents = Contents()
    list(read_raw(path, contents))
    lower = {**contents.end, "last_record": "10"}

    def lowered_mark(data: bytearray) -> None:
        at = end_mark(data)
        number, checksum = data.index(b"last_record", at) + 15, data.index(b"crc32", at) + 9
        data[number : number + 2] = b"10"
        data[checksum : checksum + 8] = facts_crc32(lower).encode()

    run = recovered(path, lowered_mark)
    assert kept_and_named(run) == (list(range(1, LAST + 1)), [])
    assert shortfalls(run) == [ENDED_EARLY]


def test_a_bad_chunk_at_the_end_of_a_part_does_not_hide_the_parts_behind_it(tmp_path: Path) -> None:
    parts = write_ticks(tmp_path, part_bytes=1)
    assert len(parts) >= CHUNKS
    run = recovered(parts[1], lambda data: broken_contents(data, 1))
    kept, named = kept_and_named(run)
    assert named == [(IN_EACH + 1, 2 * IN_EACH)]
    assert len(kept) == LAST - IN_EACH
    assert not run.recovered
    run = recovered(parts[2], lambda data: broken_length(data, 1))
    assert kept_and_named(run)[1] == [(IN_EACH + 1, 2 * IN_EACH), (2 * IN_EACH + 1, 3 * IN_EACH)]


def test_a_fused_file_and_a_selection_say_of_such_a_log_what_it_says_itself(tmp_path: Path) -> None:
    (path,) = write_ticks(tmp_path / "runs")
    recovered(path, lambda data: broken_contents(data, 2))
    assert logs(["fuse", str(path), "-o", str(tmp_path / "fused.mcap")]) == 3
    (fused,) = open_runs([tmp_path / "fused.mcap"])
    assert kept_and_named(fused)[1] == [(IN_EACH + 1, 2 * IN_EACH)]
    assert not fused.recovered
    assert logs(["info", str(tmp_path / "fused.mcap")]) == 3
    assert logs(["filter", str(path), "-o", str(tmp_path / "some.mcap"), "--topics", "/hippo/*"]) == 0
    assert (LOSS, ENDED_EARLY) not in examine(tmp_path / "some.mcap").faults


def test_a_recovered_log_is_recovered_again_and_keeps_its_end(tmp_path: Path) -> None:
    (path,) = write_ticks(tmp_path)
    recovered(path, lambda data: broken_contents(data, 2))
    path.with_name(path.name + ".damaged").unlink()
    whole = path.read_bytes()
    run = recovered(path, broken_summary)
    assert path.read_bytes() != whole
    assert kept_and_named(run)[1] == [(IN_EACH + 1, 2 * IN_EACH)]
    assert not run.recovered
