"""A whole fleet in one process: devices, air, robots, one thing after the other, without a clock of its own.

Deterministic: the same plan and seed give the same records in the same order. As fast as the processor
allows; robots are as punctual as if each had one to itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hippomat_core.config import Config
from hippomat_sim.lockstep_robot import TICK_US, LockstepRobot, Recording
from hippomat_sim.medium import Medium
from hippomat_sim.virtual_fleet import SimulationSetup, VirtualFleet

WORLD_NS = 10**12  # a robot's monotonic clock when the world begins
IDENTIFY_US = 400_000  # a robot's devices are asked who they are this long before it begins
NEVER_US = 2**62
FIRST_US = 1_000_000  # no robot begins earlier: its devices were switched on before


@dataclass(frozen=True, slots=True)
class Computer:
    """One robot's, and when it runs; world time."""

    config: Config  # its [robot] id is its place in the fleet
    policy: bytes | None
    begins_us: int = FIRST_US
    first_tick_us: int = TICK_US  # after that
    ends_us: int = NEVER_US


Recorders = Callable[[Computer, int], Recording]  # the computer, the stamp of its first event


class LockstepFleet:
    """advance() in steps as small as whoever watches likes; stop() at the end."""

    def __init__(
        self,
        setup: SimulationSetup,
        computers: Sequence[Computer],
        recorders: Recorders,
        medium: Medium | None = None,
    ) -> None:
        """A robot of the setup without a computer stands there with its radio silent."""
        self.devices = VirtualFleet(setup, self._to_host, medium)
        self.now_us = 0
        self._recorders = recorders
        self._computers = {one.config.robot.id: one for one in computers}
        self._robots = {
            number: LockstepRobot(
                one.config,
                one.policy,
                setup.grid,
                one.begins_us,
                WORLD_NS,
                self._writer(number),
                one.first_tick_us,
            )
            for number, one in sorted(self._computers.items())
        }
        self._to_identify = sorted((one.begins_us - IDENTIFY_US, k) for k, one in self._computers.items())
        self._to_end = sorted((one.ends_us, number) for number, one in self._computers.items())

    def advance(self, until_us: int) -> None:
        """Everything that happens up to until_us: at one instant devices first, then robots by their ids."""
        while (due_us := self._next_us()) <= until_us:
            self.now_us = due_us
            self.devices.advance(due_us)
            while self._to_identify and self._to_identify[0][0] <= due_us:
                self._robots[self._to_identify.pop(0)[1]].identify(due_us)
            while self._to_end and self._to_end[0][0] <= due_us:
                self._robots[self._to_end.pop(0)[1]].stop(due_us)
            for number, robot in self._robots.items():
                if robot.due_us <= due_us:
                    self._act(number, robot)
        self.now_us = max(self.now_us, until_us)

    def stop(self) -> None:
        """All robots stop now; logs are complete."""
        for robot in self._robots.values():
            robot.stop(self.now_us)

    def close(self) -> None:
        """Free the physics."""
        self.devices.close()

    def _next_us(self) -> int:
        due_us = min(self.devices.next_us(), *(robot.due_us for robot in self._robots.values()))
        for waiting in (self._to_identify, self._to_end):
            if waiting:
                due_us = min(due_us, waiting[0][0])
        return max(due_us, self.now_us)

    def _act(self, number: int, robot: LockstepRobot) -> None:
        if robot.running:
            robot.act(self.now_us)
        else:
            computer = self._computers[number]
            robot.begin(self.now_us, self._recorders(computer, WORLD_NS + self.now_us * 1000))

    def _writer(self, number: int) -> Callable[[int, bytes, int], None]:
        return lambda port, data, now_us: self.devices.from_host(number, port, data, now_us)

    def _to_host(self, number: int, port: int, data: bytes, now_us: int) -> None:
        robot = self._robots.get(number)
        if robot is not None:
            robot.hear(port, data, now_us)
