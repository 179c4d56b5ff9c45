"""One simulated run in lockstep: the same world, devices, core and logs as with daemons, without real time.

The logs' clock is the world's: it begins at CLOCK_NS, so that the same settings give the same files.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from hippomat_core.config import Config
from hippomat_core.errors import ConfigError, HippomatError
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_logs.direct_recorder import DirectRecorder
from hippomat_logs.manifest import run_manifest
from hippomat_logs.map_files import map_attachments
from hippomat_logs.policy_files import naming, policy_name, policy_of
from hippomat_sim.clock_errors import RIGHT
from hippomat_sim.fleet_run import RunResult, carry_who_is_due, log_directory, run_result
from hippomat_sim.lockstep_fleet import FIRST_US, NEVER_US, WORLD_NS, Computer, LockstepFleet
from hippomat_sim.lockstep_robot import Recording
from hippomat_sim.run_preparation import Prepared, prepared
from hippomat_sim.run_settings import RunSettings
from hippomat_sim.run_signals import Interrupts
from hippomat_sim.views import View

CLOCK_NS = 946_684_800 * 10**9  # 2000-01-01: no real run is taken for it
STEP_US = 100_000
_VIEW_PERIOD_S = 0.5


class NoRecords:
    """Nothing is kept."""

    def put(self, stamp_ns: int, message: object) -> None: ...
    def serial(self, stamp_ns: int, port: int, direction: int, phase: int, data: bytes) -> None: ...
    def close(self) -> None: ...


class LockstepRun:
    """Use once: LockstepRun(settings, view).execute()."""

    def __init__(self, settings: RunSettings, view: View, leave_s: Mapping[int, float] | None = None) -> None:
        """ConfigError for settings of hosts, of which there are none here.

        leave_s: robots whose computers are switched off so many seconds after the begin.
        """
        if settings.clock_years or settings.clock_ppm:
            raise ConfigError(
                "--lockstep has no daemons whose clocks --clock-years and --clock-ppm set: leave these out"
            )
        self._prepared = prepared(settings)
        self._view, self._leave_s = view, dict(leave_s or {})
        fleet = self._prepared.config.fleet
        self._policy = policy_of(fleet)
        named = contextlib.nullcontext() if self._policy is None else naming(policy_name(fleet))
        with named:
            self.fleet = LockstepFleet(self._prepared.setup, self._computers(), self._recording)
        self._to_carry = sorted(settings.carried, key=lambda one: one.at_s)
        self._real_s = self._busy_s = 0.0
        self.interrupted = 0

    def execute(self) -> RunResult:
        """Run to the end, or to Ctrl-C; logs are complete either way."""
        begun_s, cpu_s = time.monotonic(), time.process_time()
        with Interrupts() as interrupts:
            try:
                seconds = self._advance(interrupts)
                self._real_s, self._busy_s = time.monotonic() - begun_s, time.process_time() - cpu_s
            finally:
                self.fleet.stop()
                self._view.close()
                self.fleet.close()
        self.interrupted = interrupts.count
        return self._result(seconds)

    def _advance(self, interrupts: Interrupts) -> float:
        fleet, wanted_s = self.fleet, self._prepared.settings.seconds
        self._view.phase("preparing the robots", 0.0, 0.0)
        fleet.advance(FIRST_US)
        self._view.phase("running", FIRST_US / 1e6, wanted_s)
        end_us, shown_s = FIRST_US + round(wanted_s * 1e6), -math.inf
        while fleet.now_us < end_us and not interrupts.count:
            fleet.advance(min(fleet.now_us + STEP_US, end_us))
            carry_who_is_due(self._to_carry, (fleet.now_us - FIRST_US) / 1e6, fleet.devices, self._view)
            if (now_s := time.monotonic()) - shown_s >= _VIEW_PERIOD_S:
                shown_s = now_s
                self._view.show(fleet.now_us / 1e6, fleet.devices)
        return (fleet.now_us - FIRST_US) / 1e6

    def _computers(self) -> list[Computer]:
        config = self._prepared.config
        return [
            Computer(placed(config, robot, (x_m, y_m, yaw_rad)), self._policy, ends_us=self._ends_us(robot))
            for robot, (x_m, y_m, yaw_rad) in enumerate(self._prepared.starts.tolist())
        ]

    def _ends_us(self, robot: int) -> int:
        return FIRST_US + round(self._leave_s[robot] * 1e6) if robot in self._leave_s else NEVER_US

    def _recording(self, computer: Computer, stamp_ns: int) -> Recording:
        if not self._prepared.settings.record_logs:
            return NoRecords()
        run, robot = self._prepared, computer.config.robot.id
        directory = log_directory(run.settings, robot)
        try:
            return log_of(computer, run.grid, directory, stamp_ns, session_id(run, computer, self._leave_s))
        except OSError as error:
            raise HippomatError(f"cannot record into {directory}: {error.strerror or error}") from None

    def _result(self, seconds: float) -> RunResult:
        robots = self._prepared.settings.robots
        return run_result(
            self._prepared,
            self.fleet.devices,
            start_monotonic_ns=WORLD_NS,
            clock_errors=(RIGHT,) * robots,
            seconds=seconds,
            busy=self._busy_s / max(self._real_s, 1e-9),
            real_s=self._real_s,
        )


def placed(config: Config, robot: int, start: tuple[float, float, float]) -> Config:
    """The fleet's configuration as that robot has it, which knows where it starts (map frame)."""
    return replace(config, robot=replace(config.robot, id=robot).starting_at(start))


def session_id(run: Prepared, computer: Computer, leave_s: Mapping[int, float]) -> str:
    """Of one robot's run, in 8 hexadecimal digits: the same for equal runs, and for no others."""
    settings, left = run.settings, sorted(leave_s.items())
    told = (settings.seconds, settings.loss, settings.seed, settings.sealed, settings.carried, left)
    decided = (computer.config, run.grid.hash(), hashlib.sha256(computer.policy or b"").hexdigest())
    return hashlib.sha256(repr((told, decided)).encode()).hexdigest()[:8]


def log_of(
    computer: Computer, grid: OccupancyGrid, directory: Path, stamp_ns: int, session: str
) -> DirectRecorder:
    """A log like a daemon's. Nothing in it tells this machine's name, boot or time."""
    policy = computer.policy
    manifest = run_manifest(
        computer.config,
        session_id=session,
        map_hash=grid.hash(),
        policy=policy,
        extra={
            "boot_id": "lockstep",
            "host": "lockstep simulation",
            "command": "hippomat-sim run --lockstep",
        },
    )
    return DirectRecorder(
        directory,
        manifest,
        config=computer.config,
        wall_ns=CLOCK_NS + stamp_ns - WORLD_NS,
        stamp_ns=stamp_ns,
        policy=policy or b"",
        files=map_attachments(grid),
    )
