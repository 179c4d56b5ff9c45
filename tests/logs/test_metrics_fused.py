"""A fused file is a trial like its parts: the same runs, the same figures, whatever their clocks said."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from fleet_logs import write_log
from fused_lab import write_fleet

from hippomat_core import messages as m
from hippomat_logs.cli import main
from hippomat_logs.metrics.trials import find_trials


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Logs of three robots with clocks decades apart, and the file that they were fused into."""
    directory = tmp_path_factory.mktemp("fused")
    write_fleet(directory / "logs")
    fused = directory / "fleet.mcap"
    assert main(["fuse", str(directory / "logs"), "-o", str(fused)]) == 0
    return directory / "logs", fused


def figures(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, object]:
    capsys.readouterr()
    assert main(["metrics", *arguments, "--json"]) == 0
    out = capsys.readouterr().out.replace('"name": "fleet"', '"name": "logs"')  # of the trial
    found: dict[str, object] = json.loads(out)
    return found


@pytest.mark.parametrize("more", [[], ["--trust-clocks"], ["--by", "robots"]])
def test_the_figures_are_those_of_its_parts(
    places: tuple[Path, Path], more: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    logs, fused = places
    found = figures(capsys, str(fused), *more)
    assert found == figures(capsys, str(logs), *more)
    assert '"robots": null' not in json.dumps(found)


def test_parts_that_lie_beside_it_are_not_counted_twice(places: tuple[Path, Path]) -> None:
    logs, fused = places
    (trial,) = find_trials([fused.parent]).trials
    assert (trial.robots, len(trial.runs)) == (3, 3)
    assert {run.directory for run in trial.runs} == {logs}


def test_every_fused_file_is_a_trial_that_is_called_as_its_file(
    places: tuple[Path, Path], tmp_path: Path
) -> None:
    write_log(tmp_path / "later", 0, [(0.0, m.Tick(0)), (9.0, m.Tick(0))])
    files = tmp_path / "files"
    files.mkdir()
    (files / "a.mcap").write_bytes(places[1].read_bytes())
    found = find_trials([files, tmp_path / "later"]).trials
    assert [(trial.name, trial.robots) for trial in found] == [("files/a", 3), ("later", 1)]
    (alone,) = find_trials([files / "a.mcap"]).trials
    assert alone.name == "a"


def test_times_are_of_one_clock_although_the_robots_are_decades_apart(
    places: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    for place in places:
        assert main(["metrics", str(place)]) == 0
        out = " ".join(capsys.readouterr().out.split())
        assert "in 8 s" in out
        assert "one clock by the frames they heard of each other" in out


def test_a_fused_file_given_twice_is_one_trial(
    places: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "again.mcap"
    copy.write_bytes(places[1].read_bytes())
    assert len(find_trials([places[1], copy]).trials) == 1
    assert main(["metrics", str(places[1]), str(copy)]) == 0
    assert "counted once" in capsys.readouterr().err


def test_a_robot_without_radio_keeps_its_own_clock_and_the_others_stay_aligned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Their clocks are decades apart, so that wall clocks would show."""
    deaf = frozenset((a, b) for a in range(3) for b in range(3) if 0 in (a, b))
    write_fleet(tmp_path, deaf=deaf)
    assert main(["metrics", str(tmp_path)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "in 8 s" in out
    assert "one clock by the frames they heard of each other, within" in out
    assert "no frames link robot 0 with them: it keeps its own wall clock" in out
    assert "taken for one fleet" not in out
