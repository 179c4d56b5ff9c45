"""Everything the robot core remembers between two events. A value: step() makes a new one.

Knows no port and no clock; what the state means for the next event is decided in step.py and tick.py.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.policy_file import read_policy
from hippomat_core.config import Config
from hippomat_core.control.nav_state import Navigator, NavOutcome
from hippomat_core.control.recovery import Recovery
from hippomat_core.control.stopping import Points
from hippomat_core.fleet import state as fleet_state
from hippomat_core.fleet.progress import Progress
from hippomat_core.fleet.radio_health import RadioHealth
from hippomat_core.fleet.state import FleetState
from hippomat_core.mapping import Charting, first_charting
from hippomat_core.planning.field_cache import Fields
from hippomat_core.planning.ground import Ground
from hippomat_core.replaced import replace
from hippomat_core.ros.feed import RosFeed
from hippomat_core.slam.localizer import Localizer
from hippomat_core.slam.odometry import Odometry
from hippomat_core.slam.pose2 import Pose, compose
from hippomat_core.slam.steady_clock import SteadyClock
from hippomat_core.slam.sweep import SAMPLE_NS
from hippomat_core.wire.frames import FLAG_STOPPED, LAST_STOP, Header, StateFrame

NEVER = -(10**18)


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """The latest sweep's returns in the base frame, and the pose (State.steady_pose) they were taken at.

    With them, points of earlier sweeps that the robot came too near to for the lidar to see them still.
    """

    stamp_ns: int
    points: Points  # (n, 2) [m]
    pose: Pose
    whole: bool = (
        True  # False: part of the circle was not looked at, and shows no thing though one may be there
    )


@dataclass(frozen=True, slots=True)
class Stop:
    """The STOP latch: the counter of the last STOP heard (from 1 on), and the last that was resumed.

    In doubt it stays latched: nothing but a STOP moves `counter`, and `resumed` never passes it, so that no
    RESUME and no peer's row can take the effect from a STOP that comes later.
    """

    counter: int = 0
    resumed: int = 0
    authentic: bool = True  # it came sealed with the fleet's key

    @property
    def latched(self) -> bool:
        return self.counter > self.resumed

    @property
    def text(self) -> str:
        """The alarm while it is latched: what it is and how it ends."""
        heard = f"STOP {self.counter} was heard: standing still until it is resumed (hippomat-host resume)"
        return heard if self.authentic else f"{heard}; this fleet is OPEN: anybody in range can send it"

    def raised(self, counter: int, authentic: bool) -> Stop:
        """After a STOP."""
        return self if counter <= self.counter else Stop(counter, self.resumed, authentic)

    def lifted(self, counter: int) -> Stop:
        """After a RESUME, which answers the STOP of its counter and no other."""
        lifts = self.resumed != counter == self.counter != LAST_STOP
        return replace(self, resumed=counter) if lifts else self

    def merged(self, counter: int, resumed: int, authentic: bool) -> Stop:
        """With another latch of this robot: its radio's, which outlives both."""
        return self.raised(counter, authentic).lifted(resumed)


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The robot. `pose` is in the map frame (x east, y north); odometry and scan are in the odom frame."""

    config: Config
    policy_hash: bytes
    fleet: FleetState
    odometry: Odometry
    started_ns: int = NEVER
    placed_ns: int = (
        NEVER  # until then the pose was not known, or another: nothing of before says where we are
    )
    ports: tuple[bool, bool, bool] = (False, False, False)  # radio, base, lidar
    ros: RosFeed = field(default_factory=RosFeed)
    radio: RadioHealth = field(default_factory=RadioHealth)
    radio_heard_ns: int = NEVER  # its last status
    ground: Ground | None = None
    fields: Fields = field(default_factory=lambda: Fields({}))
    scan: Scan | None = None
    sweeps: SteadyClock = field(default_factory=lambda: SteadyClock(SAMPLE_NS))
    place: Localizer | None = None  # in a saved map
    charting: Charting | None = None  # a map in the making; with neither, the odom frame is the map frame
    navigator: Navigator = field(default_factory=Navigator)
    outcome: NavOutcome | None = None  # of the last tick that was allowed to move
    held: bool = False  # the guard slowed the last command
    recovery: Recovery = field(default_factory=Recovery)
    gives_up: bool = False  # its claim: at the end of this round it is let go
    progress: Progress | None = None  # with our claim
    stop: Stop = Stop()
    faults: tuple[tuple[str, int], ...] = ()  # reaction codes, since when
    alarms: frozenset[str] = frozenset()

    @property
    def observes(self) -> bool:
        """No robot id was given: listen, record, request nothing, move nothing."""
        return self.config.robot.id < 0

    @property
    def external_pose(self) -> Pose | None:
        """Where a localization outside says the robot is; faults.py judges its age."""
        return self.ros.pose if self.config.ros.localizes else None

    @property
    def pose(self) -> Pose:
        external = self.external_pose
        if external is not None:
            return external
        found = self.place or self.charting
        return self.odometry.pose if found is None else compose(found.map_from_odom, self.odometry.pose)

    @property
    def steady_pose(self) -> Pose:
        """A pose that drifts but never jumps: what lies between two scans and the guard."""
        return self.odometry.pose if self.external_pose is None else self.ros.odom

    @property
    def moved_ns(self) -> int:
        """When the base last said where it is: motion since then is unknown."""
        return self.odometry.stamp_ns if self.external_pose is None else self.ros.moved_ns

    @property
    def velocity(self) -> tuple[float, float]:
        """Measured (v [m/s], wz [rad/s]), base frame."""
        if self.external_pose is not None:
            return self.ros.velocity
        return self.odometry.v_mps, self.odometry.wz_radps

    @property
    def pose_source(self) -> str:
        """What `pose` comes from, for the log."""
        if self.external_pose is not None:
            return "ros"
        return "slam" if self.place or self.charting else "odometry"


def initial_state(config: Config, policy: bytes | None = None) -> State:
    """The robot before its first event. policy: a safetensors file's bytes, where the allocator needs one."""
    robot, fleet = config.robot, config.fleet
    allocator = make_allocator(fleet.allocator, policy, fleet.size, fleet.task_slots)
    return State(
        config=config,
        policy_hash=bytes.fromhex(read_policy(policy).hash) if policy is not None else b"",
        fleet=fleet_state.initial(config, allocator),
        odometry=Odometry(robot.start_x_m, robot.start_y_m, robot.start_yaw_rad),
        charting=first_charting(config) if config.slam.mode == "map" else None,
    )


def elsewhere(state: State, now_ns: int) -> State:
    """The pose is not known, or not the one it was: what is remembered in its frame holds no more.

    Nor do the peers know of us: what they heard of us was another place, or none.
    """
    navigator = replace(state.navigator.without_path(), heard=False, marks=())
    return replace(state, placed_ns=now_ns, navigator=navigator, outcome=None, recovery=Recovery())


def merged_stop(stop: Stop, header: Header, frame: StateFrame, agrees: bool) -> Stop:
    """A peer's STATE carries the latch, so that late joiners stop, and resume, too.

    Any peer may stop us; only one of our fleet (agrees) that runs at the very counter we are stopped at has
    heard the RESUME that we missed.
    """
    if frame.flags & FLAG_STOPPED:
        return stop.raised(frame.stop_counter, header.sealed)
    return stop.lifted(frame.stop_counter) if agrees and frame.stop_counter == stop.counter else stop


NO_POINTS: Points = np.zeros((0, 2))
