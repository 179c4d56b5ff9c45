"""A file counts once, however it is given; a copy of it is named; a file of several runs is weighed once."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from fused_lab import write_fleet

from hippomat_logs import cli, replay_cli


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    write_fleet(tmp_path / "runs", seconds=2.0)
    return tmp_path / "runs"


def told(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    capsys.readouterr()
    assert cli.main(arguments) == 0
    return capsys.readouterr().out


def test_a_run_given_twice_by_name_directory_or_link_counts_once(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = sorted(logs.glob("*.mcap"))[0]
    (tmp_path / "link.mcap").symlink_to(one)
    (tmp_path / "way").symlink_to(logs)
    ways = [[one, one], [one, tmp_path / "link.mcap"], [tmp_path / "way" / one.name, one]]
    for paths in ways:
        (run,) = json.loads(told(["info", "--json", *map(str, paths)], capsys))["runs"]
        assert run["files"] == [str(paths[0])]
        assert run["bytes"] == one.stat().st_size
    assert len(json.loads(told(["info", "--json", str(logs), str(one)], capsys))["runs"]) == 3
    assert "1 of 1 files are sound" in told(["doctor", *map(str, ways[1])], capsys)
    assert "1 of 1" not in told(["doctor", str(logs), str(tmp_path / "way")], capsys)
    capsys.readouterr()
    assert replay_cli.main(["--levels", "L0", "--json", *map(str, ways[1])]) == 0
    assert len(json.loads(capsys.readouterr().out)) == 1


def test_a_copy_of_a_part_counts_once_and_a_cut_of_it_is_refused(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = sorted(logs.glob("*.mcap"))[0]
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(one.read_bytes())
    (run,) = json.loads(told(["info", "--json", str(one), str(copy)], capsys))["runs"]
    assert run["files"] == [str(one)] or run["files"] == [str(copy)]
    assert run["bytes"] == one.stat().st_size
    capsys.readouterr()
    assert cli.main(["filter", str(one), "--until", "1", "-o", str(tmp_path / "cut.mcap")]) == 0
    for command in (["plot", "-o", str(tmp_path / "x.png")], ["export", "-o", str(tmp_path / "x")], ["info"]):
        capsys.readouterr()
        assert cli.main([command[0], str(one), str(tmp_path / "cut.mcap"), *command[1:]]) == 1, command
        captured = capsys.readouterr()
        assert "are the same part of one run, and differ" in " ".join((captured.out + captured.err).split())


def test_a_fused_file_is_weighed_once(logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fused = tmp_path / "fleet.mcap"
    told(["fuse", str(logs), "-o", str(fused)], capsys)
    facts = json.loads(told(["info", "--json", str(fused)], capsys))
    assert [run["bytes"] for run in facts["runs"]] == [None] * 3
    (file,) = facts["fused_files"]
    assert (file["bytes"], len(file["runs"])) == (fused.stat().st_size, 3)
    said = told(["info", str(fused)], capsys)
    assert said.count("MiB") == 1
    assert f"{fused}: 3 runs," in said.replace("\n", " ")
