"""The robots' daemons as processes of this one: started, watched and stopped, none left behind (Linux)."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hippomat_core.errors import HippomatError
from hippomat_sim.clock_errors import RIGHT, ClockError
from hippomat_sim.clock_errors import VARIABLE as ERROR_VARIABLE
from hippomat_sim.world_clock import VARIABLE

_PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None)
# One thread each: the daemons share few cores, and thread pools of numeric libraries fight over them.
_THREAD_SETTINGS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
_ONE_THREAD = dict.fromkeys(_THREAD_SETTINGS, "1")


class DaemonDied(HippomatError):
    """A daemon ended that should have gone on; the message has its last words."""


@dataclass(frozen=True, slots=True)
class DaemonOrder:
    """Everything one daemon is told on its command line."""

    robot: int
    ports: Path  # directory with radioN, baseN, lidarN
    config: Path
    map_yaml: Path
    start: tuple[float, float, float]  # x, y [m], yaw [rad]
    log: Path | None
    clock: Path | None = None  # the world's time; None: the daemon's own
    clock_error: ClockError = RIGHT

    def command(self) -> list[str]:
        """The command line."""
        port = {kind: str(self.ports / f"{kind}{self.robot}") for kind in ("radio", "base", "lidar")}
        x_m, y_m, yaw_rad = self.start
        return [
            *(sys.executable, "-m", "hippomat_host"),
            *("--port", port["radio"], "--base", port["base"], "--lidar", port["lidar"]),
            *("--config", str(self.config), "--map", str(self.map_yaml), "--robot", str(self.robot)),
            f"--start={x_m:.4f},{y_m:.4f},{yaw_rad:.4f}",  # '=': the value may begin with a minus
            *(("--no-log",) if self.log is None else ("--log", str(self.log))),
        ]


class Daemon:
    """One running daemon; what it prints goes to files in `directory`."""

    def __init__(self, order: DaemonOrder, directory: Path) -> None:
        self.robot = order.robot
        self.output = directory / f"daemon{order.robot}.out"
        self.errors = directory / f"daemon{order.robot}.err"
        self.stopping = False
        with self.output.open("wb") as out, self.errors.open("wb") as err:
            self._process = subprocess.Popen(
                order.command(),
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                env={**os.environ, **_ONE_THREAD, **_clock(order), "PYTHONUNBUFFERED": "1"},
                start_new_session=True,  # Ctrl-C reaches us; we tell the daemons
                preexec_fn=_die_with_parent,
            )

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """None while it runs; negative: ended by that signal."""
        return self._process.poll()

    @property
    def died(self) -> bool:
        """True where it ended without being told."""
        return self.exit_code is not None and not self.stopping

    def interrupt(self) -> None:
        """Ask it to stop as Ctrl-C does: motors first, then the log."""
        self.stopping = True
        self._signal(signal.SIGINT)

    def kill(self) -> None:
        """End it and everything in its session."""
        self.stopping = True
        self._signal(signal.SIGKILL)
        self._process.wait()

    def _signal(self, number: signal.Signals) -> None:
        if self._process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                if number == signal.SIGKILL:
                    os.killpg(self._process.pid, number)
                else:
                    self._process.send_signal(number)

    def last_words(self, lines: int = 8) -> str:
        """The end of what it wrote to stderr, else to stdout."""
        for path in (self.errors, self.output):
            text = path.read_text(encoding="utf-8", errors="replace").strip()
            if text:
                return "\n".join(text.splitlines()[-lines:])
        return "(it printed nothing)"


def _clock(order: DaemonOrder) -> dict[str, str]:
    if order.clock is None:
        return {}
    return {VARIABLE: str(order.clock.resolve()), ERROR_VARIABLE: order.clock_error.text}


def describe_end(daemon: Daemon) -> str:
    """One line and the daemon's last words."""
    code = daemon.exit_code
    ended = (
        f"was ended by signal {-code}" if code is not None and code < 0 else f"ended with exit code {code}"
    )
    words = "\n".join(f"    {line}" for line in daemon.last_words().splitlines())
    return f"robot {daemon.robot}'s daemon {ended}; its last words (all: {daemon.errors}):\n{words}"


def interrupt_all(daemons: Sequence[Daemon]) -> None:
    """Ask all to stop."""
    for daemon in daemons:
        daemon.interrupt()


def kill_all(daemons: Sequence[Daemon]) -> list[int]:
    """End whoever still runs; returns their robots."""
    left = [daemon for daemon in daemons if daemon.exit_code is None]
    for daemon in left:
        daemon.kill()
    return [daemon.robot for daemon in left]


def _die_with_parent() -> None:
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
