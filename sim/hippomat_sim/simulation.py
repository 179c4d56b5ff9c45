"""A virtual fleet behind pseudo-terminals, for daemons that are processes of their own. Knows no daemons."""

from __future__ import annotations

import select
from pathlib import Path

from hippomat_core.messages import BASE, LIDAR, RADIO
from hippomat_sim.pty_port import PtyPort
from hippomat_sim.virtual_fleet import TICK_US, SimulationSetup, VirtualFleet

__all__ = ["TICK_US", "Simulation", "SimulationSetup"]

_NAMES = {RADIO: "radio", BASE: "base", LIDAR: "lidar"}


class Simulation(VirtualFleet):
    """N robots with three ports each in `directory`: radio0, base0, lidar0, radio1 ..."""

    def __init__(self, setup: SimulationSetup, directory: Path) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        super().__init__(setup, self._write)
        robots = range(len(setup.start_poses))
        self.ports = [
            {port: PtyPort(directory / f"{name}{robot}") for port, name in _NAMES.items()} for robot in robots
        ]
        self._poll = select.epoll()
        self._by_fd: dict[int, tuple[int, int]] = {}
        for number, ports in enumerate(self.ports):
            for port, pty in ports.items():
                self._poll.register(pty.fd, select.EPOLLIN)
                self._by_fd[pty.fd] = number, port

    def close(self) -> None:
        """Hang up all ports and free the physics."""
        self._poll.close()
        for ports in self.ports:
            for pty in ports.values():
                pty.close()
        super().close()

    def wait_for_bytes(self, timeout_s: float) -> list[tuple[int, int]]:
        """(robot, port) of the ports that the daemons wrote to, waiting at most timeout_s for the first."""
        return [self._by_fd[fd] for fd, _ in self._poll.poll(max(timeout_s, 0.0))]

    def serve(self, written: list[tuple[int, int]], now_us: int) -> None:
        """Let the devices take what the daemons wrote."""
        for robot, port in written:
            self.from_host(robot, port, self.ports[robot][port].read(), now_us)

    def _write(self, robot: int, port: int, data: bytes, now_us: int) -> None:
        self.ports[robot][port].write(data, now_us / 1e6)
