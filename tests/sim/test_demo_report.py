"""The demo's table, verdict, exit code and picture, from values made here."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console
from sim_rooms import box_room

from hippomat_logs.metrics import Completed, FleetMetrics, LinkMetrics, RobotMetrics
from hippomat_sim.demo import exit_code
from hippomat_sim.demo_report import DemoReport, show, verdict_line
from hippomat_sim.picture import PictureData, draw
from hippomat_sim.run_logs import Verdict
from hippomat_sim.world import WALL, Contact

GOOD = "reproduced L0 L1 L2 daemon L3"


def robot(number: int, *tasks: tuple[int, int]) -> RobotMetrics:
    made = RobotMetrics(number, 60.0, frames_sent=600, links=[LinkMetrics(1 - number, 540, 60)])
    for at_s, task in enumerate(tasks):
        made.seen[task], made.requested[task], made.confirmed[task] = at_s, at_s + 1.0, at_s + 1.3
        made.completed.append(Completed(number, task, at_s + 9.0, 4.5, 5.0))
    made.compute_ms.extend([4.0, 5.0, 6.0])
    return made


def report(*robots: RobotMetrics, codes: tuple[int, ...] = (0, 0), contacts: int = 0) -> DemoReport:
    verdicts = [Verdict(k, GOOD if not code else "diverged at L2", code) for k, code in enumerate(codes)]
    touched = [Contact(3.0 + k, 1, WALL) for k in range(contacts)]
    return DemoReport(FleetMetrics(list(robots)), verdicts, touched, ())


CLEAN = report(robot(0, (0, 0), (1, 0)), robot(1, (2, 0)))


def test_the_table_has_a_row_per_robot_and_one_for_the_fleet_within_80_columns() -> None:
    console = Console(file=io.StringIO(), width=80)
    show(CLEAN, console)
    assert isinstance(console.file, io.StringIO)
    lines = console.file.getvalue().splitlines()
    rows = {line.split()[0]: line.split()[1:] for line in lines if line.strip()}
    assert rows["0"] == ["2", "9.0", "100", "1.30", "0.30", "5.0", "600", "540", "60", "0"]
    assert rows["fleet"] == ["3", "13.5", "100", "1.30", "0.30", "5.0", "1200", "1080", "120", "0"]
    assert f"robot 1: {GOOD}" in lines
    unwrapped = " ".join(console.file.getvalue().split())
    assert f"fleet: {GOOD}; 3 tasks completed, none done twice, no contacts" in unwrapped


def test_two_requests_for_one_task_lower_the_conflict_free_rate() -> None:
    shared = report(robot(0, (0, 0), (1, 0)), robot(1, (1, 0)))
    assert shared.metrics.conflict_free_rate == 0.5
    assert "1 done twice" in verdict_line(shared)


@pytest.mark.parametrize(
    ("found", "code"),
    [
        (CLEAN, 0),
        (report(robot(0, (0, 0)), robot(1, (0, 0))), 2),
        (report(robot(0), robot(1), contacts=1), 2),
        (report(robot(0), robot(1), codes=(0, 2)), 2),
        (report(robot(0), robot(1), codes=(3, 2)), 3),
        (report(robot(0), robot(1), codes=()), 1),
        (DemoReport(CLEAN.metrics, CLEAN.verdicts, (), ("robot 1's daemon died",)), 1),
    ],
)
def test_the_exit_code_is_zero_only_when_all_is_well(found: DemoReport, code: int) -> None:
    assert exit_code(found) == code


def test_the_picture_shows_the_ways_in_the_robots_colours(tmp_path: Path) -> None:
    poses = np.zeros((50, 2, 3))
    poses[:, 0, 0], poses[:, 0, 1] = np.linspace(0.5, 3.5, 50), 0.8
    poses[:, 1, 0], poses[:, 1, 1] = 2.0, np.linspace(0.5, 2.5, 50)
    data = PictureData(box_room(), poses, [(0, 3.5, 0.8)], [(2.0, 0.8)], 0.12, "title", "subtitle")
    draw(data, tmp_path / "ways.png")
    image = cv2.imread(str(tmp_path / "ways.png"))
    assert image is not None
    assert min(image.shape[:2]) > 600
    for red, green, blue in ((0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00)):
        assert (image == (blue, green, red)).all(axis=2).sum() > 1000


def test_a_run_without_movement_or_tasks_has_a_picture_too(tmp_path: Path) -> None:
    draw(PictureData(box_room(), np.zeros((0, 3, 3)), [], [], 0.12, "nothing"), tmp_path / "ways.png")
    assert (tmp_path / "ways.png").stat().st_size > 1000
