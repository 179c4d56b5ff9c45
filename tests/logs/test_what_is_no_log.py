"""Every command on everything that a path may be: the same answer everywhere, one line, no traceback."""

from __future__ import annotations

import os
import sqlite3
from pathlib import Path

import pytest
from recorded_data import data_folder
from recorded_run import record_run

from hippomat_logs import cli, replay_cli
from hippomat_logs.file_kinds import Kind, kind_of
from hippomat_logs.log_writer import writing

# what needs a robot's own records, and what takes any log
OWN = {
    "metrics": ["metrics", "{log}"],
    "conflicts": ["conflicts", "{log}"],
    "explain": ["explain", "{log}", "--task", "1"],
    "report": ["report", "{log}", "-o", "{out}.html"],
    "fuse": ["fuse", "{log}", "-o", "{out}.mcap"],
    "map": ["map", "{log}", "-o", "{out}.yaml"],
    "recover": ["recover", "{log}"],
    "replay": ["{log}", "--levels", "L0"],
    "clip": ["{log}", "--clip", "{out}.mcap"],
}
ANY = {
    "info": ["info", "{log}"],
    "doctor": ["doctor", "{log}"],
    "filter": ["filter", "{log}", "-o", "{out}.mcap"],
    "merge": ["merge", "{log}", "-o", "{out}.mcap"],
    "convert": ["convert", "{log}", "{out}.mcap"],
    "export": ["export", "{log}", "-o", "{out}"],
    "plot": ["plot", "{log}", "-o", "{out}.png"],
}
ALL = {**OWN, **ANY}
NO_LOGS = {
    "nothere.mcap": "nothere.mcap: no such file or directory",
    "nothere": "nothere: no such file or directory",
    "notes.txt": "notes.txt: is a text file, no log",
    "notes.mcap": "notes.mcap: is a text file, no log",
    "notes.bag": "notes.bag: is a text file, no log",
    "noise.mcap": "noise.mcap: is a file of unknown kind, no log: give an .mcap, a .bag, a .db3",
    "bag.mcap": "bag.mcap: is a ROS 1 bag: give it a name that ends in .bag",
    "pipe.mcap": "pipe.mcap: is no file but a pipe",
}
FOREIGN = {
    "real.bag": "real.bag: is no log of a hippomat daemon, but a ROS 1 bag; `hippomat-logs info`, plot",
    "real.db3": "real.db3: is no log of a hippomat daemon, but the database of a ROS 2 bag",
    "other.mcap": "other.mcap: is no log of a hippomat daemon, but an .mcap that something else wrote",
    "merged.mcap": "merged.mcap: is no log of a hippomat daemon, but several logs merged for viewers; here",
    "cut_other.mcap": "cut_other.mcap: is no log of a hippomat daemon",
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One of each; read-only."""
    made, bags = tmp_path_factory.mktemp("files"), data_folder() / "bags"
    for name in ("notes.txt", "notes.mcap", "notes.bag"):
        (made / name).write_text("a note on hippomat.run, written in Zürich\n")
    (made / "noise.mcap").write_bytes(bytes(range(256)) * 40)
    (made / "bag.mcap").write_bytes((bags / "example-lz4.bag").read_bytes())
    os.mkfifo(made / "pipe.mcap")
    (made / "real.bag").write_bytes((bags / "example-lz4.bag").read_bytes())
    with sqlite3.connect(made / "real.db3") as database:
        database.execute("create table messages (id integer)")
    other = (bags / "talker.mcap").read_bytes()
    (made / "other.mcap").write_bytes(other)
    (made / "cut_other.mcap").write_bytes(other[: len(other) // 2])
    (made / "empty_dir").mkdir()
    record_run(made / "run", ticks=10)
    (run,) = (made / "run").glob("*.mcap")
    data = run.read_bytes()
    (made / "cut.mcap").write_bytes(data[:-40])
    (made / "headless.mcap").write_bytes(bytes(8) + data[8:])
    (made / "empty.mcap").write_bytes(b"")
    assert cli.main(["merge", str(run), str(made / "other.mcap"), "-o", str(made / "merged.mcap")]) == 0
    return made


def answer(name: str, log: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """A command's exit code, and all that it said in one line."""
    main = replay_cli.main if name in ("replay", "clip") else cli.main
    capsys.readouterr()
    code = main([word.format(log=log, out=out) for word in ALL[name]])
    captured = capsys.readouterr()
    return code, " ".join((captured.out + captured.err).split())


@pytest.mark.parametrize("name", ALL)
def test_what_is_no_log_is_a_usage_error_everywhere(
    name: str, files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path, said in NO_LOGS.items():
        code, text = answer(name, files / path, tmp_path / "out", capsys)
        assert (code, said in text) == (1, True), (name, path, code, text)
        assert "damaged" not in text
    code, text = answer(name, files / "empty_dir", tmp_path / "out", capsys)
    if name != "recover":
        assert code == 1
        assert "empty_dir: holds no" in text or "empty_dir: is a directory" in text, text
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", OWN)
def test_a_log_of_somebody_else_is_a_usage_error_where_own_records_are_needed(
    name: str, files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path, said in FOREIGN.items():
        code, text = answer(name, files / path, tmp_path / "out", capsys)
        assert (code, said in text) == (1, True), (name, path, code, text)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ALL)
def test_a_damaged_log_of_ours_is_exit_code_3(
    name: str, files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = {"cut.mcap": "cut short or damaged", "headless.mcap": "magic bytes", "empty.mcap": "is empty"}
    if name == "report":  # which shows what is left of a log: one page is enough
        del said["headless.mcap"]
    for path, text in said.items():
        log = tmp_path / path
        log.write_bytes((files / path).read_bytes())
        code, heard = answer(name, log, tmp_path / "out", capsys)
        if name == "recover" and path != "empty.mcap":
            assert (code, "kept" in heard) == (0, True), heard
        else:
            assert (code, text in heard) == (3, True), (name, path, code, heard)


def test_a_directory_shows_its_logs_and_names_what_is_none(
    files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("other.mcap", "notes.mcap"):
        (tmp_path / name).write_bytes((files / name).read_bytes())
    for name in ("info", "doctor"):
        code, text = answer(name, tmp_path, tmp_path / "out", capsys)
        assert code == 1
        assert "notes.mcap: is a text file" in text
        assert "other" in text


def test_a_kind_is_told_by_bytes_and_not_by_the_name(files: Path, tmp_path: Path) -> None:
    (run,) = (files / "run").glob("*.mcap")
    (tmp_path / "a.txt").write_bytes(run.read_bytes())
    assert kind_of(tmp_path / "a.txt") is Kind.OURS
    with writing(tmp_path / "b.mcap") as writer:
        writer.finish()
    assert kind_of(tmp_path / "b.mcap") is Kind.MCAP
    for length in (4, 8, 40, 100):  # cut before its manifest
        (tmp_path / "c.mcap").write_bytes(run.read_bytes()[:length])
        assert kind_of(tmp_path / "c.mcap") is Kind.OURS
    for length in (1, 3):  # too little to be held for anything
        (tmp_path / "c.mcap").write_bytes(run.read_bytes()[:length])
        assert kind_of(tmp_path / "c.mcap") is Kind.OTHER
    (tmp_path / "umlaut.txt").write_bytes(("ü" * 300).encode()[:511])  # cut inside of a letter
    assert kind_of(tmp_path / "umlaut.txt") is Kind.TEXT
