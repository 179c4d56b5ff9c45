"""World, devices and air of a whole fleet, advanced by whoever has the clock. Knows no ports and no daemons.

Time is handed in, as microseconds since the start. The world moves in ticks of 10 ms; radio frames are
delivered at their own microsecond, in between. What the devices say goes to whoever is behind them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import LidarConfig
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import BASE, LIDAR, RADIO
from hippomat_sim.devices.virtual_base import OdometryErrors, VirtualBase
from hippomat_sim.devices.virtual_lidar import SAMPLES_PER_S, RangeErrors, VirtualLidar, sample_angles
from hippomat_sim.devices.virtual_radio import VirtualRadio
from hippomat_sim.fleet_ear import FleetEar
from hippomat_sim.lidar_rays import measure, poses_between
from hippomat_sim.medium import AirSettings, Heard, Medium
from hippomat_sim.radio import Memory
from hippomat_sim.radio.opening import opened
from hippomat_sim.world import SUBSTEP_S, Body, World

TICK_US = 10_000
SUBSTEPS = round(TICK_US / 1e6 / SUBSTEP_S)
_LIDAR_TICKS = 2  # samples leave in pieces of 20 ms, 40 samples
_LIDAR_SAMPLES = round(SAMPLES_PER_S * _LIDAR_TICKS * TICK_US / 1e6)
_TRUTH_TICKS = 10

ToHost = Callable[[int, int, bytes, int], None]  # robot, port (messages.RADIO ..), bytes, now [us]


@dataclass(frozen=True, slots=True)
class SimulationSetup:
    """Everything that decides a simulated run but what the robots decide."""

    grid: OccupancyGrid
    start_poses: NDArray[np.float64]  # (N, 3)
    seed: int = 1
    body: Body = field(default_factory=Body)
    lidar: LidarConfig = field(default_factory=LidarConfig)
    air: AirSettings = field(default_factory=AirSettings)
    odometry_errors: OdometryErrors = field(default_factory=OdometryErrors)
    range_errors: RangeErrors = field(default_factory=RangeErrors)
    fleet: int = 1
    channel: int = 1
    key: bytes = field(default=b"", repr=False)  # b"": OPEN


@dataclass(slots=True)
class Devices:
    """The three devices of one robot."""

    robot: int
    base: VirtualBase
    lidar: VirtualLidar
    radio: VirtualRadio


class VirtualFleet:
    """N robots without their computers. to_host gets what the devices say, from_host() takes the answers."""

    def __init__(self, setup: SimulationSetup, to_host: ToHost, medium: Medium | None = None) -> None:
        """medium: another air than the setup's."""
        self.setup = setup
        count = len(setup.start_poses)
        self.world = World(setup.grid, setup.start_poses, setup.body)
        self.medium = medium or Medium(count, setup.air, setup.seed)
        self.ear = FleetEar(count)
        self.robots = [self._devices(robot) for robot in range(count)]
        self.truth: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]] = []  # us, poses, wheels
        self.ticks = 0
        self._to_host = to_host
        self._lidar_poses = self.world.poses.copy()

    def _devices(self, robot: int) -> Devices:
        seed = self.setup.seed * 1000 + robot
        return Devices(
            robot,
            VirtualBase(seed, self.setup.odometry_errors),
            VirtualLidar(seed, self.setup.range_errors),
            VirtualRadio(robot, self.setup.seed, self.medium, self._provisioned(robot)),
        )

    def _provisioned(self, robot: int) -> Memory:
        """Without a key a new radio, which takes its identity from its daemon; else a provisioned one."""
        fleet, key = self.setup.fleet, self.setup.key
        return (
            Memory(robot, fleet, self.setup.channel, provisioned=True, key=key)
            if key
            else Memory(fleet=fleet)
        )

    def close(self) -> None:
        """Free the physics."""
        self.world.close()

    def next_us(self) -> int:
        """When there is something to do even if no port has bytes."""
        tick_us = (self.ticks + 1) * TICK_US
        air_us = self.medium.next_us()
        radio_us = min(robot.radio.wake_us for robot in self.robots)
        return min(tick_us, radio_us) if air_us is None else min(tick_us, radio_us, air_us)

    def carry(self, robot: int, pose: tuple[float, float, float]) -> None:
        """Somebody lifts a robot and puts it down elsewhere: its wheels do not turn."""
        self.world.place(robot, pose, 0.0, 0.0)
        self._lidar_poses[robot] = pose

    def from_host(self, number: int, port: int, data: bytes, now_us: int) -> None:
        """A device takes what was written to it."""
        robot = self.robots[number]
        if port == RADIO:
            robot.radio.receive(now_us, data)
            self._radio_to_host(robot, now_us)
        elif port == BASE:
            robot.base.receive(data)
        elif answer := robot.lidar.receive(data):
            self._to_host(number, LIDAR, answer, now_us)

    def advance(self, now_us: int) -> None:
        """Ticks and deliveries up to now_us."""
        while (due_us := self.next_us()) <= now_us:
            self._deliver(due_us)
            if due_us >= (self.ticks + 1) * TICK_US:
                self._tick((self.ticks + 1) * TICK_US)

    def _deliver(self, now_us: int) -> None:
        while (happening := self.medium.pop(now_us)) is not None:
            if isinstance(happening, Heard):
                robot = self.robots[happening.receiver]
                robot.radio.heard(happening.at_us, happening.rssi_dbm, happening.sender, happening.frame)
            else:
                robot = self.robots[happening.sender]
                if frame := opened(self.setup.key, robot.radio.mac, happening.frame):
                    self.ear.hear(happening.at_us, frame)
                robot.radio.sent(happening.at_us)
            self._radio_to_host(robot, now_us)
        for robot in self.robots:
            if robot.radio.wake_us <= now_us:
                robot.radio.tick(now_us)
                self._radio_to_host(robot, now_us)

    def _tick(self, now_us: int) -> None:
        self.ticks += 1
        now_s = now_us / 1e6
        for number, robot in enumerate(self.robots):
            self.world.command(number, *robot.base.command)
        self.world.step(SUBSTEPS)
        self.medium.positions_m = [(x, y) for x, y, _ in self.world.poses.tolist()]
        for robot, (v_mps, wz_radps) in zip(self.robots, self.world.wheels.tolist(), strict=True):
            robot.base.turn_wheels(v_mps, wz_radps, TICK_US / 1e6)
            if frame := robot.base.feedback(now_s, v_mps, wz_radps):
                self._to_host(robot.robot, BASE, frame, now_us)
        if self.ticks % _LIDAR_TICKS == 0:
            self._scan(now_us)
        if self.ticks % _TRUTH_TICKS == 0:
            self.truth.append((now_us, self.world.poses.copy(), self.world.wheels.copy()))

    def _scan(self, now_us: int) -> None:
        first = (self.ticks // _LIDAR_TICKS - 1) * _LIDAR_SAMPLES
        angles = sample_angles(first, _LIDAR_SAMPLES)
        scanning = [number for number, robot in enumerate(self.robots) if robot.lidar.scanning]
        if scanning:
            before, after = self._lidar_poses[scanning], self.world.poses[scanning]
            fraction = (np.arange(_LIDAR_SAMPLES) + 1) / _LIDAR_SAMPLES
            ranges_m = measure(self.world, poses_between(before, after, fraction), angles, self.setup.lidar)
            for column, number in enumerate(scanning):
                robot = self.robots[number]
                samples = robot.lidar.samples(angles, ranges_m[:, column])
                self._to_host(number, LIDAR, samples, now_us)
        self._lidar_poses = self.world.poses.copy()

    def _radio_to_host(self, robot: Devices, now_us: int) -> None:
        if data := robot.radio.for_host():
            self._to_host(robot.robot, RADIO, data, now_us)
