"""One frozen tree of settings, read once by the command line and passed down. Knows TOML text, not files.

Every number has a range; an unknown key or a value outside its range is refused by name.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, get_type_hints

from hippomat_core.errors import ConfigError
from hippomat_core.settings_tree import choice, number, parse_toml, read_table

PLANNERS = ("window", "pibt", "replan")
MAX_ROBOTS = 64
MAX_TASK_SLOTS = 80
BASELINES = ("hungarian", "look_ahead", "greedy", "nearest", "auction", "ipso_g", "random", "fixed_slot")
POLICY_ALLOCATORS = ("graphsage", "paper_network")  # decide with trained weights
ALLOCATORS = (*POLICY_ALLOCATORS, *BASELINES)
ROBOTS_PER_SECOND_OF_ROUND = 320  # STATE and two relays in slots of 1.04 ms: 32 robots in 100 ms


@dataclass(frozen=True, slots=True)
class FleetConfig:
    """What every robot of a fleet must agree on; all of it enters the fleet digest."""

    id: int = number(1, 0, 255)
    size: int = number(5, 1, MAX_ROBOTS)  # roster: robot ids 0 .. size-1
    channel: int = number(1, 1, 13)  # Wi-Fi, 2.4 GHz
    task_slots: int = number(12, 1, MAX_TASK_SLOTS)  # M
    seed: int = number(1, 0, 2**31 - 1)
    round_s: float = number(0.1, 0.05, 1.0)
    c_max_s: float = number(0.0, 0.0, 10_000.0)  # 0: derived from the map
    allocator: str = choice("graphsage", *ALLOCATORS)
    policy: str = ""  # path of a safetensors file, for POLICY_ALLOCATORS; graphsage has a default
    policy_per_robot: bool = False  # weights may differ between robots and stay out of the digest
    turnover: str = choice("on_claim", "on_claim", "on_completion", "never")
    handover_gain_s: float = number(0.0, 0.0, 600.0)  # 0: whoever claims a task serves it
    task_source: str = choice("continuous", "continuous", "orders")
    partition: str = choice("auto", "auto", "wait", "serve")  # auto: serve for rosters under 3
    dwell_s: float = number(0.5, 0.0, 600.0)
    goal_tolerance_m: float = number(0.1, 0.01, 5.0)


@dataclass(frozen=True, slots=True)
class RobotConfig:
    """Which robot this is, its body and where it stands at the start (map frame)."""

    id: int = number(-1, -1, MAX_ROBOTS - 1)  # -1: not given, the daemon only observes
    start_x_m: float = number(0.0, -1000.0, 1000.0)
    start_y_m: float = number(0.0, -1000.0, 1000.0)
    start_yaw_rad: float = number(0.0, -2 * math.pi, 2 * math.pi)
    start_known: bool = False
    radius_m: float = number(0.12, 0.02, 2.0)


@dataclass(frozen=True, slots=True)
class LidarConfig:
    """Pose of the lidar in the base frame (x forward, y left); the JetBot ROS AI kit has it backwards."""

    x_m: float = number(0.0, -1.0, 1.0)
    y_m: float = number(0.0, -1.0, 1.0)
    z_m: float = number(0.15, 0.0, 3.0)
    yaw_rad: float = number(math.pi, -2 * math.pi, 2 * math.pi)
    min_range_m: float = number(0.15, 0.0, 5.0)
    max_range_m: float = number(12.0, 0.5, 100.0)
    timeout_s: float = number(0.5, 0.1, 10.0)


@dataclass(frozen=True, slots=True)
class LimitsConfig:
    """Speeds the follower may command; the defaults suit a first run."""

    speed_mps: float = number(0.2, 0.02, 5.0)
    accel_mps2: float = number(0.5, 0.05, 20.0)
    turn_radps: float = number(1.5, 0.1, 10.0)
    turn_accel_radps2: float = number(6.0, 0.1, 50.0)


@dataclass(frozen=True, slots=True)
class PlanningConfig:
    """Costmap and reservations. The first three names are nav2's."""

    planner: str = choice("replan", *PLANNERS)  # window, pibt: all robots' moves are planned together
    inflation_radius: float = number(0.17, 0.02, 5.0)  # [m] cells nearer to an obstacle are not entered
    cost_scaling_factor: float = number(10.0, 0.1, 100.0)
    allow_unknown: bool = False
    peer_margin_m: float = number(0.06, 0.0, 2.0)  # gap kept between two footprints when reserving
    intent_horizon_m: float = number(0.6, 0.05, 5.0)
    replan_after_blockages: int = number(3, 1, 100)  # the paper's threshold
    blockage_s: float = number(0.3, 0.05, 10.0)  # one blockage = stopped this long before a taken cell
    peer_stale_s: float = number(1.0, 0.2, 60.0)


@dataclass(frozen=True, slots=True)
class GuardConfig:
    """The scan guard next to the motors."""

    margin_m: float = number(0.03, 0.0, 1.0)
    latency_s: float = number(0.25, 0.0, 5.0)  # scan age + loop + base reaction


@dataclass(frozen=True, slots=True)
class LogConfig:
    """Recording; part files rotate by size."""

    directory: str = "runs"
    enabled: bool = True
    part_mib: int = number(512, 1, 100_000)


@dataclass(frozen=True, slots=True)
class Config:
    """The whole tree; sections have the names that hippomat.toml uses."""

    fleet: FleetConfig = FleetConfig()
    robot: RobotConfig = RobotConfig()
    lidar: LidarConfig = LidarConfig()
    limits: LimitsConfig = LimitsConfig()
    planning: PlanningConfig = PlanningConfig()
    guard: GuardConfig = GuardConfig()
    log: LogConfig = LogConfig()


def parse_config(text: str, name: str = "hippomat.toml") -> Config:
    """Config from TOML text; raises ConfigError naming `name`, section, key, value and remedy."""
    return config_from_dict(parse_toml(text, name), name)


def config_from_dict(tree: dict[str, Any], name: str = "hippomat.toml") -> Config:
    """Config from nested dictionaries (TOML or a log's manifest); refuses what it does not know."""
    sections = {f.name: f for f in dataclasses.fields(Config)}
    hints = get_type_hints(Config)
    parts: dict[str, Any] = {}
    for section, values in tree.items():
        if section not in sections:
            raise ConfigError(f"{name}: unknown section [{section}]; known: {', '.join(sections)}")
        if not isinstance(values, dict):
            raise ConfigError(f"{name}: [{section}] must be a table, found {values!r}")
        parts[section] = read_table(hints[section], values, f"{name}: [{section}]")
    config = Config(**parts)
    _check_together(config, name)
    return config


def _check_together(config: Config, name: str) -> None:
    """What no single key can break."""
    fleet, robot, planning = config.fleet, config.robot, config.planning
    if robot.id >= fleet.size:
        raise ConfigError(
            f"{name}: [robot] id = {robot.id} is not in a fleet of size {fleet.size} "
            f"(ids 0..{fleet.size - 1}); raise [fleet] size or choose another id"
        )
    if fleet.handover_gain_s and fleet.turnover == "on_claim":
        raise ConfigError(
            f"{name}: [fleet] handover_gain_s = {fleet.handover_gain_s} needs a task that stays in its slot: "
            "set turnover to on_completion or never, or handover_gain_s = 0"
        )
    if not math.isclose(fleet.round_s * 1000, round(fleet.round_s * 1000), abs_tol=1e-6):
        raise ConfigError(
            f"{name}: [fleet] round_s = {fleet.round_s} is no whole number of milliseconds, in which radios "
            f"count: set round_s = {round(fleet.round_s, 3)}"
        )
    if fleet.size > ROBOTS_PER_SECOND_OF_ROUND * fleet.round_s + 1e-9:
        least_ms = math.ceil(fleet.size * 1000 / ROBOTS_PER_SECOND_OF_ROUND)
        raise ConfigError(
            f"{name}: [fleet] size = {fleet.size} does not fit on the air in rounds of {fleet.round_s} s: "
            f"set round_s = {least_ms / 1000} or more"
        )
    body_m = robot.radius_m + config.guard.margin_m
    if planning.inflation_radius < body_m:
        raise ConfigError(
            f"{name}: [planning] inflation_radius = {planning.inflation_radius} is less than "
            f"[robot] radius_m + [guard] margin_m = {body_m:.3f}: "
            "the guard would stop the robot on its own path"
        )


def config_to_dict(config: Config) -> dict[str, Any]:
    """The inverse of config_from_dict."""
    return dataclasses.asdict(config)
