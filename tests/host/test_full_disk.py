"""A log disk that runs low or full: the daemon drives on and says what it does not record."""

from __future__ import annotations

import resource
from pathlib import Path

from host_devices import wait_until
from host_process import driving_robot, robot_in

from hippomat_core import messages as m
from hippomat_logs.reader import open_runs
from hippomat_logs.recovery import recover_directory


def test_a_low_disk_costs_scans_and_no_decision(tmp_path: Path) -> None:
    with robot_in(tmp_path) as robot:
        config = tmp_path / "hippomat.toml"
        config.write_text(config.read_text() + "[log]\nlow_mib = 1000000\nexpected_min = 0.0\n")
        process = robot.start()
        assert wait_until(robot.drives, 30.0), robot.said()
        process.terminate()
        process.wait(20)
    assert "scans, grids and views are not recorded, decisions are" in robot.said()
    assert "of bulk shed" in robot.said()
    (run,) = open_runs([robot.log])
    kinds = {type(record.message) for record in run.records_in_order()}
    assert {m.Drive, m.RoundDecided, m.ClaimChanged} <= kinds
    assert m.ScanReceived not in kinds


def test_a_disk_that_is_full_does_not_stop_the_robot(tmp_path: Path) -> None:
    with driving_robot(tmp_path) as robot:
        assert robot.process is not None
        resource.prlimit(
            robot.process.pid, resource.RLIMIT_FSIZE, (20_000, 20_000)
        )  # the log has more already
        assert wait_until(lambda: "log: disk: File too large" in robot.said(), 20.0), robot.said()
        assert wait_until(robot.sends_states, 5.0)
        robot.radio.bodies.clear()
        assert wait_until(robot.sends_states, 5.0), "the daemon has stopped"
        robot.process.terminate()
        assert robot.process.wait(20) == 0
    assert " LOST" in robot.said()
    recover_directory(robot.log)
    (run,) = open_runs([robot.log])
    assert sum(1 for _ in run.records_in_order()) > 50


def test_a_run_that_does_not_fit_is_refused_before_anything_moves(tmp_path: Path) -> None:
    with robot_in(tmp_path) as robot:
        config = tmp_path / "hippomat.toml"
        config.write_text(config.read_text() + "[log]\nexpected_min = 100000.0\nrate_mib_per_min = 10000.0\n")
        assert robot.start().wait(30) == 1
        assert not robot.drives()
    assert "make room, choose another disk (--log DIR), or lower [log] expected_min" in robot.said().replace(
        "\n", " "
    )
