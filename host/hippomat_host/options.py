"""The command line of the daemon: what may be said, and the one configuration that comes of it.

Reads the configuration file, knows no port and no clock. Wrong usage is a UsageError with exit code 1: here
2 means "diverged".
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from hippomat_core.config import (
    ALLOCATORS,
    POLICY_ALLOCATORS,
    Config,
    config_from_dict,
)
from hippomat_core.errors import ConfigError, HippomatError
from hippomat_core.fleet.roster import Roster, Tree, merged, parse_roster
from hippomat_core.messages import BASE, LIDAR, PORT_NAMES, RADIO
from hippomat_core.settings_tree import parse_toml
from hippomat_host.acceptance import FLAGS
from hippomat_host.advice import Given
from hippomat_host.serial_port import STABLE_NAMES, existing_ports

DESCRIPTION = """\
The robot's daemon: takes part in the fleet that its radio hears, drives the base, records everything.
With --port alone it observes: it shows the fleet, records, requests nothing and moves nothing.
"""
EPILOG = """\
commands (each has its own --help):
  hippomat-host ports [DEV ...]         list the serial ports and what is behind each
  hippomat-host make-key FILE           make a fleet key
  hippomat-host provision --port DEV    write identity, channel and fleet key into a radio
  hippomat-host radio-info --port DEV   show what a radio is, and whom it hears
  hippomat-host stop --port DEV         stop the whole fleet
  hippomat-host resume --port DEV       let it go on

examples:
  hippomat-host --port /dev/ttyACM0
      watch and record the fleet
  hippomat-host --port /dev/ttyACM0 --base /dev/ttyACM1 --lidar /dev/ttyUSB0 \\
                --map lab.yaml --robot 3 --start 1.0,0.5,0
      be robot 3
  hippomat-host --port /dev/ttyACM0 --fleet fleet.toml --robot 3
      the same, where one file says map, start poses and settings of the whole fleet
  hippomat-host --port /dev/ttyACM0 --base /dev/ttyACM1 --lidar /dev/ttyUSB0 --slam
      make a map while the robot is pushed about; hippomat-logs map saves it
  hippomat-host --port /dev/ttyACM0 --ros ws://localhost:9090 --robot 3
      be robot 3 on a robot that runs ROS: map, pose, lidar and base are ROS's

Ports that are not given default to /dev/hippomat-radio, /dev/hippomat-base and /dev/hippomat-lidar where udev
rules have made them. Ctrl-C (SIGINT), SIGTERM and SIGHUP stop the motors first and then finish the log.

exit codes:
  0  stopped as asked
  1  wrong usage, or something is missing, busy or does not fit (one line on stderr says what to do)
"""


class UsageError(HippomatError):
    """The command line cannot be understood."""


class Parser(argparse.ArgumentParser):
    """argparse would exit with 2."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see `{self.prog} --help`")


def parser() -> Parser:
    """The daemon's options."""
    options = Parser(
        prog="hippomat-host",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="hippomat-host --port DEV [options]\n       hippomat-host COMMAND ...",
        allow_abbrev=False,
    )
    ports = options.add_argument_group("ports")
    ports.add_argument("--port", metavar="DEV", help="the radio (ESP32-S3)")
    ports.add_argument("--base", metavar="DEV", help="the base: motors, encoders, IMU")
    ports.add_argument("--lidar", metavar="DEV", help="the lidar (RPLIDAR A1)")
    ports.add_argument(
        "--ros",
        metavar="URL",
        help="rosbridge, ws://HOST:9090: the map, pose, lidar and base that have no option here are ROS's",
    )
    robot = options.add_argument_group("robot and fleet")
    robot.add_argument(
        "--fleet", metavar="FILE", help="fleet.toml: shared settings, the map, and who starts where"
    )
    robot.add_argument("--config", metavar="FILE", help="settings (TOML); command-line options win over it")
    robot.add_argument(
        "--map",
        metavar="FILE",
        help="the map that the whole fleet shares: a map_server YAML, a recording (lab.bag:/map, run.mcap@30)"
        " or a rosbridge (ws://HOST:9090)",
    )
    robot.add_argument(
        "--slam",
        action="store_true",
        help="find the place in the map by lidar (the default where there is a map); without --map: make one",
    )
    robot.add_argument("--robot", metavar="N", type=int, help="this robot's id; without one it only observes")
    robot.add_argument(
        "--allocator",
        metavar="NAME",
        help=f"how tasks are chosen, as the whole fleet: {', '.join(ALLOCATORS)}",
    )
    robot.add_argument(
        "--policy",
        metavar="FILE",
        help=f"weights (safetensors) for {' or '.join(POLICY_ALLOCATORS)}; default: those of the package",
    )
    robot.add_argument("--start", metavar="X,Y,YAW", help="where it stands: metres and radians, map frame")
    log = options.add_argument_group("recording").add_mutually_exclusive_group()
    log.add_argument("--log", metavar="DIR", help="directory of the run logs (default: runs)")
    log.add_argument("--no-log", action="store_true", help="record nothing")
    replay = options.add_argument_group("replay")
    replay.add_argument(
        "--lockstep", metavar="SOCKET", help="take clock and reads from a replayer (hippomat-replay)"
    )
    return options


def config_of(args: argparse.Namespace) -> Config:
    """Defaults, then the file, then the command line; raises ConfigError for whatever does not fit."""
    if args.robot is not None and args.robot < 0:
        raise ConfigError(f"--robot {args.robot} is not an id; ids begin at 0")
    said = _settings(args.config) if args.config else {}
    roster = roster_of(args)
    if roster is not None:
        robot = said.get("robot", {}).get("id", -1) if args.robot is None else args.robot
        said = merged(roster.settings(robot), said)
    names = [name for name in (args.fleet, args.config) if name]
    config = config_from_dict(
        _with_ros_roles(merged(said, _said(args)), args), " and ".join(names) or "command line"
    )
    if args.policy is not None:
        _check_policy(args.policy, config.fleet.allocator)
    if config.slam.mode == "map" and _map_of(args):
        raise ConfigError(
            f'[slam] mode = "map" makes a new map: leave out {_map_of(args)}, or set mode = "auto"'
        )
    return config


def _settings(path: str) -> Tree:
    tree = parse_toml(_text("--config", path), path)
    for section, values in tree.items():
        if not isinstance(values, dict):
            raise ConfigError(f"{path}: [{section}] must be a table, found {values!r}")
    return tree


def roster_of(args: argparse.Namespace) -> Roster | None:
    """The fleet.toml that was given."""
    return parse_roster(_text("--fleet", args.fleet), args.fleet) if args.fleet else None


def start_joined(arguments: Sequence[str]) -> list[str]:
    """`--start -1,2,0` as one word: argparse takes a value that begins with a minus for an option."""
    joined: list[str] = []
    for word in arguments:
        if joined and joined[-1] == "--start" and word[:1] == "-" and word[1:2] in "0123456789.":
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _said(args: argparse.Namespace) -> Tree:
    """What the command line itself says."""
    tree: Tree = {"robot": {}, "fleet": {}, "log": {}, "ros": {}, "slam": {}}
    if args.robot is not None:
        tree["robot"]["id"] = args.robot
    if args.start is not None:
        tree["robot"] |= _start(args.start)
    if args.allocator is not None:
        tree["fleet"]["allocator"] = args.allocator
    if args.policy is not None:
        tree["fleet"]["policy"] = args.policy
    if args.log is not None:
        tree["log"] |= {"directory": args.log, "enabled": True}
    if args.no_log:
        tree["log"]["enabled"] = False
    if args.ros is not None:
        tree["ros"]["url"] = args.ros
    if args.slam:
        tree["slam"]["mode"] = "auto" if _map_of(args) else "map"
    return tree


def _with_ros_roles(tree: Tree, args: argparse.Namespace) -> Tree:
    """What has a port or a file of its own is not ROS's."""
    if not tree["ros"].get("url"):
        return tree
    given = {"base": args.base, "lidar": args.lidar, "map": _map_of(args)}
    return merged(tree, {"ros": {role: False for role, value in given.items() if value}})


def _map_of(args: argparse.Namespace) -> str:
    """The map that was given, or the one that the fleet.toml names beside itself."""
    roster = None if args.map else roster_of(args)
    if roster is None or not roster.map:
        return args.map or ""
    return str(Path(args.fleet).parent / roster.map)


def _check_policy(path: str, allocator: str) -> None:
    if not path:  # an unset variable of the shell
        raise ConfigError("--policy '' names no file; leave it out for the packaged weights")
    if allocator not in POLICY_ALLOCATORS:
        raise ConfigError(
            f"--policy {path}: allocator {allocator!r} has no weights; give --allocator "
            f"{' or '.join(POLICY_ALLOCATORS)} too"
        )


def given_of(args: argparse.Namespace, config: Config) -> Given:
    """What there is to work with; raises UsageError where there is no radio at all."""
    paths = {}
    for port, stable, value in zip((RADIO, BASE, LIDAR), STABLE_NAMES, _flags(args), strict=True):
        with_ros = config.ros.url and port != RADIO  # its drivers own those devices
        paths[port] = value or (stable if os.path.exists(stable) and not with_ros else "")
    if not paths[RADIO]:
        raise UsageError(f"--port is missing: the radio's serial port; {existing_ports()}")
    if config.slam.mode == "map" and not paths[LIDAR]:
        raise UsageError(
            "--slam makes a map of what a lidar sees: give --lidar DEV (and --base DEV, its wheels)"
        )
    _check_distinct(paths)
    robot = config.robot
    start = f"{robot.start_x_m:g},{robot.start_y_m:g},{robot.start_yaw_rad:g}" if robot.start_known else ""
    return Given(
        *(paths[RADIO], paths[BASE], paths[LIDAR]),
        config=args.config or "",
        map=_map_of(args),
        robot=config.robot.id,
        start=start,
        fleet=args.fleet or "",
        ros=config.ros,
        maps=config.slam.mode == "map",
    )


def _flags(args: argparse.Namespace) -> tuple[str | None, str | None, str | None]:
    return args.port, args.base, args.lidar


def _check_distinct(paths: dict[int, str]) -> None:
    seen: dict[str, int] = {}
    for port, path in paths.items():
        device = os.path.realpath(path)
        if path and device in seen:
            first = seen[device]
            raise UsageError(
                f"{path} was given as {FLAGS[first]} and as {FLAGS[port]}: {PORT_NAMES[first]} and "
                f"{PORT_NAMES[port]} are two devices; `hippomat-host ports` tells them apart"
            )
        seen[device] = port


def _text(option: str, path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{option} {path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{option} {path}: is not a text file; it must be TOML") from None


def _start(text: str) -> dict[str, Any]:
    try:
        x_m, y_m, yaw_rad = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(
            f"--start {text!r} is not X,Y,YAW (metres, metres, radians), e.g. 1.0,0.5,0"
        ) from None
    return {"start_x_m": x_m, "start_y_m": y_m, "start_yaw_rad": yaw_rad, "start_known": True}
