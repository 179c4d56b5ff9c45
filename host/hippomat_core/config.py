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
    radius_m: float = number(0.12, 0.02, 2.0)  # of a disc that holds the whole body
    footprint: tuple[tuple[float, ...], ...] = ()  # convex outline ((x, y), ..) [m], base frame; (): the disc

    def starting_at(self, pose: tuple[float, float, float]) -> RobotConfig:
        """The same robot, which knows that it starts at x, y [m], yaw [rad] (map frame)."""
        x_m, y_m, yaw_rad = pose
        return dataclasses.replace(
            self, start_x_m=x_m, start_y_m=y_m, start_yaw_rad=yaw_rad, start_known=True
        )


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
    """What may be commanded; the defaults suit a first run. All but turning in place bounds driving too."""

    speed_mps: float = number(0.2, 0.02, 5.0)
    accel_mps2: float = number(0.5, 0.05, 20.0)
    decel_mps2: float = number(
        0.5, 0.05, 20.0
    )  # the base must brake at least like this: the guard counts on it
    lateral_accel_mps2: float = number(0.5, 0.01, 20.0)  # speed times turn rate
    curvature_per_m: float = number(10.0, 0.1, 100.0)  # of the way driven; turning in place has none
    turn_radps: float = number(1.5, 0.1, 10.0)
    turn_accel_radps2: float = number(6.0, 0.1, 50.0)


@dataclass(frozen=True, slots=True)
class ControlConfig:
    """Regulated pure pursuit; docs/control.md has nav2's name of each."""

    lookahead_s: float = number(1.0, 0.1, 10.0)  # at the measured speed, within the next two
    lookahead_min_m: float = number(0.2, 0.05, 5.0)
    lookahead_max_m: float = number(0.6, 0.05, 10.0)
    regulated_radius_m: float = number(0.3, 0.0, 10.0)  # tighter curves are driven slower; 0: not so
    proximity_m: float = number(0.06, 0.0, 5.0)  # with less room beside the body: slower; 0: not so
    regulated_min_mps: float = number(0.05, 0.01, 5.0)  # neither of the two slows further than this
    rotate_from_rad: float = number(
        0.6, 0.1, 3.2
    )  # heading error at which the robot stops and turns in place
    rotate_until_rad: float = number(0.12, 0.01, 1.5)  # and at which it drives on


@dataclass(frozen=True, slots=True)
class RecoveryConfig:
    """When a robot counts as stuck, and what it tries before it gives its task back."""

    stuck_s: float = number(8.0, 1.0, 600.0)  # without moving by progress_m although it should
    waiting_s: float = number(60.0, 1.0, 3600.0)  # the same while it waits for a robot that is heard
    distant_s: float = number(40.0, 20.0, 3600.0)  # without coming nearer to the goal by progress_m
    progress_m: float = number(0.1, 0.02, 5.0)
    retry_s: float = number(5.0, 1.0, 600.0)  # after an attempt, before the next one
    back_m: float = number(0.25, 0.0, 2.0)  # backed up along the way it came
    back_mps: float = number(0.08, 0.02, 1.0)
    wait_s: float = number(5.0, 0.0, 600.0)
    shun_s: float = number(60.0, 0.0, 3600.0)  # a task that was given up is not claimed again so soon


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
    latency_s: float = number(
        0.25, 0.0, 5.0
    )  # from the odometry's last frame to the wheels: loop, link, base
    obstacle_speed_mps: float = number(0.0, 0.0, 5.0)  # what is seen may come nearer as fast as this


@dataclass(frozen=True, slots=True)
class SlamConfig:
    """Where the robot is: from its lidar and a saved map, or from its wheels alone."""

    mode: str = choice("auto", "auto", "odometry", "map")  # auto: localize in the map; map: make one
    score_min: float = number(0.65, 0.1, 1.0)  # share of a scan's evidence that must speak for the pose
    lost_after_s: float = number(1.5, 0.2, 30.0)  # without a scan that fits
    lost_radius_m: float = number(0.5, 0.05, 10.0)  # 95 % of the pose's error; beyond it, it is not known
    odometry_noise_m: float = number(0.04, 0.001, 1.0)  # standard deviation after one metre
    odometry_noise_rad: float = number(0.06, 0.001, 1.0)  # after one radian turned, or one metre driven


@dataclass(frozen=True, slots=True)
class RosConfig:
    """ROS through rosbridge (docs/ros.md); what has a serial port or a file of its own is not ROS's."""

    url: str = ""  # ws://HOST:9090; "": no ROS
    map: bool = True  # /map is the fleet's map
    pose: bool = True  # /tf says where the robot is
    lidar: bool = True  # /scan
    base: bool = True  # /cmd_vel drives
    map_topic: str = "/map"
    scan_topic: str = "/scan"
    odom_topic: str = "/odom"  # measured speed; "": from /tf
    tf_topic: str = "/tf"
    tf_static_topic: str = "/tf_static"
    cmd_vel_topic: str = "/cmd_vel"
    cmd_vel_type: str = choice("Twist", "Twist", "TwistStamped")
    cmd_vel_hz: float = number(20.0, 5.0, 100.0)
    map_frame: str = "map"
    base_frame: str = "base_link"  # turns in place about its origin
    encoding: str = choice("cbor-raw", "cbor-raw", "json")
    pose_timeout_s: float = number(0.5, 0.1, 10.0)  # age of odom -> base
    localization_timeout_s: float = number(3.0, 0.1, 600.0)  # age of map -> odom

    @property
    def maps(self) -> bool:
        """The map comes from ROS."""
        return bool(self.url) and self.map

    @property
    def localizes(self) -> bool:
        """The pose comes from ROS."""
        return bool(self.url) and self.pose

    @property
    def scans(self) -> bool:
        """The lidar is ROS's."""
        return bool(self.url) and self.lidar

    @property
    def drives(self) -> bool:
        """The base is ROS's."""
        return bool(self.url) and self.base


@dataclass(frozen=True, slots=True)
class LogConfig:
    """Recording. Part files rotate by size and age; a run that does not fit the disk is refused."""

    directory: str = "runs"
    enabled: bool = True
    part_mib: int = number(512, 1, 100_000)
    part_s: float = number(1800.0, 0.0, 604_800.0)  # 0: only by size
    expected_min: float = number(30.0, 0.0, 100_000.0)  # room for so much must be free at the start
    rate_mib_per_min: float = number(12.0, 0.01, 10_000.0)  # what a robot with base, lidar and radio records
    low_mib: int = number(100, 0, 1_000_000)  # free room below which bulk is shed; decisions stay


@dataclass(frozen=True, slots=True)
class Config:
    """The whole tree; sections have the names that hippomat.toml uses."""

    fleet: FleetConfig = FleetConfig()
    robot: RobotConfig = RobotConfig()
    lidar: LidarConfig = LidarConfig()
    limits: LimitsConfig = LimitsConfig()
    control: ControlConfig = ControlConfig()
    recovery: RecoveryConfig = RecoveryConfig()
    planning: PlanningConfig = PlanningConfig()
    guard: GuardConfig = GuardConfig()
    slam: SlamConfig = SlamConfig()
    ros: RosConfig = RosConfig()
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
    if config.ros.url and not config.ros.url.startswith(("ws://", "wss://")):
        raise ConfigError(
            f"{name}: [ros] url = {config.ros.url!r} is no rosbridge address: give ws://HOST:9090"
        )
    if config.ros.drives and not config.ros.pose:
        raise ConfigError(
            f"{name}: [ros] base = true needs pose = true: a base behind ROS tells where it is as /tf, "
            "or give --base DEV"
        )
    of_ros = [role for role, has in (("map", config.ros.maps), ("lidar", config.ros.scans)) if has]
    if config.slam.mode == "map" and of_ros:
        roles = " and ".join(f"{role} = true" for role in of_ros)
        raise ConfigError(
            f'{name}: [slam] mode = "map" (--slam without --map) does not go with [ros] {roles}: '
            "a map is made by a serial lidar; give --lidar DEV and set [ros] map = false, "
            "or leave out --slam and use ROS's map"
        )
    body_m = robot.radius_m + config.guard.margin_m
    if planning.inflation_radius < body_m:
        raise ConfigError(
            f"{name}: [planning] inflation_radius = {planning.inflation_radius} is less than "
            f"[robot] radius_m + [guard] margin_m = {body_m:.3f}: "
            "the guard would stop the robot on its own path"
        )

    if config.control.lookahead_min_m > config.control.lookahead_max_m:
        raise ConfigError(
            f"{name}: [control] lookahead_min_m = {config.control.lookahead_min_m} is more than "
            f"lookahead_max_m = {config.control.lookahead_max_m}: lower one or raise the other"
        )
    if config.control.rotate_until_rad >= config.control.rotate_from_rad:
        raise ConfigError(
            f"{name}: [control] rotate_until_rad = {config.control.rotate_until_rad} must be less than "
            f"rotate_from_rad = {config.control.rotate_from_rad}, or the robot never stops turning"
        )
    _check_footprint(robot, name)


def _check_footprint(robot: RobotConfig, name: str) -> None:
    """Convex, counter-clockwise, around the base's origin and inside the disc that planning reckons with."""
    corners = robot.footprint
    if not corners:
        return
    where = f"{name}: [robot] footprint"
    if len(corners) < 3 or any(len(corner) != 2 for corner in corners):
        raise ConfigError(f"{where} needs three corners [x, y] or more, found {corners!r}")
    if not all(math.isfinite(value) for corner in corners for value in corner):
        raise ConfigError(f"{where} holds what is no length: {corners!r}")
    for k, (x, y) in enumerate(corners):
        if math.hypot(x, y) > robot.radius_m:
            raise ConfigError(
                f"{where}: corner [{x}, {y}] lies outside [robot] radius_m = {robot.radius_m}, the disc that "
                f"planning and peers keep clear: set radius_m = {math.ceil(math.hypot(x, y) * 1000) / 1000}"
            )
        (x1, y1), (x2, y2) = corners[(k + 1) % len(corners)], corners[(k + 2) % len(corners)]
        if x * y1 - y * x1 <= 0.0:
            raise ConfigError(f"{where} must run counter-clockwise around [0, 0]; it does not at [{x}, {y}]")
        if (x1 - x) * (y2 - y1) - (y1 - y) * (x2 - x1) < 0.0:
            raise ConfigError(f"{where} must be convex; it is not at [{x1}, {y1}]: leave that corner out")


def config_to_dict(config: Config) -> dict[str, Any]:
    """The inverse of config_from_dict."""
    return dataclasses.asdict(config)
