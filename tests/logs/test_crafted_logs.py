"""Files whose checksums are right and whose contents are not: every reader says so, and none breaks."""

from __future__ import annotations

from pathlib import Path

import lz4.frame
import pytest
import zstandard
from crafted_log import Crafter, chunk_of, inside_of, whole
from log_samples import CONFIG, START_NS, new_recorder

from hippomat_core import messages as m
from hippomat_core.errors import HippomatError, LogError
from hippomat_logs.examination import REMARK, between_parts, examine
from hippomat_logs.lenient_walk import walk_leniently
from hippomat_logs.mcap_file import decompress, open_mcap
from hippomat_logs.mcap_writer import CHUNK
from hippomat_logs.reader import open_runs, reading_store
from hippomat_logs.recovery import lenient_contents, recover
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.report import OK

SEEDS = 200
# doctor remarks on these, and replay wants that version, or the whole run
REMARKED = ("has other fields", "a selection of a run")


@pytest.fixture(scope="module")
def crafter(tmp_path_factory: pytest.TempPathFactory) -> Crafter:
    directory = tmp_path_factory.mktemp("crafted")
    recorder = new_recorder(directory, CONFIG)
    for k in range(30):
        recorder.put(START_NS + k * 1000, m.Tick(START_NS + k * 1000))
        recorder.serial(START_NS + k * 1000, m.BASE, 0, 1, b"abcdef")
    recorder.close()
    (log,) = directory.glob("*.mcap")
    return Crafter(log.read_bytes())


def replays(path: Path) -> bool:
    """Is it whole at L0? Raises LogError or HippomatError as a command would."""
    reports = [replay_run(run, ReplayOptions(levels=("L0", "L1", "L2"))) for run in open_runs([path])]
    return all(report.results[0].level == "L0" and report.results[0].status == OK for report in reports)


def test_what_is_crafted_is_refused_by_name_or_replayed_and_doctor_agrees(
    crafter: Crafter, tmp_path: Path
) -> None:
    refused = sound = unnamed = 0
    for seed in range(SEEDS):
        path = tmp_path / f"{seed}.mcap"
        path.write_bytes(crafter.crafted(seed))
        examined = examine(path)
        remarks = " ".join(text for kind, text in examined.faults if kind == REMARK)
        try:
            good = replays(path)
        except HippomatError as error:
            good, refused, unnamed = False, refused + 1, unnamed + (path.name not in str(error))
        usable = not any(remark in remarks for remark in REMARKED)
        if examined.sound and not between_parts([examined]) and usable:
            assert good, (seed, examined.faults)
            sound += 1
        try:
            recover(path)
        except HippomatError as error:
            unnamed += path.name not in str(error)
    assert not unnamed
    assert refused > SEEDS / 4  # both sides of the law were tried
    assert sound > SEEDS / 20


def bomb(crafter: Crafter, stated: int, indexed: bool = True) -> bytes:
    """A log with a chunk whose frame states more than its chunk does."""
    data = list(crafter.data)
    at = next(k for k, (opcode, _) in enumerate(data) if opcode == CHUNK)
    body = data[at][1]
    data[at] = CHUNK, chunk_of(body, inside_of(body), zstandard.ZstdCompressor().compress(bytes(stated)))
    return whole(data, crafter.summary if indexed else [])


def test_a_chunk_whose_frame_states_more_than_it_is_refused_before_it_is_inflated(
    crafter: Crafter, tmp_path: Path
) -> None:
    path = tmp_path / "bomb.mcap"
    path.write_bytes(bomb(crafter, 64 << 20))
    with pytest.raises(LogError, match=r"bomb.mcap: chunk at byte \d+: its zstd frame states 67108864 bytes"):
        open_runs([path])
    contents = lenient_contents(reading_store())
    assert list(walk_leniently(memoryview(path.read_bytes()), contents)) == []
    assert "states 67108864 bytes" in contents.damage[0]
    path.write_bytes(bomb(crafter, 64 << 20, indexed=False))
    with pytest.raises(LogError, match=r"bomb.mcap: chunk at byte \d+ .*states 67108864 bytes"):
        open_mcap(path)


def test_a_frame_that_states_no_size_gives_no_more_than_its_chunk_does() -> None:
    streamed = zstandard.ZstdCompressor().compressobj()
    data = streamed.compress(bytes(1 << 20)) + streamed.flush()
    assert decompress("zstd", data, 1 << 20) == bytes(1 << 20)
    with pytest.raises(zstandard.ZstdError):
        decompress("zstd", data, 1000)
    assert len(decompress("lz4", lz4.frame.compress(bytes(1 << 20)), 1000)) == 1001


def test_a_cut_chunk_gives_no_more_than_its_head_states(crafter: Crafter) -> None:
    cut = bomb(crafter, 64 << 20)
    at = cut.index(b"\x04\0\0\0zstd")
    contents = lenient_contents(reading_store())
    assert list(walk_leniently(memoryview(cut[: at + 1000]), contents)) == []
    assert contents.messages == 0
