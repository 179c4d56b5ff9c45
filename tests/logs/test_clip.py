"""A clip is small, can be replayed, and shows the divergence that it was cut out for."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changed_log import change_log
from recorded_run import recorded_log

from hippomat_core import messages as m
from hippomat_logs.clip import find_divergence, write_clip
from hippomat_logs.reader import open_runs
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.replay_cli import main
from hippomat_logs.report import Divergence, RunReport

QUICK = ReplayOptions(levels=("L0", "L1", "L2"))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded_log(tmp_path_factory.mktemp("log"), ticks=60)


def other_cost(number: int) -> Any:
    """A change of the decision of the round-th round."""
    decided = 0

    def change(_: int, message: Any) -> Any:
        nonlocal decided
        if isinstance(message, m.RoundDecided):
            decided += 1
            if decided == number:
                costs = np.array(message.costs)
                costs[2] ^= 1
                return dataclasses.replace(message, costs=costs)
        return message

    return change


def without(number: int, kind: type, instead: Any) -> Any:
    """The number-th message of a kind is another one, or gone."""
    seen = 0

    def change(_: int, message: Any) -> Any:
        nonlocal seen
        seen += isinstance(message, kind)
        return instead if seen == number and isinstance(message, kind) else message

    return change


def replayed(path: Path) -> RunReport:
    (run,) = open_runs([path])
    return replay_run(run, QUICK)


def meaning(report: RunReport) -> tuple[str, str, str]:
    found = report.results[-1].divergence
    assert isinstance(found, Divergence), report.results
    return found.field, repr(found.recorded), repr(found.replayed)


@pytest.mark.parametrize(
    "change",
    [
        other_cost(21),
        without(30, m.PoseEstimated, m.AlarmCleared("nothing")),  # another effect
        without(30, m.PoseEstimated, None),  # one that is missing
        without(30, m.BaseFeedback, m.AlarmCleared("one too many")),
    ],
    ids=["a field", "another effect", "an effect less", "an effect more, an event less"],
)
def test_a_clip_shows_the_same_divergence_with_far_fewer_events(
    log: Path, tmp_path: Path, change: Any
) -> None:
    change_log(log, tmp_path / "changed.mcap", change)
    (run,) = open_runs([tmp_path / "changed.mcap"])
    found = find_divergence(run, exact=True)
    assert found is not None
    kept = write_clip(found, tmp_path / "clip.mcap", exact=True)
    report = replayed(tmp_path / "clip.mcap")
    assert report.exit_code == 2
    assert meaning(report) == meaning(replayed(tmp_path / "changed.mcap"))
    assert kept < len(found.events) / 3  # a pose rests on every motion before it
    (clip,) = open_runs([tmp_path / "clip.mcap"])
    assert run.name in clip.clip
    assert f"{kept} of {len(found.events)} events are kept" in clip.clip
    assert (tmp_path / "clip.mcap").stat().st_size < 50_000


def test_the_fixed_core_reproduces_a_clip(log: Path, tmp_path: Path) -> None:
    """As a kept clip is used: its last event's effects are compared, though no round may be among them."""
    change_log(log, tmp_path / "changed.mcap", without(30, m.Drive, m.Drive(9.0, 0.0, "wrong")))
    (run,) = open_runs([tmp_path / "changed.mcap"])
    found = find_divergence(run, exact=True)
    assert found is not None
    write_clip(found, tmp_path / "clip.mcap", exact=True)
    right = found.divergence.replayed

    def fixed(_: int, message: Any) -> Any:
        return dataclasses.replace(message, v_mps=right) if isinstance(message, m.Drive) else message

    change_log(tmp_path / "clip.mcap", tmp_path / "fixed.mcap", fixed)
    report = replayed(tmp_path / "fixed.mcap")
    assert [(r.level, r.status) for r in report.results][:2] == [("L0", "reproduced"), ("L1", "not run")]


def test_the_command_writes_a_clip_says_what_it_shows_and_ends_with_2(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change_log(log, tmp_path / "changed.mcap", other_cost(9))
    clip = tmp_path / "clip.mcap"
    assert main([str(tmp_path / "changed.mcap"), "--clip", str(clip)]) == 2
    assert "RoundDecided.costs[2]" in " ".join(capsys.readouterr().out.split())
    assert main([str(clip), "--levels", "L0,L2"]) == 2
    assert main([str(clip), "--clip", str(tmp_path / "again.mcap")]) == 1
    assert "is a clip already" in " ".join(capsys.readouterr().err.split())
    assert main([str(tmp_path / "changed.mcap"), "--clip", str(clip)]) == 1
    assert "exists already" in " ".join(capsys.readouterr().err.split())


def test_a_run_that_is_reproduced_has_nothing_to_clip(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(log), "--clip", str(tmp_path / "clip.mcap")]) == 0
    assert "there is no divergence to clip" in " ".join(capsys.readouterr().out.split())
    assert main([str(log), "--clip", str(tmp_path / "clip.mcap"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"clip": None, "not_whole": []}
    assert not (tmp_path / "clip.mcap").exists()


def test_a_window_is_cut_for_looking_and_refused_by_replay_with_what_replays_instead(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    window = tmp_path / "window.mcap"
    assert main([str(log), "--clip", str(window), "--at", "2.5"]) == 0
    assert "for looking at only" in " ".join(capsys.readouterr().out.split())
    assert main([str(window)]) == 1
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    assert "window.mcap: is a selection of a run (seconds 0.5 to 4.5)" in said
    assert "give the log that it was taken from" in said
    assert "`hippomat-replay LOG --clip`" in said
    assert main([str(window), "--json"]) == 1
    (report,) = json.loads(capsys.readouterr().out)
    assert report["results"][0]["status"] == "error"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--at", "3"], "--at goes with --clip"),
        (["--step"], "--step goes with --serve"),
        (["--reason", "x"], "--reason goes with --update-golden"),
        (["--speed", "2"], "--speed goes with --serve"),
        (["--serve", "--speed", "0"], "give a factor above 0"),
        (["--serve", "--clip", "x.mcap"], "--serve and --clip: choose one"),
        (["--update-golden"], "needs --reason"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    log: Path, arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(log), *arguments]) == 1
    assert said in " ".join(capsys.readouterr().err.split())
