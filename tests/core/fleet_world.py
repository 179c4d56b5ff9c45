"""A fleet of robot cores in lockstep: exact unicycles, a lossy radio, no bytes. For tests of step()."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from radio_samples import radio_status

from hippomat_core.config import Config, FleetConfig, RecoveryConfig, RobotConfig, SlamConfig
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import (
    BASE,
    LIDAR,
    RADIO,
    BaseFeedback,
    ClaimChanged,
    Drive,
    Effect,
    Event,
    MapReceived,
    PortOpened,
    ScanReceived,
    SendState,
    SendTasks,
    Started,
    StateHeard,
    TasksHeard,
    Tick,
)
from hippomat_core.step import State, initial_state, step
from hippomat_core.wire.frames import STATE, TASKS, Header

TICK_NS = 50_000_000


def room(size_m: float = 5.0, resolution_m: float = 0.05) -> OccupancyGrid:
    """A walled square room with a pillar in the middle; lower left corner at the origin."""
    n = round(size_m / resolution_m)
    cells = np.zeros((n, n), np.int8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    middle = slice(n // 2 - 4, n // 2 + 4)
    cells[middle, middle] = 100
    return OccupancyGrid(cells, resolution_m, 0.0, 0.0)


def map_event(grid: OccupancyGrid, stamp_ns: int, epoch: int = 1) -> MapReceived:
    return MapReceived(
        stamp_ns, epoch, grid.width, grid.height, grid.resolution_m, grid.origin_x_m, grid.origin_y_m,
        grid.cells.reshape(-1),
    )  # fmt: skip


def full_sweep(stamp_ns: int, range_m: float = 0.0) -> ScanReceived:
    """One return per degree, all at one range; 0: nothing in sight."""
    degrees = np.arange(360, dtype=np.uint16)
    distance_q2 = np.full(360, round(range_m * 4000), np.uint16)
    return ScanReceived(stamp_ns, np.full(360, 15, np.uint8), degrees * np.uint16(64), distance_q2)


@dataclass
class Body:
    """One simulated robot: its core, its true pose and what its core said."""

    state: State
    x_m: float
    y_m: float
    yaw_rad: float
    v_mps: float = 0.0
    wz_radps: float = 0.0
    sequence: int = 0
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    effects: list[tuple[int, Effect]] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    trace: list[tuple[int, Event | Effect]] = field(default_factory=list)  # both, as a log has them

    def take(self, event: Event) -> tuple[Effect, ...]:
        self.state, effects = step(self.state, event)
        self.events.append(event)
        self.effects += [(event.stamp_ns, effect) for effect in effects]
        self.trace += [(event.stamp_ns, event), *((event.stamp_ns, effect) for effect in effects)]
        return effects

    def claims(self, what: str) -> list[ClaimChanged]:
        return [e for _, e in self.effects if isinstance(e, ClaimChanged) and e.what == what]


class FleetWorld:
    """N robots in one room. loss: share of frames that a receiver misses, drawn from `seed`."""

    def __init__(
        self,
        robots: int = 3,
        loss: float = 0.0,
        seed: int = 1,
        fleet: FleetConfig | None = None,
        policy: bytes | None = None,
        recovery: RecoveryConfig | None = None,
        starts: Sequence[tuple[float, float]] = (),
    ):
        self.starts = starts or [(0.6 + 0.7 * robot, 0.6) for robot in range(robots)]
        self.policy = policy
        self.recovery = recovery or RecoveryConfig()
        self.grid = room()
        self.random = np.random.default_rng(seed)
        self.loss = loss
        self.now_ns = 1_000_000_000
        fleet = replace(fleet or FleetConfig(task_slots=6, allocator="hungarian"), size=robots)
        self.bodies = [self._body(robot, fleet) for robot in range(robots)]

    def _body(self, robot: int, fleet: FleetConfig) -> Body:
        start = (*self.starts[robot], math.pi / 2)
        robot_config = RobotConfig(robot, *start, start_known=True)
        slam = SlamConfig(mode="odometry")
        config = Config(fleet=fleet, robot=robot_config, slam=slam, recovery=self.recovery)
        body = Body(initial_state(config, self.policy), *start, start=start)
        for event in (
            Started(self.now_ns),
            map_event(self.grid, self.now_ns),
            *(PortOpened(self.now_ns, port, "test") for port in (RADIO, BASE, LIDAR)),
        ):
            body.take(event)
        return body

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e9) // TICK_NS):
            self.tick()

    def tick(self) -> None:
        self.now_ns += TICK_NS
        for robot in range(len(self.bodies)):
            self._advance(robot)

    def _advance(self, robot: int) -> None:
        body, stamp_ns = self.bodies[robot], self.now_ns + robot * 1_000_000
        body.yaw_rad += body.wz_radps * TICK_NS / 1e9
        body.x_m += body.v_mps * math.cos(body.yaw_rad) * TICK_NS / 1e9
        body.y_m += body.v_mps * math.sin(body.yaw_rad) * TICK_NS / 1e9
        body.take(self._feedback(body, stamp_ns))
        body.take(full_sweep(stamp_ns))
        if (stamp_ns - self.bodies[0].state.started_ns) % 1_000_000_000 < TICK_NS:
            body.take(radio_status(stamp_ns, boot_id=7, robot=robot, slots=len(self.bodies)))
        self._act(robot, body.take(Tick(stamp_ns)), stamp_ns)

    def _act(self, robot: int, effects: tuple[Effect, ...], stamp_ns: int) -> None:
        body = self.bodies[robot]
        for effect in effects:
            if isinstance(effect, Drive):
                body.v_mps, body.wz_radps = effect.v_mps, effect.wz_radps
            elif isinstance(effect, SendState | SendTasks):
                self._broadcast(robot, effect, stamp_ns)

    @staticmethod
    def _feedback(body: Body, stamp_ns: int) -> BaseFeedback:
        """What an exact base would report: the pose relative to the start, in its own odom frame."""
        x0, y0, yaw0 = body.start
        east, north = body.x_m - x0, body.y_m - y0
        x_mm = round(1000 * (math.cos(yaw0) * east + math.sin(yaw0) * north))
        y_mm = round(1000 * (-math.sin(yaw0) * east + math.cos(yaw0) * north))
        yaw_mrad = round(1000 * math.remainder(body.yaw_rad - yaw0, math.tau))
        zeros, wheels = np.zeros(3, np.int16), np.zeros(4, np.int16)
        return BaseFeedback(stamp_ns, zeros, zeros, zeros, x_mm, y_mm, yaw_mrad, 0, 0, 0, wheels, 0)

    def _broadcast(self, sender: int, effect: SendState | SendTasks, stamp_ns: int) -> None:
        body = self.bodies[sender]
        body.sequence += 1
        kind = STATE if isinstance(effect, SendState) else TASKS
        header = Header(kind, False, 1, sender, 1, body.sequence, stamp_ns // 1000)
        for receiver, other in enumerate(self.bodies):
            if receiver == sender or self.random.random() < self.loss:
                continue
            at_ns = max(stamp_ns, other.events[-1].stamp_ns) + 200_000
            if isinstance(effect, SendState):
                other.take(StateHeard(at_ns, 0, 0, -50, header, effect.frame))
            else:
                other.take(TasksHeard(at_ns, 0, 0, -50, header, effect.frame))

    def nearest_m(self) -> float:
        """The smallest distance between two robots' centres right now."""
        at = np.array([[body.x_m, body.y_m] for body in self.bodies])
        gaps = np.hypot(*(at[:, None] - at[None, :]).transpose(2, 0, 1))
        return float(gaps[np.triu_indices(len(at), 1)].min())
