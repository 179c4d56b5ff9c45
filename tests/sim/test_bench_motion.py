"""`hippomat-bench motion`: a checker that sees every fault, runs that are safe, an honest command line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_data import data_folder

from hippomat_sim.bench.cli import main
from hippomat_sim.bench.motion_checker import Move, judge
from hippomat_sim.bench.motion_maps import make_map
from hippomat_sim.bench.motion_report import targets_of
from hippomat_sim.bench.motion_run import MotionRun
from hippomat_sim.bench.motion_settings import MotionSettings

FREE = np.ones((1, 4, 4), np.bool_)
FREE[0, 3, 3] = False


def judged(
    *moves: tuple[int, int, tuple[int, int], tuple[int, int]], ticks: int = 1, diagonals: bool = False
):
    """Of two robots at (0, 0) and (1, 0): (robot, tick, from, to)."""
    starts = np.array([[0, 0, 0], [1, 0, 0]], np.int32)
    made = [Move(robot, tick, tick + ticks, (*tail, 0), (*head, 0)) for robot, tick, tail, head in moves]
    return judge(FREE, starts, made, [ticks, ticks], 6, diagonals)


def test_two_robots_in_one_cell_are_seen() -> None:
    assert judged((0, 0, (0, 0), (1, 0))).at_ticks == 6


def test_a_swap_is_seen() -> None:
    assert judged((0, 1, (0, 0), (1, 0)), (1, 1, (1, 0), (0, 0))).between_ticks == 1


def test_crossing_diagonals_are_seen() -> None:
    crossing = judged((0, 0, (0, 0), (1, 1)), (1, 0, (1, 0), (0, 1)), diagonals=True)
    assert (crossing.between_ticks, crossing.wrong_moves) == (1, ())


def test_a_slow_leaver_that_is_run_into_is_seen() -> None:
    starts = np.array([[0, 0, 0], [1, 0, 0]], np.int32)
    moves = [Move(1, 0, 5, (1, 0, 0), (2, 0, 0)), Move(0, 0, 1, (0, 0, 0), (1, 0, 0))]
    assert judge(FREE, starts, moves, [1, 5], 6, False).collisions > 0


def test_following_round_a_corner_is_no_collision() -> None:
    verdict = judged((1, 0, (1, 0), (1, 1)), (0, 0, (0, 0), (1, 0)))
    assert (verdict.collisions, verdict.wrong_moves) == (0, ())
    assert verdict.nearest == pytest.approx(0.5**0.5)


@pytest.mark.parametrize(
    ("move", "fault"),
    [
        ((0, 0, (0, 0), (0, 2)), "not neighbours"),
        ((0, 0, (0, 0), (1, 1)), "not neighbours"),
        ((0, 0, (0, 1), (0, 2)), "elsewhere"),
        ((0, 0, (0, 0), (-1, 0)), "leaves the map"),
    ],
)
def test_a_move_that_cannot_be_is_named(move: tuple, fault: str) -> None:
    assert fault in judged(move).wrong_moves[0]


def test_a_move_into_a_wall_or_before_the_last_has_ended_is_named() -> None:
    starts = np.array([[3, 2, 0]], np.int32)
    into = [Move(0, 0, 1, (3, 2, 0), (3, 3, 0))]
    assert "not free" in judge(FREE, starts, into, [1], 3, False).wrong_moves[0]
    early = [Move(0, 0, 2, (3, 2, 0), (3, 1, 0)), Move(0, 1, 3, (3, 1, 0), (3, 0, 0))]
    assert "has ended" in judge(FREE, starts, early, [2], 3, False).wrong_moves[0]


@pytest.mark.parametrize(
    "changes",
    [
        {"map": "random:0.3"},
        {"map": "corridors", "loss": 0.3},
        {"map": "warehouse", "speeds_mps": (3.0, 5.0)},
        {"map": "random:0.2", "uav": True, "agents": 20, "loss": 0.3},
        {"map": "random:0.2", "diagonals": True, "loss": 0.3},
        {"map": "corridors", "idle": 10},
    ],
    ids=str,
)
def test_runs_are_free_of_collisions_and_nobody_is_stuck(changes: dict) -> None:
    run = MotionRun(replace(MotionSettings(steps=220), **changes), 1, lambda _: None).execute()
    assert (run.verdict.collisions, run.verdict.wrong_moves, run.stuck) == (0, (), 0)
    assert run.tasks > 0
    assert run.of_bound > 0.7


def test_equal_seeds_give_equal_runs() -> None:
    settings = MotionSettings(map="corridors", steps=60, loss=0.3, agents=12)
    one, other = (MotionRun(settings, 3, lambda _: None).execute() for _ in range(2))
    assert np.array_equal(one.trace, other.trace)


def test_lossless_and_lossy_runs_share_their_tasks_until_a_frame_is_lost() -> None:
    quiet = MotionRun(MotionSettings(steps=40), 2, lambda _: None).execute()
    lossy = MotionRun(MotionSettings(steps=40, loss=1e-9), 2, lambda _: None).execute()
    assert np.array_equal(quiet.trace, lossy.trace)


def test_a_target_is_judged_only_where_it_was_set() -> None:
    run = MotionRun(MotionSettings(steps=20), 0, lambda _: None).execute()
    slow = [replace(run, of_bound=0.5)]
    assert [t.name for t in targets_of(MotionSettings(), slow) if t.missed][:1] == ["of the bound"]
    assert not [t.name for t in targets_of(MotionSettings(loss=0.3), slow) if t.missed]
    crash = [replace(run, verdict=replace(run.verdict, at_ticks=1))]
    for planner in ("ours", "pibt", "replan"):
        missed = [t.name for t in targets_of(MotionSettings(planner=planner, loss=0.3), crash) if t.missed]
        assert missed == ["collisions"]


def test_the_command_prints_json_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "run.png"
    asked = "motion --map warehouse --agents 5 --steps 60 --seeds 1 --json --picture"
    code = main([*asked.split(), str(picture)])
    answer = json.loads(capsys.readouterr().out)
    assert (code, answer["met"], answer["runs"][0]["collisions_at_ticks"]) == (0, True, 0)
    assert picture.stat().st_size > 10_000


def test_recorded_maps_of_both_kinds_are_read() -> None:
    arena = make_map(str(data_folder() / "movingai" / "arena.map"), 0, False)
    assert arena.shape == (1, 49, 49)
    house = make_map(str(data_folder() / "ros_maps" / "turtlebot3_world.yaml"), 0, False)
    assert house.sum() > 1000


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--map", "maze"], "--map maze: give warehouse"),
        (["--map", "no/such.map"], "no/such.map: cannot be read"),
        (["--map", "random:2"], "write random:P"),
        (["--loss", "2"], "--loss 2 is outside"),
        (["--speeds", "fast"], "--speeds fast: give numbers"),
        (["--agents", "200", "--map", "corridors", "--speeds", "0"], "--speeds 0 is outside"),
        (["--picture", "x.bmp"], "--picture x.bmp"),
    ],
)
def test_wrong_usage_is_one_line_that_names_it(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["motion", *arguments]) == 1
    shown = capsys.readouterr().err
    assert said in shown
    assert "Traceback" not in shown
