"""hippomat-logs doctor: each fault is named, and only a log that is whole and complete is sound."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from log_samples import CONFIG, START_NS, new_recorder
from recorded_data import data_folder
from recorded_run import recorded_log

from hippomat_core import messages as m
from hippomat_core.config import LogConfig
from hippomat_core.errors import HippomatError, LogError
from hippomat_logs import examination
from hippomat_logs.cli import main
from hippomat_logs.examination import DAMAGE, LOSS, REMARK, Examination, examine
from hippomat_logs.reader import open_runs
from hippomat_logs.recovery import recover_directory
from hippomat_logs.schema import DERIVED


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded_log(tmp_path_factory.mktemp("whole"), ticks=20)


def test_a_whole_log_is_sound(whole: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert examine(whole).faults == {}
    assert main(["doctor", str(whole)]) == 0
    assert "1 of 1 files are sound" in capsys.readouterr().out


def test_doctor_and_info_count_the_same_messages(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fused = tmp_path / "fused.mcap"
    assert main(["fuse", str(whole), "-o", str(fused)]) == 0
    for path in (whole, fused):
        capsys.readouterr()
        assert main(["info", "--json", str(path)]) == 0
        topics = json.loads(capsys.readouterr().out)["runs"][0]["topics"]
        views = sum(topic["messages"] for name, topic in topics.items() if name in DERIVED)
        total = sum(topic["messages"] for topic in topics.values())
        assert main(["info", str(path)]) == 0
        assert f", {total:,} messages" in capsys.readouterr().out
        assert main(["doctor", str(path)]) == 0
        said = " ".join(capsys.readouterr().out.split())
        assert f"{total:,} messages examined: {total - views:,} records and {views:,} views" in said
        assert main(["doctor", "--json", str(path)]) == 0
        (file,) = json.loads(capsys.readouterr().out)["files"]
        assert (file["messages"], file["views"]) == (total, views)
        assert views > 0


FAULTS: list[tuple[str, Callable[[bytes], bytes], str, str]] = [
    ("cut", lambda data: data[:-3000], DAMAGE, "cut short or damaged"),
    ("footer", lambda data: flipped(data, len(data) - 20), DAMAGE, "footer"),
    ("chunk", lambda data: flipped(data, data.find(b"zstd") + 400), DAMAGE, "chunk at byte"),
    (
        "chunk too",
        lambda data: flipped(data, data.find(b"zstd") + 400),
        DAMAGE,
        "data-section checksum wrong",
    ),
    ("manifest", lambda data: flipped(data, data.find(b"core_hash") + 20), DAMAGE, "metadata hippomat.run"),
    ("empty", lambda _: b"", LOSS, "is empty"),
    ("no head", lambda data: bytes(8) + data[8:], DAMAGE, "magic bytes"),
]


@pytest.mark.parametrize(("name", "hurt", "kind", "said"), FAULTS, ids=[name for name, *_ in FAULTS])
def test_damage_is_named(
    whole: Path, tmp_path: Path, name: str, hurt: Callable[[bytes], bytes], kind: str, said: str
) -> None:
    path = tmp_path / f"{name.replace(' ', '_')}.mcap"
    path.write_bytes(hurt(whole.read_bytes()))
    found = examine(path)
    assert not found.sound
    assert any(said in text for of_kind, text in found.faults if of_kind == kind), found.faults
    assert main(["doctor", str(path)]) == 3


def flipped(data: bytes, at: int) -> bytes:
    return data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :]


def texts(found: Examination, kind: str) -> str:
    return "; ".join(text for of_kind, text in found.faults if of_kind == kind)


def test_an_unfinished_log_is_named_with_its_remedy(tmp_path: Path) -> None:
    recorder = new_recorder(tmp_path)
    recorder.put(START_NS, m.Tick(START_NS))
    (path,) = tmp_path.glob("*.active")
    wait_until(lambda: path.stat().st_size > 8000)
    assert "being recorded by a live process" in texts(examine(path), LOSS)
    copy = tmp_path / "x_000.mcap.active"
    copy.write_bytes(path.read_bytes())
    assert "its daemon died: `hippomat-logs recover" in texts(examine(copy), LOSS)
    recorder.close()
    recover_directory(tmp_path)
    assert "its last moments are missing" in texts(examine(tmp_path / "x_000.mcap"), LOSS)


def wait_until(done: Callable[[], bool]) -> None:
    until_s = time.monotonic() + 30.0
    while not done() and time.monotonic() < until_s:
        time.sleep(0.02)


def test_explained_losses_and_stalls_are_told_apart(tmp_path: Path) -> None:
    recorder = new_recorder(tmp_path, queue_records=50)
    for k in range(120):
        recorder.put(START_NS + k * 50_000_000, m.Tick(START_NS + k * 50_000_000))
    time.sleep(0.6)  # the queue is empty again
    recorder.put(START_NS + 100 * 10**9, m.Tick(START_NS + 100 * 10**9))
    recorder.put(START_NS, m.Tick(START_NS))
    recorder.close()
    (path,) = tmp_path.glob("*.mcap")
    found = examine(path)
    assert "lost: queue full: the disk was too slow" in texts(found, LOSS)
    assert "the loop stood still for" in texts(found, REMARK)
    assert "log time goes back by" in texts(found, REMARK)
    assert texts(found, DAMAGE) == ""


def test_a_missing_part_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = dataclasses.replace(CONFIG, log=LogConfig(part_s=0.001, expected_min=0.0))
    recorder = new_recorder(tmp_path, lossless=True, config=config)
    for number in range(3):
        recorder.put(START_NS + number, m.Tick(START_NS + number))
        wait_until(lambda number=number: len(list(tmp_path.glob("*.mcap"))) > number)  # type: ignore[misc]
    recorder.close()
    parts = sorted(tmp_path.glob("*.mcap"))
    assert len(parts) >= 3
    assert main(["doctor", str(tmp_path)]) == 0
    parts[1].unlink()
    assert main(["doctor", str(tmp_path)]) == 3
    assert "part 1 is missing" in capsys.readouterr().out
    assert main(["doctor", str(parts[0])]) == 3
    assert "parts behind" in capsys.readouterr().out


def test_bytes_that_a_tool_laundered_are_found_by_their_own_checksum(tmp_path: Path) -> None:
    """A repair tool recomputes the file's checksums; the one inside of each serial record tells on it."""
    from hippomat_logs.log_writer import writing
    from hippomat_logs.mcap_file import RawRow
    from hippomat_logs.part import RUN_METADATA
    from hippomat_logs.sources import McapSource

    path = recorded_log(tmp_path / "run", ticks=5)
    source = McapSource(path)
    with writing(tmp_path / "laundered.mcap") as writer:
        writer.facts(RUN_METADATA, source.file.metadata[RUN_METADATA])
        for row in source.rows():
            data = bytearray(row.data)
            if source.streams[row.channel].topic == "/hippo/serial":
                data[-1] ^= 1
            writer.write(source, RawRow(row.channel, row.sequence, row.log_time_ns, bytes(data)))
        writer.finish()
    assert "serial bytes do not match the checksum taken with them" in texts(
        examine(tmp_path / "laundered.mcap"), DAMAGE
    )


def test_logs_of_others_are_examined_channel_by_channel(capsys: pytest.CaptureFixture[str]) -> None:
    bags = data_folder() / "bags"
    assert main(["doctor", "--json", str(bags)]) == 3
    found: dict[str, Any] = {
        Path(one["file"]).name: one for one in json.loads(capsys.readouterr().out)["files"]
    }
    assert [name for name, one in found.items() if not one["sound"]] == [
        "empty-file.bag",
        "topics_and_services.mcap",
    ]
    assert found["tilt_laser.bag"]["messages"] == 4093
    assert "/add_two_ints/_service_event" in str(found["topics_and_services.mcap"]["faults"])


def test_info_goes_on_where_one_log_is_broken(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "good.mcap").write_bytes(whole.read_bytes())
    (tmp_path / "cut.mcap").write_bytes(whole.read_bytes()[:-50])
    (tmp_path / "empty.bag").write_bytes(b"")
    assert main(["info", str(tmp_path)]) == 3
    said = capsys.readouterr().out
    assert "finished; recorded by hippomat" in said
    assert "cut.mcap: is cut short or damaged" in said.replace("\n", " ")
    assert "empty.bag: is empty" in said
    assert main(["info", "--json", str(whole)]) == 0
    facts = json.loads(capsys.readouterr().out)["runs"][0]
    assert facts["topics"]["/hippo/event/tick"]["messages"] == 20
    assert np.isclose(facts["seconds"], 0.96, atol=0.1)


def test_a_log_of_somebody_else_is_called_that_and_not_damaged():
    bag = data_folder() / "bags" / "talker.mcap"
    with pytest.raises(HippomatError, match="is no log of a hippomat daemon") as raised:
        open_runs([bag])
    assert not isinstance(raised.value, LogError)


def test_it_says_how_far_it_is_inside_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = recorded_log(tmp_path, ticks=40)
    monkeypatch.setattr(examination, "TOLD_EVERY", 20)
    shares: list[float] = []
    assert examine(path, shares.append).sound
    assert len(shares) > 5
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] <= shares[-1] <= 1.0
