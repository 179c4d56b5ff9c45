"""One rule for every result: asked before the work, nothing of value is overwritten, no place is guessed."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from recorded_run import record_run

from hippomat_logs import cli, replay_cli
from hippomat_logs.log_writer import whole_file
from hippomat_logs.outputs import appearing

DATA = {
    "filter": ["filter", "{log}", "-o", "{out}.mcap"],
    "merge": ["merge", "{log}", "-o", "{out}.mcap"],
    "fuse": ["fuse", "{log}", "-o", "{out}.mcap"],
    "convert": ["convert", "{log}", "{out}.mcap"],
    "to a bag": ["convert", "{log}", "{out}.bag"],
    "to a ROS 2 bag": ["convert", "{log}", "{out}"],
    "map": ["map", "{log}", "-o", "{out}.yaml"],
    "clip": ["replay", "{log}", "--clip", "{out}.mcap"],
    "window": ["replay", "{log}", "--clip", "{out}.mcap", "--at", "0.2"],
}
DRAWN = {
    "fuse --plot": ["fuse", "{log}", "--plot", "{out}.png"],
    "conflicts": ["conflicts", "{log}", "-o", "{out}.png"],
    "map --picture": ["map", "{log}", "-o", "{dir}/new.yaml", "--picture", "{out}.png"],
    "plot": ["plot", "{log}", "-o", "{out}.png"],
    "report": ["report", "{log}", "-o", "{out}.html"],
}
FILES = {**DATA, **DRAWN}
DIRECTORIES = {
    "export": ["export", "{log}", "-o", "{out}"],
    "filter": ["filter", "{log}", "-o", "{out}"],
    "plot": ["plot", "{log}", "-o", "{out}"],
    "pictures of L3": ["replay", "{log}", "--levels", "L3", "-o", "{out}"],
}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Too short to be worth any work: what is refused is refused before it would show."""
    record_run(made := tmp_path_factory.mktemp("run"), ticks=20)
    (path,) = made.glob("*.mcap")
    return path


def answer(words: list[str], log: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """The exit code, and all that was said in one line."""
    capsys.readouterr()
    given = [word.format(log=log, out=out, dir=log.parent) for word in words]
    code = replay_cli.main(given[1:]) if given[0] == "replay" else cli.main(given)
    captured = capsys.readouterr()
    return code, " ".join((captured.out + captured.err).split())


UNREAD = Path("/nowhere/run.mcap")  # whoever complains of it has begun its work too early


@pytest.mark.parametrize("name", FILES)
def test_a_missing_directory_is_named_before_a_log_is_opened(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "no" / "x"
    code, said = answer(FILES[name], UNREAD, out, capsys)
    if name == "plot":  # -o may be a directory: which of both, the number of runs says
        assert (code, "no such file" in said) == (1, True)
        return
    if name == "map --picture":
        assert (code, "there is no directory" in said) == (1, True), said
        return
    assert (code, f"there is no directory {tmp_path / 'no'}" in said) == (1, True), said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", DATA)
def test_data_is_never_overwritten(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = Path(DATA[name][2 if "convert" in DATA[name] else 3].format(out=tmp_path / "x"))
    path.write_text("precious")
    code, said = answer(DATA[name], UNREAD, tmp_path / "x", capsys)
    assert (code, f"{path} exists already" in said) == (1, True), said
    assert path.read_text() == "precious"


@pytest.mark.parametrize("name", ["plot", "conflicts"])
def test_pictures_and_pages_are_drawn_anew(
    name: str, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.png"
    path.write_text("old")
    code, said = answer(DRAWN[name], log, tmp_path / "x", capsys)
    assert (code, path.read_bytes() != b"old") == (0, True), said


@pytest.mark.parametrize("name", ["fuse --plot", "report", "conflicts"])
def test_a_directory_in_the_place_of_a_picture_is_named(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / ("x.html" if name == "report" else "x.png")).mkdir()
    code, said = answer(DRAWN[name], UNREAD, tmp_path / "x", capsys)
    assert (code, "is a directory; choose another name" in said) == (1, True), said


def test_where_nobody_heard_anybody_no_picture_is_promised(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = answer(DRAWN["fuse --plot"], log, tmp_path / "x", capsys)
    assert (code, "no picture: no robot's log says" in said) == (0, True), said


@pytest.mark.parametrize("name", DIRECTORIES)
def test_a_directory_for_results_is_made_and_a_file_in_its_place_is_named(
    name: str, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("precious")
    for out in (tmp_path / "file", tmp_path / "file" / "deeper"):
        code, said = answer(DIRECTORIES[name], log, out, capsys)
        assert (code, "is a file; a directory for the results is needed" in said) == (1, True), said
    code, said = answer(DIRECTORIES[name], log, tmp_path / "new" / "deeper", capsys)
    assert code == 0, said


def test_a_second_export_stops_before_its_first_file(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = DIRECTORIES["export"]
    assert answer([*words, "--topics", "/odom"], log, tmp_path / "x", capsys)[0] == 0
    before = sorted(tmp_path.rglob("*"))
    code, said = answer(words, log, tmp_path / "x", capsys)
    assert (code, "odom.csv exists already" in said) == (1, True)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_log_is_never_written_onto_itself(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = log.read_bytes()
    (tmp_path / "link.mcap").symlink_to(log)
    for out in (log.with_suffix(""), tmp_path / "link"):
        for name in ("filter", "merge", "fuse", "convert", "clip"):
            assert answer(DATA[name], log, out, capsys)[0] == 1
    assert log.read_bytes() == data


def test_a_directory_that_is_there_takes_one_file_per_run(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = log.name.rsplit("_", 1)[0]
    for name in ("filter", "plot"):
        assert answer(DIRECTORIES[name], log, tmp_path, capsys)[0] == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{run}.filtered.mcap", f"{run}.png"]


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is forbidden to root")
def test_a_place_that_may_not_be_written_is_named(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tmp_path.chmod(0o500)
    code, said = answer(DATA["filter"], log, tmp_path / "x", capsys)
    assert (code, "nothing may be written in" in said) == (1, True), said


def test_two_that_write_the_same_name_do_not_write_into_one_file(tmp_path: Path) -> None:
    precious = tmp_path / "x.mcap.partial"
    precious.write_text("a user's own file")
    first, second = whole_file(tmp_path / "x.mcap"), whole_file(tmp_path / "x.mcap")
    sink = first.__enter__()
    with pytest.raises(FileExistsError):  # of one process; of two, each has its own
        second.__enter__()
    sink.write(b"whole")
    sink.finish()
    first.__exit__(None, None, None)
    assert (tmp_path / "x.mcap").read_bytes() == b"whole"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.mcap", precious.name]


def test_a_page_that_cannot_be_written_leaves_the_old_one(tmp_path: Path) -> None:
    page = tmp_path / "r.html"
    page.write_text("yesterday's")
    half = appearing(page)
    half.__enter__().write_text("half")
    error = OSError("full")
    assert not half.__exit__(OSError, error, None)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("r.html", "yesterday's")]
    with appearing(page) as beside:
        beside.write_text("today's")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("r.html", "today's")]


def test_a_file_that_somebody_else_has_made_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    with whole_file(tmp_path / "x.mcap") as sink:
        sink.write(b"late")
        (tmp_path / "x.mcap").write_bytes(b"theirs")
        with pytest.raises(FileExistsError, match="meanwhile"):
            sink.finish()
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("x.mcap", b"theirs")]
