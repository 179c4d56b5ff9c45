"""A fleet killed with kill -9 in the middle of its work: what was written is not lost, and replays."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import psutil
import pytest
from host_devices import wait_until
from host_process import robot_in
from sim_rooms import box_room
from test_software_in_the_loop import started

from hippomat_logs.map_files import save_map
from hippomat_logs.replay_cli import main as replay


def start_and_stop_a_daemon_that_logs_to(log: Path, devices: Path) -> None:
    devices.mkdir()
    with robot_in(devices) as robot:
        robot.options = ["--port", str(robot.radio.link), "--log", str(log)]
        process = robot.start()
        assert wait_until(lambda: "hears nobody" in robot.said()), robot.said()
        process.send_signal(signal.SIGINT)
        assert process.wait(10.0) == 0


@pytest.mark.timeout(180)
def test_every_log_of_a_killed_fleet_is_recovered_at_the_next_start_and_replays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    room_yaml, out = tmp_path / "room.yaml", tmp_path / "out"
    save_map(box_room(3.0, 2.5), room_yaml)
    run = started(room_yaml, out)
    time.sleep(8.0)  # past the silence after the start, into the first claims
    for child in psutil.Process(run.pid).children():
        if "hippomat_host" in child.cmdline():
            child.kill()
    run.send_signal(signal.SIGINT)
    run.communicate(timeout=30)
    unfinished = sorted(out.glob("logs/robot*/*.mcap.active"))
    assert len(unfinished) == 2

    for log in sorted(out.glob("logs/robot*")):
        start_and_stop_a_daemon_that_logs_to(log, tmp_path / f"next-{log.name}")

    assert not list(out.glob("logs/robot*/*.active"))
    recovered = [path.with_suffix("") for path in unfinished]
    assert all(path.is_file() for path in recovered)
    capsys.readouterr()
    assert replay([*map(str, recovered), "--levels", "L0,L1,L2"]) == 3  # their ends are missing
    said = capsys.readouterr().out
    assert said.count("reproduced L1 L2 of a log that is not whole") == 2
