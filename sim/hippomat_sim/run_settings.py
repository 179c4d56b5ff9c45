"""What a simulated run was asked to be, checked, and turned into one hippomat.toml. Knows no processes."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hippomat_core.config import MAX_ROBOTS, MAX_TASK_SLOTS, Config, config_to_dict, parse_config
from hippomat_core.errors import ConfigError
from hippomat_sim.clock_errors import MAX_PPM, MAX_YEARS

IMAGES = (".pgm", ".png", ".bmp")


@dataclass(frozen=True, slots=True)
class Carried:
    """At this time of the run somebody puts the robot there (map frame)."""

    at_s: float
    robot: int
    pose: tuple[float, float, float]  # x, y [m], yaw [rad]


@dataclass(frozen=True, slots=True)
class RunSettings:
    """The command line of `hippomat-sim run`, one to one. speed_mps None: as configured."""

    map_yaml: Path
    out: Path
    robots: int = 5
    tasks: int = 12
    seconds: float = 60.0
    loss: float = 0.1
    seed: int = 1
    speed_mps: float | None = None
    config: Path | None = None
    record_truth: bool = True
    record_logs: bool = True
    sealed: bool = False  # the fleet has a key
    slam: bool | None = None  # localize in the map, or trust the wheels; None: as configured
    resolution_m: float = 0.05  # of a map that is an image without a description
    carried: tuple[Carried, ...] = ()
    clock_years: float = 0.0  # by which the hosts' clocks are off, at most
    clock_ppm: float = 0.0  # and by which they drift


def checked(settings: RunSettings) -> RunSettings:
    """The same settings; ConfigError names the first option that is out of range."""
    ranges = (
        ("--robots", settings.robots, 1, MAX_ROBOTS),
        ("--tasks", settings.tasks, 1, MAX_TASK_SLOTS),
        ("--seconds", settings.seconds, 1.0, 86_400.0),
        ("--loss", settings.loss, 0.0, 1.0),
        ("--seed", settings.seed, 0, 2**31 - 1),
        ("--resolution", settings.resolution_m, 0.005, 1.0),
        ("--clock-years", settings.clock_years, 0.0, MAX_YEARS),
        ("--clock-ppm", settings.clock_ppm, 0.0, MAX_PPM),
        ("--speed", 0.02 if settings.speed_mps is None else settings.speed_mps, 0.02, 5.0),
    )
    for option, value, low, high in ranges:
        if not low <= value <= high:
            raise ConfigError(f"{option} {value} is outside {low} .. {high}")
    for one in settings.carried:
        if not 0 <= one.robot < settings.robots:
            raise ConfigError(f"--carry: robot {one.robot} is not one of 0 .. {settings.robots - 1}")
        if one.at_s >= settings.seconds:
            raise ConfigError(
                f"--carry: {one.at_s:g} s is not before the end of the run at {settings.seconds:g} s"
            )
    if settings.out.exists() and (not settings.out.is_dir() or any(settings.out.iterdir())):
        raise ConfigError(f"--out {settings.out} is not an empty directory; name a new one")
    return settings


def run_config(settings: RunSettings) -> Config:
    """The configuration that all daemons of the run share: the file's, with the command line's numbers."""
    config = Config()
    if settings.config is not None:
        try:
            text = settings.config.read_text(encoding="utf-8")
        except OSError as error:
            message = f"--config {settings.config}: cannot be read: {error.strerror or error}"
            raise ConfigError(message) from None
        config = parse_config(text, str(settings.config))
    fleet = replace(config.fleet, size=settings.robots, task_slots=settings.tasks, seed=settings.seed)
    limits = config.limits
    if settings.speed_mps is not None:
        limits = replace(limits, speed_mps=settings.speed_mps)
    # Who a robot is and where it starts comes from its own command line.
    robot = replace(config.robot, id=-1, start_known=False)
    slam = config.slam
    if settings.slam is not None:
        slam = replace(slam, mode="auto" if settings.slam else "odometry")
    return replace(config, fleet=fleet, limits=limits, robot=robot, slam=slam)


def described_map(settings: RunSettings) -> tuple[Path, str]:
    """The map's description, and its text where it has to be written first: --map may be a bare image."""
    path = settings.map_yaml
    if path.suffix.lower() not in IMAGES:
        return path, ""
    if not path.is_file():
        raise ConfigError(f"--map {path}: there is no such file")
    image = json.dumps(str(path.resolve()))
    text = (
        f"image: {image}\nresolution: {settings.resolution_m!r}\norigin: [0.0, 0.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return settings.out / "map.yaml", text


def config_toml(config: Config) -> str:
    """TOML text; parse_config() gives an equal Config."""
    lines = []
    for section, values in config_to_dict(config).items():
        lines.append(f"[{section}]")
        lines += [f"{key} = {_toml(value)}" for key, value in values.items()]
        lines.append("")
    return "\n".join(lines)


def _toml(value: Any) -> str:
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value)  # strings, integers and booleans look the same in TOML
