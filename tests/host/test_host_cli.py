"""What a user sees: a line and an exit code for each mistake, and an observer that moves nothing."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
from host_devices import Base, Lidar, Radio, Silent, plugged, wait_until
from host_process import hippomat_host, robot_in, write_room

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_host.options import UsageError, config_of, given_of, parser, start_joined
from hippomat_logs.map_files import save_map


def refused(*arguments: object, cwd: Path | None = None) -> str:
    """The one line on stderr of a run that ends with exit code 1."""
    ended = hippomat_host(*arguments, cwd=cwd)
    lines = ended.stderr.splitlines()
    assert ended.returncode == 1, ended
    assert len(lines) == 1, ended.stderr
    assert lines[0].startswith("hippomat-host: ")
    return lines[0].removeprefix("hippomat-host: ")


def test_help_explains_itself_and_exits_with_0() -> None:
    ended = hippomat_host("--help")
    assert ended.returncode == 0
    for part in ("--port DEV", "examples:", "exit codes:", "hippomat-host ports"):
        assert part in ended.stdout


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ([], ("--port is missing",)),
        (["--port"], ("expected one argument", "--help")),
        (["--prot", "x"], ("unrecognized arguments: --prot", "--help")),
        (["--port", "x", "--robot", "two"], ("--robot", "'two'")),
        (["--port", "x", "--robot", "-3"], ("--robot -3", "ids begin at 0")),
        (["--port", "x", "--robot", "7"], ("id = 7", "fleet of size 5")),
        (["--port", "x", "--start", "1,2"], ("--start '1,2'", "X,Y,YAW")),
        (["--port", "x", "--start", "nan,0,0"], ("start_x_m", "outside")),
        (["--port", "x", "--config", "no.toml"], ("no.toml", "No such file")),
        (["--port", "x", "--map", "no.yaml"], ("no.yaml", "No such file")),
        (["--port", "x", "--log", "d", "--no-log"], ("not allowed with",)),
        (["--port", "x", "--base", "x"], ("--port and as --base", "two devices")),
        (["--port", "/dev/ttyUSB99"], ("/dev/ttyUSB99 does not exist", "ports that exist")),
        (["--port", "/dev/null"], ("/dev/null is not a serial port",)),
        (["ports", "--all"], ("unrecognized arguments: --all",)),
    ],
)
def test_a_usage_error_is_one_line_and_exit_code_1(
    tmp_path: Path, arguments: list[str], parts: tuple[str, ...]
) -> None:
    line = refused(*arguments, cwd=tmp_path)
    for part in parts:
        if part == "ports that exist":
            assert part in line or "no serial port is plugged in" in line
        else:
            assert part in line


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("[fleet]\nsice = 5\n", ("[fleet]", "'sice'", "known: id, size")),
        ("[fleets]\n", ("[fleets]", "known: fleet")),
        ("[limits]\nspeed_mps = 99.0\n", ("speed_mps = 99.0", "0.02 .. 5.0")),
        ("[fleet]\nallocator = 'best'\n", ("allocator = 'best'", "hungarian")),
        ("[fleet\n", ("not valid TOML",)),
        ("[fleet]\npolicy = 'no.safetensors'\n", ("no.safetensors", "No such file")),
    ],
)
def test_a_configuration_that_cannot_be_used_is_named(
    tmp_path: Path, text: str, parts: tuple[str, ...]
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    line = refused("--port", "/dev/ttyUSB99", "--config", path, cwd=tmp_path)
    for part in parts:
        assert part in line


def test_a_map_without_its_image_is_named(tmp_path: Path) -> None:
    path = write_room(tmp_path)
    (tmp_path / "room.pgm").unlink()
    assert "names image room.pgm, which does not exist" in refused("--port", "x", "--map", path)


def test_a_wrong_device_behind_a_port_is_named_and_nothing_is_recorded(tmp_path: Path) -> None:
    base, lidar, radio = Base(tmp_path / "b"), Lidar(tmp_path / "l"), Radio(tmp_path / "r")
    with plugged(base, lidar, radio):
        assert f"{base.link} is the base, not the radio: use --base {base.link}" in refused(
            "--port", base.link, cwd=tmp_path
        )
        assert f"{lidar.link} is the lidar, not the base: use --lidar {lidar.link}" in refused(
            "--port", radio.link, "--base", lidar.link, cwd=tmp_path
        )
        assert f"{base.link} is the base, not the lidar" in refused(
            "--port", radio.link, "--lidar", base.link, cwd=tmp_path
        )
        assert base.received == []  # it was known by listening
    assert not (tmp_path / "runs").exists()


def test_a_silent_port_is_named(tmp_path: Path) -> None:
    silent = Silent(tmp_path / "s")
    with plugged(silent):
        line = refused("--port", silent.link)
    assert f"no radio on {silent.link} (found: silent)" in line


def test_a_radio_with_another_protocol_is_refused(tmp_path: Path) -> None:
    radio = Radio(tmp_path / "radio", protocol=3)
    with plugged(radio):
        line = refused("--port", radio.link)
    assert "speaks protocol 3" in line
    assert "pio run -t upload" in line


def test_an_observer_shows_the_next_command_records_and_writes_nothing_but_hello(tmp_path: Path) -> None:
    with robot_in(tmp_path) as robot:
        robot.options = ["--port", str(robot.radio.link), "--log", str(robot.log)]
        process = robot.start()
        assert wait_until(lambda: "hears nobody" in robot.said()), robot.said()
        busy = refused("--port", robot.radio.link)
        assert f"in use by process {process.pid} (" in busy
        listed = hippomat_host("ports", robot.radio.link, robot.base.link)
        assert f"in use by process {process.pid}" in " ".join(listed.stdout.split())
        assert "JetBot ROS AI kit" in listed.stdout
        process.send_signal(signal.SIGINT)
        assert process.wait(10.0) == 0
        said = robot.said()
        assert "missing: the base (--base), the lidar (--lidar), the fleet's map (--map)" in said
        assert (
            f"next: hippomat-host --port {robot.radio.link} --base BASE --lidar LIDAR --map MAP.yaml" in said
        )
        assert [hello.robot for hello in robot.radio.hellos] == [255] * len(robot.radio.hellos)
        assert robot.radio.bodies == []
        assert robot.base.velocities == []
        (log,) = robot.log.iterdir()
        assert log.name.startswith("observer_")
        assert log.suffix == ".mcap"


def test_a_log_directory_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    radio = Radio(tmp_path / "radio")
    with plugged(radio):
        line = refused("--port", radio.link, "--log", tmp_path / "file")
    assert "file" in line
    assert "--no-log" in line


@pytest.mark.parametrize(
    ("start", "said"),
    [("100,0,0", "--start 100,0 is outside the map"), ("-2.98,0,0", "is not a free place of the map")],
)
def test_a_start_that_cannot_be_is_refused_at_once(tmp_path: Path, start: str, said: str) -> None:
    grid = np.zeros((60, 120), np.int8)
    grid[:, 0] = 100
    save_map(OccupancyGrid(grid, 0.05, -3.0, -1.5), tmp_path / "room.yaml")
    where = ["--port", tmp_path / "none", "--map", tmp_path / "room.yaml", "--robot", 0, f"--start={start}"]
    assert said in refused(*where, "--no-log")


def test_a_start_pose_with_a_negative_x_needs_no_equals_sign():
    args = parser().parse_args(start_joined(["--port", "x", "--start", "-1,-2.5,0", "--robot", "1"]))
    assert args.start == "-1,-2.5,0"
    assert start_joined(["--start", "--map", "-5"]) == ["--start", "--map", "-5"]


def test_making_a_map_without_a_lidar_is_refused_and_with_one_nothing_of_a_map_is_missing():
    args = parser().parse_args(["--port", "x", "--slam", "--robot", "0"])
    with pytest.raises(UsageError, match="give --lidar DEV"):
        given_of(args, config_of(args))
    args = parser().parse_args(["--port", "x", "--slam", "--robot", "0", "--lidar", "y"])
    given = given_of(args, config_of(args))
    assert given.missing == ["the base (--base)"]
    assert given.next_command().endswith("--robot 0 --slam")
