"""Everything the robot core remembers between two events. A value: step() makes a new one.

Knows no port and no clock; what the state means for the next event is decided in step.py and tick.py.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

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
from hippomat_core.planning.ground import Fields, Ground
from hippomat_core.slam.odometry import Odometry
from hippomat_core.wire.frames import FLAG_STOPPED, LAST_STOP, Header, StateFrame

NEVER = -(10**18)


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """The latest sweep's returns in the base frame, and the pose (map frame) they were taken at.

    With them, points of earlier sweeps that the robot came too near to for the lidar to see them still.
    """

    stamp_ns: int
    points: Points  # (n, 2) [m]
    pose: tuple[float, float, float]  # x [m], y [m], yaw [rad]


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
        return replace(self, resumed=counter) if counter == self.counter != LAST_STOP else self

    def merged(self, counter: int, resumed: int, authentic: bool) -> Stop:
        """With another latch of this robot: its radio's, which outlives both."""
        return self.raised(counter, authentic).lifted(resumed)


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The robot. Poses in the map frame (x east, y north)."""

    config: Config
    policy_hash: bytes
    fleet: FleetState
    odometry: Odometry
    started_ns: int = NEVER
    ports: tuple[bool, bool, bool] = (False, False, False)  # radio, base, lidar
    radio: RadioHealth = field(default_factory=RadioHealth)
    radio_heard_ns: int = NEVER  # its last status
    ground: Ground | None = None
    fields: Fields = field(default_factory=lambda: Fields({}))
    scan: Scan | None = None
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
    def pose(self) -> tuple[float, float, float]:
        return self.odometry.x_m, self.odometry.y_m, self.odometry.yaw_rad


def initial_state(config: Config, policy: bytes | None = None) -> State:
    """The robot before its first event. policy: a safetensors file's bytes, where the allocator needs one."""
    robot, fleet = config.robot, config.fleet
    allocator = make_allocator(fleet.allocator, policy, fleet.size, fleet.task_slots)
    return State(
        config=config,
        policy_hash=bytes.fromhex(read_policy(policy).hash) if policy is not None else b"",
        fleet=fleet_state.initial(config, allocator),
        odometry=Odometry(robot.start_x_m, robot.start_y_m, robot.start_yaw_rad),
    )


def merged_stop(stop: Stop, header: Header, frame: StateFrame, agrees: bool) -> Stop:
    """A peer's STATE carries the latch, so that late joiners stop, and resume, too.

    Any peer may stop us; only one of our fleet (agrees) that runs at the very counter we are stopped at has
    heard the RESUME that we missed.
    """
    if frame.flags & FLAG_STOPPED:
        return stop.raised(frame.stop_counter, header.sealed)
    return stop.lifted(frame.stop_counter) if agrees and frame.stop_counter == stop.counter else stop


NO_POINTS: Points = np.zeros((0, 2))
