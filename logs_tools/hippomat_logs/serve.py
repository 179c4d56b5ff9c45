"""`hippomat-replay --serve`: offer the recorded ports, with the recorded timing, to daemons the user starts.

Decides when which bytes are offered: with time, at any speed, or step by step. Nothing is compared.
"""

from __future__ import annotations

import contextlib
import heapq
import os
import shlex
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

from rich.console import Console

from hippomat_core.errors import HippomatError
from hippomat_core.messages import PORT_NAMES
from hippomat_logs.daemon_process import daemon_command
from hippomat_logs.fake_ports import FakePort, FakePorts, running_reads
from hippomat_logs.reader import Run
from hippomat_logs.records import SerialRecord

POLL_S = 0.01
LATE_S = 5.0
HELP = "Enter: one read; N: N reads; Ns: N seconds; q: end"


class _Read(NamedTuple):
    """Bytes of one device of one robot."""

    time_s: float  # since the first robot's run began, by the logs' wall clocks
    robot: int
    serial: SerialRecord


class _Pace(Protocol):
    """Says when to go on; while it waits it keeps the ports moving."""

    def go_on(self, read: _Read, fleet: Sequence[FakePorts]) -> bool:
        """Whether to offer `read` now; False ends all."""
        ...


def serve(
    runs: list[Run], console: Console, speed: float = 1.0, step: bool = False, keyboard: int = 0
) -> int:
    """Offer the ports until their bytes are out or the user interrupts; the exit code.

    keyboard: descriptor of what step reads its lines from
    """
    _check(runs)
    with contextlib.ExitStack() as stack:
        directory = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="hippomat-serve-")))
        fleet = [stack.enter_context(FakePorts(run)) for run in runs]
        for run, ports in zip(runs, fleet, strict=True):
            _say_how(run, ports, directory / f"robot{run.robot}", console)
        console.print("waiting for it to open its ports; Ctrl-C ends this")
        _wait_until_used(fleet)
        if step:
            console.print(HELP)
        pace: _Pace = _Stepped(console, keyboard) if step else _RealTime(speed)
        _play(runs, fleet, pace, console)
    return 0


def _check(runs: Sequence[Run]) -> None:
    for index, run in enumerate(runs):
        if run.robot in {other.robot for other in runs[:index]}:
            raise HippomatError(f"--serve: robot {run.robot} has two runs in these logs: give one of them")
        if run.clip:
            raise HippomatError(f"--serve: {run.name} is a clip: it holds no serial bytes")
        if run.config.ros.url:
            raise HippomatError(
                f"--serve offers serial ports, but {run.name} had ROS: replay it without --serve"
            )


def _say_how(run: Run, ports: FakePorts, directory: Path, console: Console) -> None:
    directory.mkdir()
    links = ports.link_into(directory)
    paths = {port: str(path) for port, path in links.items()}
    command = ["hippomat-host", *daemon_command(run, directory, paths)[3:]]
    command += ["--log", "runs/served"]  # never beside the original: metrics would count both
    console.print(f"{run.name}: ports of robot {run.robot}", markup=False)
    for port, path in links.items():
        console.print(f"  {PORT_NAMES[port]:6} {path} -> {ports.paths[port]}", soft_wrap=True)
    console.print(f"start the daemon: {shlex.join(command)}", soft_wrap=True, markup=False)


def _wait_until_used(fleet: Sequence[FakePorts]) -> None:
    """Until every daemon has spoken on a port that has to be asked."""
    while not all(any(_identified(port) for port in ports.ports.values()) for ports in fleet):
        _service(fleet, POLL_S)


def _identified(port: FakePort) -> bool:
    return port.written_bytes > 0


def _service(fleet: Sequence[FakePorts], timeout_s: float, also: Sequence[int] = ()) -> bool:
    """Move bytes of all robots; True if one of `also` can be read."""
    heard = [ports.service(timeout_s / len(fleet), also) for ports in fleet]
    return any(heard)


def _play(runs: Sequence[Run], fleet: Sequence[FakePorts], pace: _Pace, console: Console) -> None:
    by_robot = {run.robot: ports for run, ports in zip(runs, fleet, strict=True)}
    begun_ns = min(int(run.manifest["started_ns"]) + run.wall_offset_ns for run in runs)
    sent = 0
    reads = (_reads(run, begun_ns) for run in runs)
    for read in heapq.merge(*reads, key=lambda read: read.time_s):
        if not pace.go_on(read, fleet):
            console.print(f"ended; {sent} bytes of the run were offered")
            return
        by_robot[read.robot].ports[read.serial.port].offer(read.serial.data)
        sent += len(read.serial.data)
    until_s = time.monotonic() + LATE_S
    while time.monotonic() < until_s and _pending(fleet):
        _service(fleet, POLL_S)
    console.print(f"all {sent} bytes of the run were offered")


def _reads(run: Run, begun_ns: int) -> Iterator[_Read]:
    for serial in running_reads(run):
        yield _Read((serial.stamp_ns + run.wall_offset_ns - begun_ns) / 1e9, run.robot, serial)


def _pending(fleet: Sequence[FakePorts]) -> bool:
    return any(port.pending_bytes for ports in fleet for port in ports.ports.values())


class _RealTime:
    """As recorded, `speed` times as fast."""

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._begin_s = time.monotonic() + 1.0  # the other ports are identified meanwhile

    def go_on(self, read: _Read, fleet: Sequence[FakePorts]) -> bool:
        due_s = self._begin_s + read.time_s / self._speed
        while (left_s := due_s - time.monotonic()) > 0.0:
            _service(fleet, min(POLL_S, left_s))
        return True


class _Stepped:
    """As many reads, or as much recorded time, as the user asks for on each line."""

    def __init__(self, console: Console, keyboard: int) -> None:
        self._console, self._keyboard = console, keyboard
        self._reads, self._until_s = 0, -1.0
        self._typed = b""

    def go_on(self, read: _Read, fleet: Sequence[FakePorts]) -> bool:
        while self._reads <= 0 and read.time_s > self._until_s:
            what = f"{PORT_NAMES[read.serial.port]} {len(read.serial.data)} bytes"
            self._console.print(f"{read.time_s:8.3f} s  robot {read.robot}  {what} > ", end="")
            line = self._line(fleet)
            if line is None or line == "q":
                return False
            self._take(line, read.time_s)
        self._reads -= 1
        return True

    def _take(self, line: str, time_s: float) -> None:
        try:
            if line.endswith("s"):
                self._until_s = time_s + float(line[:-1])
            else:
                self._reads = int(line or "1")
        except ValueError:
            self._console.print(f"{line!r}? {HELP}", markup=False)

    def _line(self, fleet: Sequence[FakePorts]) -> str | None:
        """The next line, None at the end of the input; the ports move meanwhile."""
        while b"\n" not in self._typed:
            if _service(fleet, POLL_S, [self._keyboard]):
                more = os.read(self._keyboard, 4096)
                if not more:
                    return None
                self._typed += more
        line, self._typed = self._typed.split(b"\n", 1)
        return line.decode(errors="replace").strip()
