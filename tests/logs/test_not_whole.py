"""A log that lacks records, or its end: what it holds is used, every tool says so alike, and ends with 3."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest
from mcap.reader import make_reader

from hippomat_logs.cli import main as logs
from hippomat_logs.log_writer import whole_file
from hippomat_logs.part import END_METADATA, PartWriter
from hippomat_logs.reader import open_runs, read_raw
from hippomat_logs.recovery import recover
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.replay_cli import main as replay
from hippomat_logs.walk import Contents

GOLDEN = Path(__file__).parent.parent / "golden" / "runs" / "three_wheels"
OFFLINE = ("L0", "L1", "L2")


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fleet's logs, of which robot 2's ends early: its daemon died."""
    directory = tmp_path_factory.mktemp("cut")
    shutil.copytree(GOLDEN, directory, dirs_exist_ok=True)
    whole = directory / "robot02.mcap"
    data = whole.read_bytes()
    whole.unlink()
    (directory / "robot02.mcap.active").write_bytes(data[: len(data) * 2 // 3])
    recover(directory)
    return directory


def write_in_chunks(golden: Path, path: Path) -> None:
    """The same log in many chunks, as a recorder writes it; kept ones are one large chunk."""
    contents = Contents()
    messages = list(read_raw(golden, contents))
    with whole_file(path) as sink:
        channels = list(contents.channels.values())
        part = PartWriter(sink, contents.manifest, channels, contents.attachments)
        for index, raw in enumerate(messages):
            part.add(raw.topic, raw.number, raw.log_time_ns, raw.data)
            if index % 500 == 499:
                part.flush()
        part.finish(END_METADATA, contents.end)


@pytest.fixture(scope="module")
def holed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Robot 1's log with a chunk damaged in its course, recovered."""
    directory = tmp_path_factory.mktemp("holed")
    broken = directory / "robot01.mcap"
    write_in_chunks(GOLDEN / "robot01.mcap", broken)
    data = bytearray(broken.read_bytes())
    with broken.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunks = summary.chunk_indexes
    data[chunks[len(chunks) // 2].chunk_start_offset + 200] ^= 0x10
    broken.write_bytes(data)
    recover(broken)
    return directory


def test_replay_reproduces_what_a_cut_log_holds_and_ends_with_3(
    cut: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert replay([str(cut), "--levels", "L0,L1,L2"]) == 3
    out = capsys.readouterr().out
    assert "robot02: reproduced L1 L2 of a log that is not whole" in out
    assert "robot01: reproduced L0 L1 L2\n" in out
    assert "its last moments are missing" in " ".join(out.split())


def test_replay_goes_up_to_the_first_lost_record(holed: Path) -> None:
    (run,) = open_runs([holed])
    report = replay_run(run, ReplayOptions(levels=(*OFFLINE, "daemon", "L3")))
    by_level = {result.level: result for result in report.results}
    assert by_level["L0"].status == "not whole"
    assert "the chunk that held them is damaged" in by_level["L0"].detail
    assert by_level["L1"].status == by_level["L2"].status == "reproduced"
    assert by_level["L1"].compared > 10_000
    assert 20 < by_level["L2"].compared < 150  # of 161 decisions
    assert "compared up to the first lost record" in by_level["L2"].notes
    assert by_level["daemon"].status == by_level["L3"].status == "not run"
    assert report.exit_code == 3


@pytest.mark.parametrize(
    "command",
    [
        ["doctor"],
        ["metrics"],
        ["metrics", "--by", "robots"],
        ["conflicts"],
        ["explain", "--robot", "0", "--time", "8"],
        ["fuse"],
        ["fuse", "-o", "OUT.mcap"],
        ["report", "-o", "OUT.html"],
    ],
)
def test_every_tool_says_which_log_is_not_whole_and_ends_with_3(
    cut: Path, tmp_path: Path, command: Sequence[str], capsys: pytest.CaptureFixture[str]
) -> None:
    if command[0] == "report":
        pytest.importorskip("bokeh")
    arguments = [one.replace("OUT", str(tmp_path / "run")) for one in command[1:]]
    assert logs([command[0], str(cut), *arguments]) == 3
    said = capsys.readouterr()
    text = " ".join((said.out + said.err).split())
    if command[0] != "doctor":
        whose = "robot02" if command[0] == "fuse" else "robot 2"
        assert f"log of {whose} is not whole" in text
        assert text.count("is not whole") == 1
    assert "recovered after a crash: its last moments are missing" in text


def test_json_has_it_too(cut: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert logs(["metrics", str(cut), "--json"]) == 3
    line = "log of robot 2 is not whole: recovered after a crash: its last moments are missing"
    assert json.loads(capsys.readouterr().out)["not_whole"] == [line]


def test_no_clip_of_a_log_that_is_not_whole_is_not_all_is_well(
    holed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert replay([str(holed), "--clip", str(tmp_path / "clip.mcap")]) == 3
    out = capsys.readouterr().out
    assert "there is no divergence to clip" in out
    assert "is not whole: records" in out
