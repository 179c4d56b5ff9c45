"""World, devices, ports and air of a whole fleet, advanced by whoever has the clock. Knows no daemons.

Time is handed in, as microseconds since the start. The world moves in ticks of 10 ms; radio frames are
delivered at their own microsecond, in between.
"""

from __future__ import annotations

import select
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import LidarConfig
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_sim.devices.virtual_base import OdometryErrors, VirtualBase
from hippomat_sim.devices.virtual_lidar import SAMPLES_PER_S, RangeErrors, VirtualLidar, sample_angles
from hippomat_sim.devices.virtual_radio import VirtualRadio
from hippomat_sim.fleet_ear import FleetEar
from hippomat_sim.lidar_rays import measure, poses_between
from hippomat_sim.medium import AirSettings, Heard, Medium
from hippomat_sim.pty_port import PtyPort
from hippomat_sim.radio import Memory
from hippomat_sim.radio.opening import opened
from hippomat_sim.world import SUBSTEP_S, Body, World

TICK_US = 10_000
SUBSTEPS = round(TICK_US / 1e6 / SUBSTEP_S)
_LIDAR_TICKS = 2  # samples leave in pieces of 20 ms, 40 samples
_LIDAR_SAMPLES = round(SAMPLES_PER_S * _LIDAR_TICKS * TICK_US / 1e6)
_TRUTH_TICKS = 10


@dataclass(frozen=True, slots=True)
class SimulationSetup:
    """Everything that decides a simulated run but what the daemons do."""

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
class Robot:
    """The devices of one robot and their ports."""

    base: VirtualBase
    lidar: VirtualLidar
    radio: VirtualRadio
    base_port: PtyPort
    lidar_port: PtyPort
    radio_port: PtyPort

    @property
    def ports(self) -> tuple[PtyPort, PtyPort, PtyPort]:
        return self.radio_port, self.base_port, self.lidar_port


class Simulation:
    """N robots with three ports each in `directory`: radio0, base0, lidar0, radio1 ..."""

    def __init__(self, setup: SimulationSetup, directory: Path) -> None:
        self.setup = setup
        count = len(setup.start_poses)
        self.world = World(setup.grid, setup.start_poses, setup.body)
        self.medium = Medium(count, setup.air, setup.seed)
        self.ear = FleetEar(count)
        directory.mkdir(parents=True, exist_ok=True)
        self.robots = [self._robot(robot, directory) for robot in range(count)]
        self.truth: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]] = []  # us, poses, wheels
        self.ticks = 0
        self._lidar_poses = self.world.poses.copy()
        self._poll = select.epoll()
        self._by_fd: dict[int, tuple[int, PtyPort]] = {}
        for number, robot in enumerate(self.robots):
            for port in robot.ports:
                self._poll.register(port.fd, select.EPOLLIN)
                self._by_fd[port.fd] = number, port

    def _robot(self, number: int, directory: Path) -> Robot:
        seed = self.setup.seed * 1000 + number
        return Robot(
            VirtualBase(seed, self.setup.odometry_errors),
            VirtualLidar(seed, self.setup.range_errors),
            VirtualRadio(number, self.setup.seed, self.medium, self._provisioned(number)),
            PtyPort(directory / f"base{number}"),
            PtyPort(directory / f"lidar{number}"),
            PtyPort(directory / f"radio{number}"),
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
        """Hang up all ports and free the physics."""
        self._poll.close()
        for robot in self.robots:
            for port in robot.ports:
                port.close()
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

    def wait_for_bytes(self, timeout_s: float) -> list[tuple[int, PtyPort]]:
        """(robot, port) of the ports that the daemons wrote to, waiting at most timeout_s for the first."""
        return [self._by_fd[fd] for fd, _ in self._poll.poll(max(timeout_s, 0.0))]

    def serve(self, written: list[tuple[int, PtyPort]], now_us: int) -> None:
        """Let the devices take what the daemons wrote."""
        for number, port in written:
            robot, data = self.robots[number], port.read()
            if port is robot.radio_port:
                robot.radio.receive(now_us, data)
                self._radio_to_host(robot, now_us)
            elif port is robot.base_port:
                robot.base.receive(data)
            elif answer := robot.lidar.receive(data):
                port.write(answer, now_us / 1e6)

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
                robot.base_port.write(frame, now_s)
        if self.ticks % _LIDAR_TICKS == 0:
            self._scan(now_s)
        if self.ticks % _TRUTH_TICKS == 0:
            self.truth.append((now_us, self.world.poses.copy(), self.world.wheels.copy()))

    def _scan(self, now_s: float) -> None:
        first = (self.ticks // _LIDAR_TICKS - 1) * _LIDAR_SAMPLES
        angles = sample_angles(first, _LIDAR_SAMPLES)
        scanning = [number for number, robot in enumerate(self.robots) if robot.lidar.scanning]
        if scanning:
            before, after = self._lidar_poses[scanning], self.world.poses[scanning]
            fraction = (np.arange(_LIDAR_SAMPLES) + 1) / _LIDAR_SAMPLES
            ranges_m = measure(self.world, poses_between(before, after, fraction), angles, self.setup.lidar)
            for column, number in enumerate(scanning):
                robot = self.robots[number]
                robot.lidar_port.write(robot.lidar.samples(angles, ranges_m[:, column]), now_s)
        self._lidar_poses = self.world.poses.copy()

    @staticmethod
    def _radio_to_host(robot: Robot, now_us: int) -> None:
        if data := robot.radio.for_host():
            robot.radio_port.write(data, now_us / 1e6)
