"""The fleet in lockstep: the same run gives the same files, and its logs are logs like any other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lockstep_lab import SECONDS, record, settings

from hippomat_core.messages import ClaimChanged, RoundDecided, StateHeard, Tick
from hippomat_logs.reader import open_runs
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.report import REPRODUCED
from hippomat_sim.cli import main


def files_in(directory: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(directory.rglob("*.mcap"))}


def test_equal_settings_give_equal_logs_byte_for_byte(recorded_fleet: Path, tmp_path: Path) -> None:
    first, again = files_in(recorded_fleet), files_in(record(tmp_path))
    assert len(first) == 3
    assert first == again


def test_another_seed_gives_other_logs(recorded_fleet: Path, tmp_path: Path) -> None:
    other = files_in(record(tmp_path, seed=4, seconds=1.0))
    assert not set(files_in(recorded_fleet).values()) & set(other.values())


def test_runs_that_differ_in_anything_are_different_runs_of_a_robot(
    recorded_fleet: Path, tmp_path: Path
) -> None:
    other = record(tmp_path, seconds=1.0)  # the same seed and settings, but shorter
    runs = open_runs([recorded_fleet, other])
    assert len({run.name for run in runs}) == 6
    assert all(replay_run(run, ReplayOptions(("L0",))).exit_code == REPRODUCED for run in runs)


def test_the_clocks_of_hosts_cannot_be_set_where_there_are_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = settings(tmp_path)
    assert main(["run", "--map", str(made.map_yaml), "--lockstep", "--clock-ppm", "50"]) == 1
    assert "--lockstep has no daemons whose clocks" in capsys.readouterr().err


def test_its_logs_are_reproduced_like_those_of_daemons(recorded_fleet: Path) -> None:
    for run in open_runs([recorded_fleet]):
        report = replay_run(run, ReplayOptions(("L0", "L1", "L2")))
        assert (report.verdict, report.exit_code) == ("reproduced L0 L1 L2", REPRODUCED)


def test_every_robot_ticks_twenty_times_a_second_and_claims_tasks(recorded_fleet: Path) -> None:
    for run in open_runs([recorded_fleet]):
        messages = [record.message for record in run.records_in_order((Tick, ClaimChanged, RoundDecided))]
        ticks = [message for message in messages if isinstance(message, Tick)]
        assert len(ticks) == pytest.approx(20 * SECONDS, abs=1)
        assert {message.stamp_ns - ticks[0].stamp_ns for message in ticks} == {
            k * 50_000_000 for k in range(len(ticks))
        }
        assert any(isinstance(message, ClaimChanged) and message.what == "confirmed" for message in messages)
        rounds = [message.round for message in messages if isinstance(message, RoundDecided)]
        assert len(rounds) == pytest.approx(10 * SECONDS, abs=3)


def test_the_command_says_how_fast_it_was_and_leaves_what_a_run_with_daemons_leaves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = settings(tmp_path)
    options = ["--robots", "2", "--tasks", "3", "--seconds", "1.5", "--no-slam", "--config", str(made.config)]
    out = tmp_path / "run"
    code = main(["run", "--map", str(made.map_yaml), "--lockstep", "--out", str(out), *options])
    said = capsys.readouterr().out
    assert code == 0, said
    assert "in lockstep: 1.5 s in" in said
    assert "x real time" in said
    assert len(files_in(out / "logs")) == 2
    assert (out / "hippomat.toml").exists()
    truth = np.load(out / "truth.npz")
    assert truth["poses"].shape[1:] == (2, 3)


def test_robots_that_are_carried_are_carried_in_lockstep_too(tmp_path: Path) -> None:
    made = settings(tmp_path)
    out = tmp_path / "run"
    options = ["--robots", "2", "--tasks", "3", "--seconds", "1.5", "--no-slam", "--config", str(made.config)]
    carried = ["--carry", "1:1:2.0,1.5,0.5"]
    assert (
        main(["run", "--map", str(made.map_yaml), "--lockstep", "--out", str(out), *options, *carried]) == 0
    )
    truth = np.load(out / "truth.npz")["poses"]
    assert truth[-1, 1] == pytest.approx([2.0, 1.5, 0.5], abs=0.02)


def test_a_robot_that_leaves_records_no_more_and_is_heard_no_more(tmp_path: Path) -> None:
    stayed, left = open_runs([record(tmp_path, leave_s={1: 1.0}, robots=2, seconds=2.5, loss=0.0)])
    ticks = [record.message for record in left.records_in_order((Tick,))]
    assert len(ticks) == pytest.approx(20, abs=1)
    heard_ns = [record.message.stamp_ns for record in stayed.records_in_order((StateHeard,))]
    assert heard_ns
    assert max(heard_ns) < ticks[-1].stamp_ns + 400_000_000  # its radio says its last STATE, and no other
    report = replay_run(left, ReplayOptions(("L0", "L1", "L2")))
    assert report.verdict == "reproduced L0 L1 L2"
