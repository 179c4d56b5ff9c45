"""One simulated run in real time: ports and world here, N real daemons beside it, from start to clean end.

Daemons and world share the world's clock (world_clock.py), which keeps to real time as far as the machine
can; what it could not is slipped_s.
"""

from __future__ import annotations

import contextlib
import math
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.warm_up import warm_up
from hippomat_core.config import Config
from hippomat_core.control.warm_up import warm_up as warm_up_control
from hippomat_core.errors import ConfigError, HippomatError
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.slam.warm_up import warm_up as warm_up_localizer
from hippomat_logs.policy_files import policy_of
from hippomat_sim.clock_errors import ClockError, draw_clock_errors
from hippomat_sim.daemons import Daemon, DaemonOrder, describe_end, interrupt_all, kill_all
from hippomat_sim.medium import StationCounts
from hippomat_sim.run_preparation import Prepared, prepared
from hippomat_sim.run_settings import Carried, RunSettings
from hippomat_sim.run_signals import Interrupts
from hippomat_sim.simulation import Simulation
from hippomat_sim.views import View
from hippomat_sim.virtual_fleet import VirtualFleet
from hippomat_sim.world import Contact
from hippomat_sim.world_clock import WorldClock

START_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 15.0
_VIEW_PERIOD_S = 0.5


@dataclass(frozen=True, slots=True)
class RunResult:
    """What a run left behind, and what only the simulation knows of it."""

    out: Path
    map_yaml: Path
    grid: OccupancyGrid
    config: Config
    logs: tuple[Path, ...]  # one directory per robot
    start_poses: NDArray[np.float64]  # (N, 3)
    truth_us: NDArray[np.int64]  # (T,) since the start of the world
    truth: NDArray[np.float64]  # (T, N, 3)
    start_monotonic_ns: int  # of truth_us 0, on the world's clock
    clock_errors: tuple[ClockError, ...]  # of each robot's host, against that
    seconds: float  # with all robots on the air
    contacts: tuple[Contact, ...]
    counts: tuple[StationCounts, ...]
    served: tuple[int, ...]  # heard from the air
    troubles: tuple[str, ...]  # daemons that died, or had to be killed
    slipped_s: float  # by which the run took longer than the world's time
    busy: float  # share of one processor that the world took
    real_s: float = 0.0  # in lockstep, which has no clock: what the run took

    @property
    def truth_ns(self) -> NDArray[np.int64]:
        """(T,) stamps of the truth; in the daemons' logs too, but for their clock errors."""
        return self.truth_us * 1000 + self.start_monotonic_ns


class FleetRun:
    """Use once: FleetRun(settings, view).execute()."""

    def __init__(self, settings: RunSettings, view: View) -> None:
        self._prepared = run = prepared(settings)
        self.settings = settings = run.settings
        self.config, self.grid, self.starts, self.toml = run.config, run.grid, run.starts, run.toml
        self.simulation = Simulation(run.setup, settings.out / "ports")
        self.daemons: list[Daemon] = []
        self.troubles: list[str] = []
        self._interrupts = Interrupts()
        self._reported: set[int] = set()
        self._view = view
        self._clock = WorldClock(settings.out / "ports" / "clock", settings.robots)
        self._clock_errors = draw_clock_errors(
            settings.robots, settings.clock_years, settings.clock_ppm, settings.seed
        )
        self._next_view_s = 0.0
        self._to_carry = sorted(settings.carried, key=lambda one: one.at_s)
        self._began_s = math.inf

    def execute(self) -> RunResult:
        """Run to the end; raises HippomatError where the fleet does not get under way."""
        with self._interrupts:
            try:
                self._start()
                seconds = self._drive()
                self._stop()
            finally:
                kill_all(self.daemons)
                self._view.close()
                self.simulation.close()
                self._clock.close()
                self._clock.path.unlink()
        return self._result(seconds)

    @property
    def interrupted(self) -> int:
        """Signals so far."""
        return self._interrupts.count

    def _start(self) -> None:
        """Start the daemons and wait until all robots are on the air."""
        self._view.phase("preparing the allocator", 0.0, 0.0)
        with contextlib.suppress(HippomatError):  # a daemon says better what is wrong with it
            self._compile()
        self._view.phase("starting the daemons", 0.0, 0.0)
        self._cpu_start_s = time.process_time()
        self._clock.begin()
        self.daemons = [Daemon(self._order(robot), self.settings.out) for robot in range(len(self.starts))]
        heard = self.simulation.ear.robots
        self._pace(START_TIMEOUT_S, lambda: all(one.first_us >= 0 for one in heard) or self._one_died())
        silent = [robot for robot, one in enumerate(heard) if one.first_us < 0]
        if self.interrupted or not silent:
            return
        dead = next((daemon for daemon in self.daemons if daemon.died), None)
        if dead is not None:
            raise HippomatError(f"the fleet did not start: {describe_end(dead)}")
        mute = self.daemons[silent[0]]
        raise HippomatError(
            f"the fleet did not start: robot {mute.robot} was not heard within {START_TIMEOUT_S:.0f} s; "
            f"see {mute.errors}:\n{mute.last_words()}"
        )

    def _compile(self) -> None:
        """Once, here, instead of in every daemon at the same time; numba keeps what it compiled."""
        fleet = self.config.fleet
        allocator = make_allocator(fleet.allocator, policy_of(fleet), fleet.size, fleet.task_slots)
        warm_up(allocator, fleet.size, fleet.task_slots)
        warm_up_control(self.config)
        if self.config.slam.mode == "auto":
            warm_up_localizer()

    def _order(self, robot: int) -> DaemonOrder:
        x_m, y_m, yaw_rad = self.starts[robot].tolist()
        return DaemonOrder(
            robot,
            self.settings.out / "ports",
            self.toml,
            self.settings.map_yaml.resolve(),
            (x_m, y_m, yaw_rad),
            log_directory(self.settings, robot) if self.settings.record_logs else None,
            self._clock.path,
            self._clock_errors[robot],
        )

    def _drive(self) -> float:
        began_s = self._began_s = self._now_s()
        seconds = self.settings.seconds
        if not self.interrupted:
            self._view.phase("running", began_s, seconds)
            self._pace(seconds, self._all_died)
        return self._now_s() - began_s

    def _stop(self) -> None:
        """Motors first is the daemons' business; the world goes on until they are done."""
        self._view.phase("stopping the daemons", 0.0, 0.0)
        signals = self.interrupted
        interrupt_all([daemon for daemon in self.daemons if not daemon.died])
        self._pace(
            STOP_TIMEOUT_S,
            lambda: (
                all(daemon.exit_code is not None for daemon in self.daemons) or self.interrupted > signals
            ),
            stoppable=False,
        )
        for robot in kill_all(self.daemons):
            self._trouble(f"robot {robot}'s daemon did not stop within {STOP_TIMEOUT_S:.0f} s and was killed")
        for daemon in self.daemons:
            if daemon.exit_code and daemon.robot not in self._reported and daemon.exit_code > 0:
                self._trouble(describe_end(daemon))

    def _pace(self, duration_s: float, done: Callable[[], bool], *, stoppable: bool = True) -> None:
        """Let the world run on the real clock until done, or the time is over, or (stoppable) Ctrl-C."""
        end_s = self._now_s() + duration_s
        while (now_s := self._now_s()) < end_s and not (stoppable and self.interrupted):
            now_us = self._move()
            self._advance(now_us)
            if now_s >= self._next_view_s:
                self._next_view_s = now_s + _VIEW_PERIOD_S
                self._watch()
                self._view.show(now_us / 1e6, self.simulation)
                if done():
                    return
            timeout_s = self.simulation.next_us() / 1e6 - self._now_s()
            written = self.simulation.wait_for_bytes(timeout_s)
            if written:
                now_us = self._move()
                self._advance(now_us)
                self.simulation.serve(written, now_us)

    def _advance(self, now_us: int) -> None:
        """The devices write what happened up to now_us; and people carry robots about."""
        self.simulation.advance(now_us)
        carry_who_is_due(self._to_carry, now_us / 1e6 - self._began_s, self.simulation, self._view)

    def _move(self) -> int:
        """The world's time goes on, as far as the daemons that work have come [us]."""
        working = [one.robot for one in self.daemons if not one.stopping and one.exit_code is None]
        return self._clock.move(working)

    def _now_s(self) -> float:
        """World time [s]."""
        return self._clock.now_us / 1e6

    def _watch(self) -> None:
        for daemon in self.daemons:
            if daemon.died and daemon.robot not in self._reported:
                self._reported.add(daemon.robot)
                self._trouble(describe_end(daemon))

    def _one_died(self) -> bool:
        return any(daemon.died for daemon in self.daemons)

    def _all_died(self) -> bool:
        return all(daemon.died for daemon in self.daemons)

    def _trouble(self, text: str) -> None:
        self.troubles.append(text)
        self._view.note(text)

    def _result(self, seconds: float) -> RunResult:
        return run_result(
            self._prepared,
            self.simulation,
            start_monotonic_ns=self._clock.start_ns,
            clock_errors=self._clock_errors,
            seconds=seconds,
            troubles=tuple(self.troubles),
            slipped_s=max(self._clock.real_s - self._now_s(), 0.0),
            busy=(time.process_time() - self._cpu_start_s) / max(self._clock.real_s, 1e-9),
        )


def run_result(
    run: Prepared,
    fleet: VirtualFleet,
    *,
    start_monotonic_ns: int,
    clock_errors: tuple[ClockError, ...],
    seconds: float,
    troubles: tuple[str, ...] = (),
    slipped_s: float = 0.0,
    busy: float,
    real_s: float = 0.0,
) -> RunResult:
    """What the run left behind; truth.npz where that is wanted."""
    settings = run.settings
    result = RunResult(
        out=settings.out,
        map_yaml=settings.map_yaml,
        grid=run.grid,
        config=run.config,
        logs=tuple(log_directory(settings, robot) for robot in range(settings.robots)),
        start_poses=run.starts,
        truth_us=np.array([time_us for time_us, _, _ in fleet.truth], dtype=np.int64),
        truth=np.array([poses for _, poses, _ in fleet.truth]).reshape(-1, settings.robots, 3),
        start_monotonic_ns=start_monotonic_ns,
        clock_errors=clock_errors,
        seconds=seconds,
        contacts=tuple(fleet.world.contacts),
        counts=tuple(fleet.medium.counts),
        served=tuple(heard.served for heard in fleet.ear.robots),
        troubles=troubles,
        slipped_s=slipped_s,
        busy=busy,
        real_s=real_s,
    )
    if settings.record_truth:
        _write_truth(result)
    return result


def log_directory(settings: RunSettings, robot: int) -> Path:
    return settings.out / "logs" / f"robot{robot}"


def carry_who_is_due(waiting: list[Carried], elapsed_s: float, fleet: VirtualFleet, view: View) -> None:
    """waiting: by time; those whose time has come are put where they shall be, and taken out of it."""
    while waiting and elapsed_s >= waiting[0].at_s:
        one = waiting.pop(0)
        fleet.carry(one.robot, one.pose)
        view.note(f"robot {one.robot} was carried elsewhere")


def _write_truth(result: RunResult) -> None:
    """truth.npz: what really happened, in the map frame, at 10 Hz.

    stamp_ns (T,) is the world's clock. Robot k's monotonic clock shows clock_ahead_ns[k] more, and gains
    clock_drift_ppb[k] parts in 10^9 from the world's 0 on.
    """
    contacts = [(contact.start_s, contact.robot, contact.other) for contact in result.contacts]
    np.savez_compressed(
        result.out / "truth.npz",
        stamp_ns=result.truth_us * 1000 + result.start_monotonic_ns,
        poses=result.truth,
        contacts=np.array(contacts, dtype=np.float64).reshape(-1, 3),
        slipped_s=np.array(result.slipped_s),
        clock_ahead_ns=np.array([error.ahead_ns for error in result.clock_errors], np.int64),
        clock_drift_ppb=np.array([error.drift_ppb for error in result.clock_errors], np.int64),
        clock_wall_ahead_ns=np.array([error.wall_ahead_ns for error in result.clock_errors], np.int64),
    )


def require_linux() -> None:
    """Pseudo-terminals, epoll and process signals as used here are Linux's."""
    if not hasattr(os, "openpty") or not hasattr(signal, "SIGKILL") or os.uname().sysname != "Linux":
        raise ConfigError("the simulator needs Linux (pseudo-terminals and epoll)")
