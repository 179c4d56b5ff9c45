"""What the logs say of a fleet, and the command line that shows it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from fleet_logs import claim, stop_heard, write_log

from hippomat_core import messages as m
from hippomat_core.wire import frames
from hippomat_logs.cli import main
from hippomat_logs.metrics import run_metrics


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """Robot 0 takes slot 1 and completes it; both request slot 2, robot 1 gets it; slot 3 is done by both."""
    turned = [(0.0, m.TaskTurned(slot, 1, 0, 0, 0, "start")) for slot in (1, 2, 3)]
    first = [
        (1.0, claim("requested", 1)),
        (1.5, claim("confirmed", 1)),
        (5.0, claim("completed", 1)),
        (5.2, claim("requested", 2)),
        (5.3, m.ConflictSeen(2, 1, 1, False, "loss")),
        (6.0, claim("requested", 3)),
        (9.0, claim("completed", 3)),
        (9.0, m.PoseEstimated(0.0, 0.0, 0.0, 0.0, 0.0, "odometry")),
        (9.1, m.PoseEstimated(3.0, 4.0, 0.0, 0.0, 0.0, "odometry")),
        *[(9.2, stop_heard(1, sequence)) for sequence in (10, 11, 13, 14, 14)],
        *[(9.3, stop_heard(1, sequence, boot=2)) for sequence in (0, 4)],
        (9.4, m.FrameSent(0, 0, frames.STATE, 3, True)),
        (9.4, m.FrameSent(0, 0, frames.STATE, 4, False)),
    ]
    second = [
        (5.2, claim("requested", 2)),
        (5.6, claim("confirmed", 2)),
        (8.0, claim("completed", 2)),
        (9.0, claim("completed", 3)),
    ]
    write_log(tmp_path, 0, turned + first)
    write_log(tmp_path, 1, turned + second)
    return tmp_path


def test_tasks_costs_and_conflicts_are_counted_over_the_fleet(logs: Path) -> None:
    fleet = run_metrics([logs])
    assert [one.task for one in fleet.completed] == [(1, 1), (2, 1), (3, 1), (3, 1)]
    assert fleet.completed_twice == [(3, 1)]
    assert fleet.travel_cost_s == pytest.approx(4 * 20.0 * (127 / 254) ** 2)
    assert fleet.robots[0].completed[0].travel_s == pytest.approx(5.0 - 1.0 - 0.5)
    assert fleet.conflict_free_rate == pytest.approx(2 / 3)
    assert sorted(fleet.allocation_s) == pytest.approx([1.5, 5.6])
    assert fleet.robots[0].conflicts == {"loss": 1}
    assert fleet.robots[0].driven_m == pytest.approx(5.0)
    assert fleet.compute_ms.tolist() == [2.0, 2.0]


def test_lost_frames_are_the_gaps_per_sender_and_boot(logs: Path) -> None:
    robot = run_metrics([logs]).robots[0]
    assert (robot.frames_sent, robot.frames_given_up) == (1, 1)
    (link,) = robot.links
    assert (link.sender, link.received, link.lost) == (1, 6, 1 + 3)
    assert link.loss == pytest.approx(0.4)


def test_metrics_are_printed_as_a_table_and_as_json(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["metrics", str(logs)]) == 0
    out = capsys.readouterr().out
    assert "total travel cost: 20.0 s" in out
    assert max(map(len, out.splitlines()[:6])) <= 80
    assert "…" not in out
    assert "CF1: 66.7 %" in out
    assert "slot 3 generation 1" in out
    assert main(["metrics", "--json", str(logs)]) == 0
    assert json.loads(capsys.readouterr().out)["completed"] == 4


def test_info_shows_what_a_log_holds(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", *map(str, sorted(logs.glob("*.mcap")))]) == 0
    out = capsys.readouterr().out
    assert "robot 0 of fleet 1" in out
    assert "/hippo/effect/claim_changed" in out


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        ([], 1, "COMMAND"),
        (["info"], 1, "LOG"),
        (["frobnicate"], 1, "frobnicate"),
        (["info", "{tmp}/none.mcap"], 1, "no such file"),
        (["metrics", "{tmp}"], 1, "holds no log"),
        (["metrics", "{tmp}/none.mcap"], 1, "no such file"),
        (["metrics", "{tmp}", "--baseline", "x"], 1, "needs --by"),
        (["recover", "{tmp}/none"], 1, "no such file"),
        (["recover", "{tmp}"], 0, "nothing to recover"),
    ],
)
def test_every_answer_of_the_command_line_is_one_clear_line(
    tmp_path: Path, arguments: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        answer: object = main([argument.format(tmp=tmp_path) for argument in arguments])
    except SystemExit as error:
        answer = error.code
    captured = capsys.readouterr()
    assert answer == code
    assert said in (captured.out + captured.err).replace("\n", " ")


def test_a_damaged_log_is_exit_code_3(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = next(logs.glob("*.mcap"))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)
    assert main(["metrics", str(logs)]) == 3
    assert "hippomat-logs recover" in capsys.readouterr().err.replace("\n", " ")
