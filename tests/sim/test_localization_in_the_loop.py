"""Real daemons find their place by lidar; one of them is carried away, says so, stops, and finds itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from sim_rooms import odd_room

from hippomat_core.messages import Drive, Localized, SendState, StateHeard, Tick
from hippomat_core.wire.frames import FLAG_LOCALIZED
from hippomat_logs.alignment import Alignment
from hippomat_logs.map_files import save_map
from hippomat_logs.metrics.truth import against_truth
from hippomat_logs.metrics.truth_files import read_truth
from hippomat_logs.reader import open_runs
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.report import OK
from hippomat_sim.fleet_run import FleetRun, RunResult
from hippomat_sim.pose_errors import pose_errors, pose_table
from hippomat_sim.run_logs import log_files
from hippomat_sim.run_settings import Carried, RunSettings
from hippomat_sim.views import PlainView

CARRIED_TO = (4.4, 0.6, 2.5)  # in the chamber, so that it lands on nobody
GOAL_M = 0.10


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """Two robots; after six seconds robot 1 is lifted and put down in the chamber beside the room."""
    folder = tmp_path_factory.mktemp("odd")
    save_map(odd_room(), folder / "room.yaml")
    carried = (Carried(6.0, 1, CARRIED_TO),)
    settings = RunSettings(
        folder / "room.yaml",
        folder / "out",
        robots=2,
        tasks=4,
        seconds=20.0,
        seed=3,
        slam=True,
        carried=carried,
    )
    return FleetRun(settings, PlainView(Console())).execute()


def messages(result: RunResult, robot: int, *kinds: type) -> list[tuple[int, object]]:
    """(tick stamp, record) of one robot's log."""
    (log,) = open_runs([result.logs[robot]])
    found, stamp_ns = [], 0
    for record in log.records_in_order((Tick, *kinds)):
        if isinstance(record.message, Tick):
            stamp_ns = record.message.stamp_ns
        if isinstance(record.message, kinds):
            found.append((stamp_ns, record.message))
    return found


def phases(result: RunResult, robot: int) -> list[str]:
    """What the robot was, one after the other."""
    seen = [one.phase for _, one in messages(result, robot, Localized) if isinstance(one, Localized)]
    return [phase for k, phase in enumerate(seen) if k == 0 or seen[k - 1] != phase]


def test_nobody_touches_anything_and_no_daemon_fails(run: RunResult) -> None:
    assert run.troubles == ()
    assert run.contacts == ()


def test_the_robot_that_stays_knows_its_place_all_the_time(run: RunResult) -> None:
    assert phases(run, 0) == ["checking", "localized"]


def test_the_robot_that_was_carried_is_lost_and_finds_itself(run: RunResult) -> None:
    seen = phases(run, 1)
    assert seen[:3] == ["checking", "localized", "lost"]
    assert seen[-1] == "localized"


def test_a_lost_robot_stands_and_its_peers_are_told(run: RunResult) -> None:
    known, drives, stopped = True, 0, False
    for _, one in messages(run, 1, Localized, Drive):
        if isinstance(one, Localized):
            known = one.phase == "localized"
        elif isinstance(one, Drive):
            stopped = stopped or one.reason == "stop:not_localized"
            drives += known is False and one.v_mps > 0.0
    assert stopped
    assert drives <= 2  # the fault is seen at the next tick
    sent = [
        one.frame.flags & FLAG_LOCALIZED
        for _, one in messages(run, 1, SendState)
        if isinstance(one, SendState)
    ]
    heard = [
        one.frame.flags & FLAG_LOCALIZED
        for _, one in messages(run, 0, StateHeard)
        if isinstance(one, StateHeard) and one.header.sender == 1
    ]
    assert 0 in sent
    assert FLAG_LOCALIZED in sent
    assert 0 in heard


def test_poses_are_right_while_they_are_believed(run: RunResult) -> None:
    errors = pose_errors(log_files(run.logs), run.truth_ns, run.truth, run.clock_errors)
    assert [one.robot for one in errors] == [0, 1]
    stayed, carried = errors
    assert len(stayed.errors_m) > 200
    assert stayed.quantile_m(0.95) < GOAL_M
    assert stayed.known > 0.95
    assert carried.quantile_m(0.5) < GOAL_M  # until it notices, it is off by the way it was carried
    assert np.median(carried.errors_m[-40:]) < GOAL_M
    assert pose_table(errors).row_count == 3


def test_the_metrics_of_the_logs_against_the_truth_are_the_same_errors(run: RunResult) -> None:
    errors = pose_errors(log_files(run.logs), run.truth_ns, run.truth, run.clock_errors)
    runs = open_runs(run.logs)
    found = against_truth(runs, Alignment.trusting(runs), read_truth(run.out / "truth.npz"))
    for one, expected in zip(found.robots, errors, strict=True):
        assert one.errors_m == pytest.approx(expected.errors_m, abs=1e-6)
        assert one.known == pytest.approx(expected.known)
    assert found.nearest is not None
    assert found.nearest.clear_m > 0.0  # there was no contact


def test_the_runs_are_reproduced_bit_for_bit_searches_and_all(run: RunResult) -> None:
    (log,) = open_runs([run.logs[1]])
    report = replay_run(log, ReplayOptions(levels=("L0", "L1", "L2", "daemon")))
    assert [(one.level, one.status, one.divergence) for one in report.results] == [
        (level, OK, None) for level in ("L0", "L1", "L2", "daemon")
    ]


def test_the_map_file_may_be_a_bare_image(tmp_path: Path) -> None:
    save_map(odd_room(), tmp_path / "room.yaml")
    settings = RunSettings(tmp_path / "room.pgm", tmp_path / "out", robots=1, resolution_m=0.04)
    fleet_run = FleetRun(settings, PlainView(Console()))
    fleet_run.simulation.close()
    assert fleet_run.grid.resolution_m == 0.04
    assert (fleet_run.grid.origin_x_m, fleet_run.grid.origin_y_m) == (0.0, 0.0)
    assert (fleet_run.grid.cells == odd_room().cells).all()
