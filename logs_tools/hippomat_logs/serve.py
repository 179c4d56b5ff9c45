"""`hippomat-replay --serve`: offer the recorded ports, with the recorded timing, to a daemon the user starts.

Knows bytes and times; nothing is compared.
"""

from __future__ import annotations

import shlex
import tempfile
import time
from pathlib import Path

from rich.console import Console

from hippomat_core.errors import HippomatError
from hippomat_core.messages import PORT_NAMES
from hippomat_logs.daemon_process import daemon_command
from hippomat_logs.fake_ports import FakePort, FakePorts, running_reads
from hippomat_logs.reader import Run

POLL_S = 0.01
LATE_S = 5.0


def serve(runs: list[Run], console: Console, speed: float = 1.0) -> int:
    """Offer the ports of one run until its bytes are out or the user interrupts; the exit code."""
    if len(runs) != 1:
        raise HippomatError(f"--serve offers the ports of one robot; {len(runs)} runs were given")
    run = runs[0]
    if run.config.ros.url:
        raise HippomatError(f"--serve offers serial ports, but {run.name} had ROS: replay it without --serve")
    with tempfile.TemporaryDirectory(prefix="hippomat-serve-") as name, FakePorts(run) as ports:
        directory = Path(name)
        links = ports.link_into(directory)
        paths = {port: str(path) for port, path in links.items()}
        command = ["hippomat-host", *daemon_command(run, directory, paths)[3:]]
        command += ["--log", "runs/served"]  # never beside the original: metrics would count both
        console.print(f"{run.name}: ports of robot {run.robot}")
        for port, path in links.items():
            console.print(f"  {PORT_NAMES[port]:6} {path} -> {ports.paths[port]}", soft_wrap=True)
        console.print(f"start the daemon: {shlex.join(command)}", soft_wrap=True, markup=False)
        console.print("waiting for it to open its ports; Ctrl-C ends this")
        _wait_until_used(ports)
        _play(run, ports, console, speed)
    return 0


def _wait_until_used(ports: FakePorts) -> None:
    """Until the daemon has spoken on a port that has to be asked, or has taken the base's first frame."""
    while not any(_identified(port) for port in ports.ports.values()):
        ports.service(POLL_S)


def _identified(port: FakePort) -> bool:
    return port.written_bytes > 0


def _play(run: Run, ports: FakePorts, console: Console, speed: float) -> None:
    begin_s = time.monotonic() + 1.0  # the other ports are identified meanwhile
    first_ns: int | None = None
    sent = 0
    for serial in running_reads(run):
        first_ns = serial.stamp_ns if first_ns is None else first_ns
        due_s = begin_s + (serial.stamp_ns - first_ns) / 1e9 / speed
        while time.monotonic() < due_s:
            ports.service(min(POLL_S, max(0.0, due_s - time.monotonic())))
        ports.ports[serial.port].offer(serial.data)
        sent += len(serial.data)
    until_s = time.monotonic() + LATE_S
    while time.monotonic() < until_s and any(port.pending_bytes for port in ports.ports.values()):
        ports.service(POLL_S)
    console.print(f"all {sent} bytes of the run were offered")
