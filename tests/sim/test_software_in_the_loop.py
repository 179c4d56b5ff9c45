"""Real daemons as processes, in the simulated world: they work, they stop, and nothing is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from rich.console import Console
from sim_rooms import box_room

from hippomat_core.messages import StateHeard
from hippomat_logs.fleet_story.conflicts import conflict_free_rate
from hippomat_logs.fleet_story.rerun import Rerun
from hippomat_logs.fleet_story.story import fleet_story
from hippomat_logs.map_files import save_map
from hippomat_logs.metrics import run_metrics
from hippomat_logs.reader import open_runs
from hippomat_sim.fleet_run import FleetRun, RunResult
from hippomat_sim.run_logs import completions, log_files
from hippomat_sim.run_settings import RunSettings
from hippomat_sim.views import PlainView


@pytest.fixture(scope="module")
def room_yaml(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "room.yaml"
    save_map(box_room(3.0, 2.5), path)
    return path


@pytest.fixture(scope="module")
def finished_run(room_yaml: Path, tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """Three robots, a dozen seconds, a tenth of all frames lost."""
    out = tmp_path_factory.mktemp("run") / "out"
    settings = RunSettings(room_yaml, out, robots=3, tasks=6, seconds=14.0, loss=0.1, seed=2)
    return FleetRun(settings, PlainView(Console())).execute()


def processes_that_name(path: Path) -> list[str]:
    """Command lines of this machine's processes that mention `path`; zombies have none."""
    found = []
    for process in psutil.process_iter(["cmdline"]):
        command = " ".join(process.info["cmdline"] or [])
        if str(path) in command and process.pid != os.getpid():
            found.append(command)
    return found


def gone(path: Path, within_s: float = 3.0) -> bool:
    """True once no process names `path`; the motor guards end a moment after their daemons."""
    until = time.monotonic() + within_s
    while processes_that_name(path) and time.monotonic() < until:
        time.sleep(0.05)
    return not processes_that_name(path)


def test_a_fleet_completes_tasks_without_touching_anything(finished_run: RunResult) -> None:
    assert finished_run.troubles == ()
    assert finished_run.contacts == ()
    done = completions(log_files(finished_run.logs))
    assert len(done) >= 2
    assert len({(one.slot, one.generation) for one in done}) == len(done)


def test_the_robots_really_stood_where_they_completed_their_tasks(finished_run: RunResult) -> None:
    for one in completions(log_files(finished_run.logs)):
        way = finished_run.truth[:, one.robot, :2]
        nearest_m = np.hypot(*(way - [one.x_m, one.y_m]).T).min()
        assert nearest_m < finished_run.config.fleet.goal_tolerance_m + 0.05


def test_every_robot_was_heard_and_lost_about_a_tenth(finished_run: RunResult) -> None:
    for counts in finished_run.counts:
        assert counts.sent > 60
        share = counts.lost / (counts.lost + counts.received)
        assert 0.03 < share < 0.2


def test_what_real_daemons_decided_and_sent_is_told_by_their_logs(finished_run: RunResult) -> None:
    """Every request can be made again, and every STATE heard is in its sender's log, in that round."""
    runs = open_runs(list(finished_run.logs))
    story = fleet_story(runs)
    rerun = Rerun(story)
    assert len(story.claims) >= 2
    for claim in story.claims:
        assert claim.decision is not None
        assert rerun.refusal(claim.decision) == ""
    assert conflict_free_rate(story.claims) == run_metrics(list(finished_run.logs)).conflict_free_rate
    heard = 0
    for run in runs:
        for record in run.records_in_order([StateHeard]):
            header = record.message.header
            told = story.robots[header.sender]
            settled = told.rounds[0] + 30  # fleet time leaps while radios find each other
            if settled < header.fleet_time_us // 100_000 < told.rounds[1]:
                heard += 1
                assert told.sent[header.fleet_time_us // 100_000] == (header.sequence, True)
    assert heard > 200


def test_nothing_of_a_finished_run_is_left_behind(finished_run: RunResult) -> None:
    assert gone(finished_run.out)
    assert list((finished_run.out / "ports").iterdir()) == []


def test_the_truth_is_written(finished_run: RunResult) -> None:
    with np.load(finished_run.out / "truth.npz") as truth:
        assert truth["poses"].shape == (len(truth["stamp_ns"]), 3, 3)
        assert truth["poses"][0] == pytest.approx(finished_run.start_poses, abs=1e-6)
        assert (np.diff(truth["stamp_ns"]) == 100_000_000).all()
        assert truth["contacts"].shape == (0, 3)


def test_a_fleet_with_a_key_works_as_well_and_every_frame_of_it_is_authentic(
    room_yaml: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    settings = RunSettings(room_yaml, out, robots=3, tasks=6, seconds=11.0, loss=0.1, seed=2, sealed=True)
    result = FleetRun(settings, PlainView(Console())).execute()
    assert result.troubles == ()
    assert completions(log_files(result.logs))
    (run,) = open_runs([result.logs[0]])
    heard = [record.message for record in run.records_in_order([StateHeard])]
    assert len(heard) > 100
    assert all(event.header.sealed for event in heard)
    assert "sealed" in (out / "daemon0.out").read_text()


def started(room_yaml: Path, out: Path) -> subprocess.Popen[str]:
    """hippomat-sim run with two robots for a minute, once it is under way."""
    command = [sys.executable, "-m", "hippomat_sim", "run", "--map", str(room_yaml), "--out", str(out)]
    options = ["--robots", "2", "--tasks", "4"]
    process = subprocess.Popen(command + options, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        if "/60 s" in line:
            return process
    raise AssertionError(f"the run did not start: exit code {process.wait()}")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_everything_cleanly(room_yaml: Path, tmp_path: Path, number: signal.Signals) -> None:
    process = started(room_yaml, tmp_path / "out")
    process.send_signal(number)
    said, _ = process.communicate(timeout=30)
    assert process.returncode == 0, said
    assert "tasks done" in said
    assert gone(tmp_path)
    assert len(log_files([tmp_path / "out" / "logs" / f"robot{k}" for k in (0, 1)])) == 2


def test_a_daemon_that_dies_is_reported_with_its_last_words_and_the_others_go_on(
    room_yaml: Path, tmp_path: Path
) -> None:
    process = started(room_yaml, tmp_path / "out")
    victim = next(
        child for child in psutil.Process(process.pid).children() if "radio1" in " ".join(child.cmdline())
    )
    victim.kill()
    assert process.stdout is not None
    report = next(line for line in process.stdout if "daemon was ended" in line)
    assert "robot 1's daemon was ended by signal 9" in report
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=30)
    assert process.returncode == 1, said
    assert gone(tmp_path)


def test_no_daemon_outlives_a_simulator_that_was_killed(room_yaml: Path, tmp_path: Path) -> None:
    process = started(room_yaml, tmp_path / "out")
    process.kill()
    process.wait()
    assert gone(tmp_path, within_s=10.0)


def test_a_daemon_that_cannot_start_ends_the_run_with_its_own_words(
    room_yaml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from hippomat_sim.cli import main

    base = tmp_path / "base.toml"
    base.write_text('[fleet]\nallocator = "paper_network"\npolicy = "/nowhere/policy.safetensors"\n')
    arguments = ["run", "--map", str(room_yaml), "--robots", "1", "--config", str(base)]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr()
    assert "the fleet did not start: robot 0's daemon ended with exit code 1" in said.err
    assert "/nowhere/policy.safetensors" in said.err
    assert gone(tmp_path)
