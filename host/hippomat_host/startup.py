"""From a configuration to a running daemon and back: links, log, loop, clean stop, and what goes wrong.

Decides the order of starting and stopping. What the daemon does meanwhile is in daemon.py.
"""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from hippomat_core.allocation.policy_file import read_policy
from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.errors import ConfigError, HippomatError
from hippomat_core.localization import localizes
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import BASE, LIDAR, RADIO
from hippomat_core.slam.gtsam_solver import load_gtsam
from hippomat_host.acceptance import accept, greeting_of
from hippomat_host.advice import Given
from hippomat_host.clock import adopt, wall_ns
from hippomat_host.daemon import Daemon, NoRecording, Recording
from hippomat_host.faults import as_error
from hippomat_host.guard_link import GuardLink
from hippomat_host.links import Link, SerialLink
from hippomat_host.lockstep import LockstepReactor
from hippomat_host.loop_solver import LoopSolver
from hippomat_host.reactor import Reactor, RealReactor, StopSignal
from hippomat_host.ros.links import FeedLink, RosBaseLink
from hippomat_host.screen import Screen, screen_for
from hippomat_host.warm_up import (
    prepare_allocator,
    prepare_control,
    prepare_localizer,
    prepare_mapper,
    prepare_planner,
)
from hippomat_logs.manifest import new_session_id, run_manifest
from hippomat_logs.map_files import map_attachments
from hippomat_logs.map_sources import map_from
from hippomat_logs.policy_files import policy_name, policy_of
from hippomat_logs.recorder import Recorder, bound_interpreter_wait
from hippomat_logs.recovery import recover_directory


def run(config: Config, given: Given, lockstep: str | None) -> int:
    """The daemon from start to exit code; raises HippomatError for what the user can put right."""
    behind = (
        given.radio,
        given.base,
        given.lidar,
        config.ros.url,
    )  # a robot behind ROS is taken for a real one
    if lockstep is None and adopt([path for path in behind if path]):
        print("the clock is a simulator's", flush=True)
    if config.slam.mode == "map" and lockstep is None:
        load_gtsam()
    policy = policy_of(config.fleet)
    grid = map_from(given.map) if given.map else None
    if grid is not None and config.robot.start_known:
        _check_start(config.robot, grid, given.fleet)
    if config.log.enabled and lockstep is None:
        for line in recover_directory(config.log.directory):
            print(f"earlier log {line}", flush=True)
    prepare_allocator(config.fleet, policy, partial(print, flush=True))
    prepare_control(config, partial(print, flush=True))
    if localizes(config) and (grid is not None or config.ros.maps):
        prepare_localizer(partial(print, flush=True))
    if config.slam.mode == "map":
        prepare_mapper(partial(print, flush=True))
    prepare_planner(config.planning, partial(print, flush=True))
    bound_interpreter_wait()
    links = make_links(config, given)
    try:
        with StopSignal() as stop, closing_all(links):
            return _run(config, given, lockstep, links, stop, policy, grid)
    except HippomatError:
        raise
    except Exception as fault:  # the motors have been stopped by now
        raise as_error(fault, config.log.directory, "the motors were stopped") from None


def _check_start(robot: RobotConfig, grid: OccupancyGrid, fleet: str) -> None:
    """A robot that is not where it says plans through walls: the likeliest first mistake, so said at once."""
    ix, iy = grid.cell_of(robot.start_x_m, robot.start_y_m)
    where = f"--start, or start of robot {robot.id} in {fleet}," if fleet else "--start"
    start = f"{where} {robot.start_x_m:g},{robot.start_y_m:g}"
    if not grid.holds(ix, iy):
        east_m = grid.origin_x_m + grid.width * grid.resolution_m
        north_m = grid.origin_y_m + grid.height * grid.resolution_m
        raise ConfigError(
            f"{start} is outside the map (x {grid.origin_x_m:g} .. {east_m:g}, "
            f"y {grid.origin_y_m:g} .. {north_m:g}): give metres in the map's frame"
        )
    if grid.cells[iy, ix] != 0:
        raise ConfigError(f"{start} is not a free place of the map: give metres in the map's frame")


@contextlib.contextmanager
def closing_all(links: list[Link]) -> Iterator[None]:
    """Whatever happens, no link stays open; the base's is closed first."""
    try:
        yield
    finally:
        for link in sorted(links, key=lambda link: link.port != BASE):
            link.close()


def make_links(config: Config, given: Given) -> list[Link]:
    """Links of the given ports, radio first; nothing is opened yet."""
    hello, check = greeting_of(config), partial(accept, config)
    links: list[Link] = [SerialLink(RADIO, given.radio, hello, check)]
    if given.base:
        links.append(GuardLink(given.base, hello, check))
    elif config.ros.drives and config.robot.id >= 0:  # an observer drives nothing
        links.append(RosBaseLink(config.ros))
    if given.lidar:
        links.append(SerialLink(LIDAR, given.lidar, hello, check))
    if config.ros.url:
        links.append(FeedLink(config.ros))
    return links


def _run(
    config: Config,
    given: Given,
    lockstep: str | None,
    links: list[Link],
    stop: StopSignal,
    policy: bytes | None,
    grid: OccupancyGrid | None,
) -> int:
    reactor: Reactor
    if lockstep is None:
        reactor = RealReactor(links, stop, grid is not None)
    else:
        reactor = LockstepReactor(lockstep, links, stop, grid is not None)
    if stop.name:  # before there was anything to record
        return 0
    stamp_ns = reactor.begin()
    recording = _recording(config, given, stamp_ns, policy, grid, lossless=lockstep is not None)
    screen = screen_for(given)
    mapping = config.slam.mode == "map" and lockstep is None  # a replay has the recorded answers
    solver = LoopSolver() if mapping else None
    daemon = Daemon(config, links, recording, screen, policy, grid, solver)
    _welcome(screen, given, config, policy)
    fault: Exception | None = None
    reason = ""
    try:
        reason = daemon.run(reactor)
    except Exception as error:
        fault = error
    log = daemon.stop()
    if solver is not None:
        solver.close()
    screen.line(f"stopped{f' ({reason})' if reason else ''}; motors first")
    if log.file:
        lost = f", {log.lost} LOST" if log.lost else ""
        lost += f", {log.shed} of bulk shed" if log.shed else ""
        screen.line(f"log {Path(config.log.directory) / log.file}: {log.records} records{lost}")
    screen.close()
    reactor.close()
    if fault is not None:
        raise fault
    return 0


def _welcome(screen: Screen, given: Given, config: Config, policy: bytes | None) -> None:
    if given.observes:
        screen.line("observing: shows and records the fleet, requests nothing, moves nothing")
    if given.missing and not sys.stdout.isatty():  # the live table keeps showing it
        screen.line(f"missing: {', '.join(given.missing)}")
        screen.line(f"next: {given.next_command()}")
    if config.slam.mode == "map":
        screen.line("mapping: move the robot about by hand; then hippomat-logs map LOG -o MAP.yaml")
    elif not given.observes:
        screen.line(f"allocator: {allocator_line(config.fleet, policy)}")


def allocator_line(fleet: FleetConfig, policy: bytes | None) -> str:
    """How this robot decides, for the screen."""
    if policy is None:
        return f"{fleet.allocator} on the shared snapshot (no trained policy is in use)"
    line = f"{fleet.allocator} with {policy_name(fleet)}, hash {read_policy(policy).hash[:12]}"
    if fleet.policy_per_robot:
        line += "; weights are not compared with the other robots' (policy_per_robot)"
    return line


def _recording(
    config: Config,
    given: Given,
    stamp_ns: int,
    policy: bytes | None,
    grid: OccupancyGrid | None,
    lossless: bool,
) -> Recording:
    if not config.log.enabled:
        return NoRecording()
    extra = {"command": shlex.join(sys.argv), "map": given.map}
    map_hash = b"" if grid is None else grid.hash()
    manifest = run_manifest(
        config, session_id=new_session_id(), map_hash=map_hash, policy=policy, extra=extra
    )
    directory = Path(config.log.directory)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        return Recorder(
            directory,
            manifest,
            config=config,
            wall_ns=wall_ns(),
            stamp_ns=stamp_ns,
            lossless=lossless,
            policy=policy or b"",
            files={} if grid is None else map_attachments(grid),
        )
    except OSError as error:
        raise HippomatError(
            f"cannot record into {directory}: {error.strerror or error}; give --log DIR or --no-log"
        ) from None
