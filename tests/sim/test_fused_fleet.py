"""Five real daemons with clocks years apart and drifting: their logs become one, within 2 ms of the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console
from sim_rooms import box_room

from hippomat_logs.alignment import Alignment, align_runs
from hippomat_logs.fusing import fuse
from hippomat_logs.map_files import save_map
from hippomat_logs.metrics.fleet import run_metrics
from hippomat_logs.metrics.truth import against_truth
from hippomat_logs.metrics.truth_files import read_truth
from hippomat_logs.reader import Run, open_runs
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.report import OK
from hippomat_sim.clock_errors import YEAR_NS, ClockError
from hippomat_sim.fleet_run import FleetRun, RunResult
from hippomat_sim.pose_errors import pose_errors
from hippomat_sim.run_logs import log_files
from hippomat_sim.run_settings import RunSettings
from hippomat_sim.views import PlainView

WITHIN_NS = 2_000_000


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    folder = tmp_path_factory.mktemp("fleet")
    save_map(box_room(), folder / "room.yaml")
    settings = RunSettings(
        folder / "room.yaml",
        folder / "out",
        robots=5,
        tasks=6,
        seconds=20.0,
        loss=0.2,
        seed=2,
        slam=False,
        clock_years=10.0,
        clock_ppm=50.0,
    )
    return FleetRun(settings, PlainView(Console())).execute()


@pytest.fixture(scope="module")
def runs(run: RunResult) -> list[Run]:
    return open_runs(run.logs)


@pytest.fixture(scope="module")
def alignment(runs: list[Run]) -> Alignment:
    return align_runs(runs)


def own_log_times(run: Run, truth: NDArray[np.int64], errors: list[ClockError]) -> NDArray[np.int64]:
    """What the robot's log calls these times of the world."""
    return errors[run.robot].own_ns(truth) + run.wall_offset_ns


def test_robots_with_wrong_clocks_drive_as_well_as_any(run: RunResult) -> None:
    assert run.troubles == ()
    assert run.contacts == ()
    assert sum(run.served) > 0


def test_the_logs_are_years_apart_and_named_by_the_machine_s_boot(runs: list[Run]) -> None:
    begun_ns = [int(run.manifest["started_ns"]) + run.wall_offset_ns for run in runs]
    assert max(begun_ns) - min(begun_ns) > 2 * YEAR_NS
    for one in runs:
        assert one.manifest["boot_id"].replace("-", "")[:8] in one.name


def test_common_time_is_within_two_milliseconds_of_the_truth(
    run: RunResult, runs: list[Run], alignment: Alignment
) -> None:
    with np.load(run.out / "truth.npz") as truth:
        stamps_ns, rows = truth["stamp_ns"], (truth["clock_ahead_ns"], truth["clock_drift_ppb"])
        errors = [ClockError(int(ahead), int(drift)) for ahead, drift in zip(*rows, strict=True)]
    recorded = [errors[one.robot].own_ns(stamps_ns) >= int(one.manifest["started_ns"]) for one in runs]
    stamps_ns = stamps_ns[np.all(recorded, axis=0)]
    reference = own_log_times(runs[0], stamps_ns, errors)
    for one, clock in zip(runs, alignment.clocks, strict=True):
        common = alignment.common_ns_array(one, own_log_times(one, stamps_ns, errors))
        off_ns = np.abs(common - reference).max()
        assert off_ns < WITHIN_NS
        assert off_ns <= clock.uncertainty_ns
        assert clock.violations == 0


def test_metrics_are_sane_and_the_truth_s_are_pose_errors_whatever_the_clocks(
    run: RunResult, runs: list[Run], alignment: Alignment
) -> None:
    fleet = run_metrics(run.logs)
    assert 15.0 < fleet.duration_s < 60.0
    assert fleet.allocation_s
    assert all(0.0 <= value < fleet.duration_s for value in fleet.allocation_s)
    errors = pose_errors(log_files(run.logs), run.truth_ns, run.truth, run.clock_errors)
    found = against_truth(runs, alignment, read_truth(run.out / "truth.npz"))
    for one, expected in zip(found.robots, errors, strict=True):
        assert len(one.errors_m) > 100
        assert one.errors_m == pytest.approx(expected.errors_m, abs=1e-6)


def test_every_robot_of_the_fused_file_replays_as_its_own_log_does(
    runs: list[Run], alignment: Alignment, tmp_path: Path
) -> None:
    held = fuse(runs, alignment, tmp_path / "fused.mcap")
    assert held.broken == 0
    fused = open_runs([tmp_path / "fused.mcap"])
    assert [run.robot for run in fused] == [0, 1, 2, 3, 4]
    for one in fused:
        report = replay_run(one, ReplayOptions(levels=("L0", "L1", "L2")))
        assert [result.status for result in report.results] == [OK] * 3
        assert report.results[2].compared > 100
    live = replay_run(fused[3], ReplayOptions(levels=("L0", "daemon", "L3")))
    assert [result.status for result in live.results] == [OK] * 3
