"""What --ros takes over and what it leaves alone, and what a robot without the packages for it says."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from hippomat_core.config import Config
from hippomat_core.errors import ConfigError, HippomatError
from hippomat_host import options
from hippomat_host.advice import Given
from hippomat_host.clock import VARIABLE
from hippomat_host.options import config_of, given_of, parser
from hippomat_host.startup import make_links, run

ROS = ("--port", "/dev/radio", "--ros", "ws://robot:9090", "--robot", "3")


def understood(*arguments: str) -> tuple[Config, Given]:
    args = parser().parse_args([*ROS, *arguments])
    config = config_of(args)
    return config, given_of(args, config)


def links(*arguments: str) -> dict[str, str]:
    return {type(link).__name__: link.path for link in make_links(*understood(*arguments))}


def test_ros_alone_is_enough_for_a_robot():
    config, given = understood()
    assert (config.ros.drives, config.ros.scans, config.ros.maps, config.ros.localizes) == (True,) * 4
    assert given.missing == []
    assert given.next_command() == "hippomat-host --port /dev/radio --ros ws://robot:9090 --robot 3"
    assert links() == {
        "SerialLink": "/dev/radio",
        "RosBaseLink": "ws://robot:9090",
        "FeedLink": "ws://robot:9090",
    }


def test_what_has_an_option_of_its_own_is_not_taken_from_ros():
    config, _ = understood("--base", "/dev/base", "--map", "lab.yaml")
    assert (config.ros.drives, config.ros.scans, config.ros.maps, config.ros.localizes) == (
        False,
        True,
        False,
        True,
    )
    assert links("--base", "/dev/base")["GuardLink"] == "/dev/base"
    assert "RosBaseLink" not in links("--base", "/dev/base")


def test_stable_names_of_devices_that_ros_drives_are_left_to_ros(tmp_path: Path, monkeypatch):
    names = tuple(str(tmp_path / name) for name in ("radio", "base", "lidar"))
    for name in names:
        Path(name).touch()
    monkeypatch.setattr(options, "STABLE_NAMES", names)
    _, given = understood()
    assert (given.base, given.lidar) == ("", "")
    args = parser().parse_args([])
    given = given_of(args, config_of(args))
    assert (given.radio, given.base, given.lidar) == names


def test_an_observer_drives_nothing_through_ros_either():
    args = parser().parse_args(ROS[:4])
    config = config_of(args)
    kinds = {type(link).__name__ for link in make_links(config, given_of(args, config))}
    assert kinds == {"SerialLink", "FeedLink"}


@pytest.mark.parametrize(
    ("off", "said"),
    [((), "map = true and lidar = true"), (("map",), "lidar = true"), (("lidar",), "map = true")],
)
def test_making_a_map_with_ros_behind_map_or_lidar_is_refused(tmp_path: Path, off, said):
    settings = tmp_path / "hippomat.toml"
    settings.write_text("[ros]\n" + "".join(f"{role} = false\n" for role in off))
    with pytest.raises(ConfigError, match=rf"mode = \"map\" .* \[ros\] {said}\b.*; .*--lidar DEV"):
        understood("--slam", "--config", str(settings))
    settings.write_text("[ros]\nmap = false\nlidar = false\n")
    assert understood("--slam", "--lidar", "/dev/l", "--config", str(settings))[0].slam.mode == "map"
    assert understood("--slam", "--map", "lab.yaml")[0].slam.mode == "auto"


def test_an_address_that_is_none_is_refused():
    with pytest.raises(ConfigError, match=r"is no rosbridge address: give ws://HOST:9090"):
        config_of(parser().parse_args(["--port", "/dev/x", "--ros", "robot:9090"]))


def test_a_simulators_clock_is_refused_where_ros_is_behind_the_robot(tmp_path: Path, monkeypatch):
    """A clock that stands still would disarm what stops the base, and nothing says that ROS is simulated."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "clock"))
    config, given = understood("--no-log")
    given = replace(given, radio="/dev/pts/0")
    with pytest.raises(HippomatError, match="HIPPOMAT_CLOCK is set, but ws://robot:9090 is no simulated dev"):
        run(config, given, None)


@pytest.mark.parametrize("package", ["websockets", "cbor2"])
def test_a_missing_package_is_one_line_with_the_command_that_brings_it(package: str):
    hidden = f"import sys; sys.modules['{package}'] = None; from hippomat_host.ros.feed import main;"
    run = 'sys.exit(main(\'{"url": "ws://127.0.0.1:9"}\'))'
    done = subprocess.run(
        [sys.executable, "-c", hidden + run], capture_output=True, text=True, timeout=60, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.returncode == 1
    assert f"{package}" in done.stdout
    assert "is not installed: pip install 'hippomat[ros]'" in done.stdout
    assert done.stderr == ""


def test_a_daemon_loads_without_the_packages_for_ros():
    hidden = "import sys; sys.modules.update(dict.fromkeys(('websockets', 'cbor2')));"
    done = subprocess.run(
        [sys.executable, "-c", hidden + "import hippomat_host.startup"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
