"""Level L4: a recorded fleet again, with the radio it had, another radio, or another allocator."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lockstep_lab import SEED, record

from hippomat_core.messages import RelayHeard, Started, StateHeard, TasksHeard, Tick
from hippomat_core.wire.frames import STATE
from hippomat_logs.cli import main as logs
from hippomat_logs.closed_loop.choice import Choice, other_choice
from hippomat_logs.closed_loop.command import recorded_metrics
from hippomat_logs.closed_loop.figures import paired_differences, values_of
from hippomat_logs.closed_loop.open_loop import open_loop
from hippomat_logs.closed_loop.plan import Air, FleetPlan, parse_air
from hippomat_logs.closed_loop.recorded import Recording, read_recording
from hippomat_logs.closed_loop.rerun import rerun, rerun_metrics
from hippomat_logs.metrics.robot import Stamped
from hippomat_logs.radio_traffic import key_of, traffic_of
from hippomat_logs.reader import open_runs
from hippomat_logs.replay_cli import main
from hippomat_sim.closed_loop import closed_loop_fleet
from hippomat_sim.lockstep_fleet import FIRST_US


@pytest.fixture(scope="module")
def recording(recorded_fleet: Path) -> Recording:
    return read_recording(open_runs([recorded_fleet]), parse_air("recorded"))


def heard_in(plan: FleetPlan, seed: int) -> tuple[dict[int, set[int]], object]:
    """Keys of the frames that each robot heard in a re-run, and the medium's counts."""
    heard: dict[int, set[int]] = {robot.config.robot.id: set() for robot in plan.robots}

    def sink(robot: int, record: Stamped) -> None:
        if isinstance(record.message, StateHeard | RelayHeard | TasksHeard):
            header = record.message.header
            parts = (np.array([number]) for number in (header.sender, header.boot, header.sequence))
            heard[robot].add(int(key_of(*parts)[0]))

    fleet = closed_loop_fleet(plan, seed, sink)
    try:
        fleet.advance(FIRST_US + round(plan.seconds * 1e6))
        fleet.stop()
        return heard, fleet.devices.medium.counts
    finally:
        fleet.close()


def test_the_recorded_radio_delivers_again_what_it_delivered(recording: Recording) -> None:
    heard, _ = heard_in(recording.plan, SEED)  # the seed of the recording: frames have the same timing
    for run in recording.runs:
        recorded = set(traffic_of(run).heard.keys.tolist())
        assert len(recorded) > 100
        for sender in range(3):
            before, again = (
                {key for key in keys if key >> 56 == sender} for keys in (recorded, heard[run.robot])
            )
            assert len(before ^ again) <= 4, f"link {sender} -> {run.robot}"


def test_with_another_seed_each_link_still_loses_as_much_as_it_did(recording: Recording) -> None:
    _, counts = heard_in(recording.plan, SEED + 1)
    table = [one.heard for one in recording.plan.air.deliveries.values()]
    sent = sum(len(one) for one in table)
    share = sum(int(one.sum()) for one in table) / (2 * sent)
    received, lost = (sum(getattr(one, name) for one in counts) for name in ("received", "lost"))
    assert 0.6 < share < 0.8  # the recording lost 30 %
    assert received / (received + lost) == pytest.approx(share, abs=0.03)


def test_an_ideal_radio_loses_nothing(recording: Recording) -> None:
    _, counts = heard_in(replace(recording.plan, air=Air()), SEED)
    assert sum(one.sent for one in counts) > 300
    assert all((one.lost, one.collided, one.deaf, one.duplicates) == (0, 0, 0, 0) for one in counts)


def test_a_drawn_radio_loses_the_share_that_was_asked_for(recording: Recording) -> None:
    _, counts = heard_in(replace(recording.plan, air=parse_air("loss=0.5")), SEED)
    received, lost = (sum(getattr(one, name) for one in counts) for name in ("received", "lost"))
    assert lost / (received + lost) == pytest.approx(0.5, abs=0.06)


def test_robots_begin_where_and_when_they_began(recording: Recording) -> None:
    for robot, run in zip(recording.plan.robots, recording.runs, strict=True):
        config = run.config.robot
        assert robot.start == (config.start_x_m, config.start_y_m, config.start_yaw_rad)
        assert robot.begins_s == pytest.approx(0.0, abs=1e-3)
        assert robot.ends_s == pytest.approx(8.0, abs=0.1)
        assert robot.first_tick_s == 0.05


def test_a_computer_that_started_slowly_starts_slowly_again(recording: Recording) -> None:
    slow, *others = recording.plan.robots
    plan = replace(recording.plan, robots=(replace(slow, first_tick_s=2.0, ends_s=3.0), *others))
    times_s: list[float] = []

    def sink(robot: int, record: Stamped) -> None:
        if robot == 0 and isinstance(record.message, Started | Tick | StateHeard):
            times_s.append(record.log_time_ns / 1e9)

    fleet = closed_loop_fleet(plan, SEED, sink)
    try:
        fleet.advance(FIRST_US + 3_000_000)
    finally:
        fleet.close()
    started_s, *later_s = times_s
    assert min(later_s) - started_s == pytest.approx(2.0, abs=0.051)
    assert max(later_s) - started_s > 2.9


def test_a_re_run_with_the_recorded_seed_and_radio_gives_the_recorded_figures(recording: Recording) -> None:
    recorded, again = recorded_metrics(recording), rerun_metrics(recording.plan, SEED)
    assert [one.task for one in again.completed] == [one.task for one in recorded.completed]
    assert again.travel_cost_s == pytest.approx(recorded.travel_cost_s)
    assert again.conflict_free_rate == recorded.conflict_free_rate


def test_an_allocator_compared_with_itself_differs_by_exactly_nothing(recording: Recording) -> None:
    same = other_choice(recording.plan.robots[0].config, "hungarian", None)
    differences = paired_differences([rerun(recording.plan, 1)], [rerun(same.plan(recording.plan), 1)])
    assert all(one.difference == 0.0 or not one.pairs for one in differences)
    assert any(one.pairs for one in differences)
    opened = open_loop(recording.runs, same)
    assert opened.differ == 0
    assert opened.recorded == opened.other
    assert opened.recorded.requests > 0
    assert opened.notes == ()


def test_another_allocator_would_have_requested_other_tasks(recording: Recording) -> None:
    opened = open_loop(recording.runs, Choice("random", None))
    assert 0 < opened.differ <= opened.rounds
    assert opened.other.cost_s > opened.recorded.cost_s  # random requests are dearer than least-cost ones


def test_values_of_a_re_run_are_those_of_its_metrics(recording: Recording) -> None:
    assert rerun(recording.plan, 2) == pytest.approx(values_of(rerun_metrics(recording.plan, 2)), nan_ok=True)


def test_without_a_log_of_one_robot_the_others_run_again_and_it_is_said(
    recorded_fleet: Path, tmp_path: Path
) -> None:
    shutil.copytree(recorded_fleet, tmp_path / "logs", ignore=shutil.ignore_patterns("robot1"))
    found = read_recording(open_runs([tmp_path / "logs"]), parse_air("recorded"))
    assert [robot.config.robot.id for robot in found.plan.robots] == [0, 2]
    assert "no log of robot 1: the re-runs have neither its work nor frames nor votes" in found.notes[0]
    assert len(found.notes) == 1
    _, counts = heard_in(found.plan, 1)
    assert [bool(one.sent) for one in counts] == [True, False, True]


def test_re_runs_without_a_majority_say_so_and_judge_nothing(
    recorded_fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = [str(recorded_fleet / "robot2"), "--closed-loop", "--seeds", "1"]
    assert main(asked) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "no log of robots 0, 1: the re-runs have neither their work" in said
    assert "1 of 3 robots are no majority: they confirm no claim" in said
    assert "beyond" not in said


def test_a_fused_fleet_is_run_again_like_its_parts(
    recording: Recording, recorded_fleet: Path, tmp_path: Path
) -> None:
    fused = tmp_path / "fleet.mcap"
    assert logs(["fuse", str(recorded_fleet), "-o", str(fused)]) == 0
    found = read_recording(open_runs([fused]), parse_air("recorded"))
    for sender, deliveries in recording.plan.air.deliveries.items():
        again = found.plan.air.deliveries[sender]
        assert len(again.kinds) == len(deliveries.kinds)
        assert np.array_equal(again.heard, deliveries.heard)
    assert open_loop(found.runs, Choice("greedy", None)) == open_loop(recording.runs, Choice("greedy", None))


def test_of_the_nearest_frames_the_one_of_its_kind_decides(recording: Recording) -> None:
    deliveries = recording.plan.air.deliveries[0]
    states = np.flatnonzero(deliveries.kinds == STATE)
    for index in states[5:50:7].tolist():
        at_us = int(deliveries.times_us[index])
        assert deliveries.delivered(at_us, STATE).tolist() == deliveries.heard[index].tolist()


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--allocator", "oracle"], "allocator = 'oracle' is unknown; known: hungarian"),
        (["--allocator", "paper_network"], "needs weights"),
        (["--policy", "nowhere.safetensors"], "nowhere.safetensors"),
        (["--policy", __file__], "is not valid safetensors"),
        (["--policy", __file__, "--allocator", "greedy"], "--allocator greedy decides without weights"),
        (["--seeds", "3"], "--seeds is of re-runs: give --closed-loop too"),
        (["--radio", "ideal"], "--radio is of re-runs: give --closed-loop too"),
        (["--allocator", "greedy", "-o", "plots"], "--plots is of re-runs: give --closed-loop too"),
        (["--closed-loop", "--serve"], "--serve and --closed-loop: choose one"),
        (["--closed-loop", "--clip", "x.mcap"], "--clip and --closed-loop: choose one"),
        (["--closed-loop", "--sim"], "--sim and --closed-loop: choose one"),
        (["--policy", "x", "--update-golden", "--reason", "y"], "--update-golden and --policy: choose one"),
        (["--allocator", "greedy", "--levels", "L0"], "--levels and --allocator: choose one"),
        (["--closed-loop", "--strict", "--seeds", "5"], "--strict judges by 20 re-runs or more"),
        (["--closed-loop", "--seeds", "0"], "--seeds 0 is outside 1 .. 10000"),
        (["--closed-loop", "--radio", "loss=2"], "--radio 'loss=2' is none of: recorded, ideal, loss=P"),
        (["--closed-loop", "--radio", "quiet"], "--radio 'quiet' is none of"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_one_line(
    options: list[str], complaint: str, recorded_fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(recorded_fleet), *options]) == 1
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert complaint in " ".join(said.split())


def test_level_l4_is_asked_for_by_its_own_option(
    recorded_fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([str(recorded_fleet), "--levels", "L0,L4"])
    assert ended.value.code == 1
    assert "--closed-loop runs it" in capsys.readouterr().err


def test_without_a_simulator_the_remedy_is_named(
    recorded_fleet: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("hippomat_logs.closed_loop.rerun.entry_points", lambda group: [])  # noqa: ARG005
    assert main([str(recorded_fleet), "--closed-loop"]) == 1
    assert "pip install 'hippomat[sim]'" in capsys.readouterr().err


def test_two_runs_of_one_robot_are_no_fleet(
    recorded_fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = record(tmp_path, seed=9, seconds=1.0)
    assert main([str(recorded_fleet), str(other), "--closed-loop"]) == 1
    assert "has 2 runs" in capsys.readouterr().err


def test_the_command_prints_the_recorded_run_among_its_re_runs_and_draws_it(
    recorded_fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pictures = tmp_path / "pictures"
    asked = ["--closed-loop", "--seeds", "1", "--allocator", "greedy", "--plots", str(pictures)]
    assert main([str(recorded_fleet), *asked]) == 0
    said = capsys.readouterr().out
    assert "L4: 1 re-run, radio recorded, allocator hungarian" in said
    assert "open loop: greedy asked in the rounds of the recorded hungarian" in said
    assert {path.name for path in pictures.iterdir()} == {"closed_loop.png", "differences.png"}
