"""hippomat-sim, the command line: simulated fleets of real daemons. Exit codes: see --help."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from rich.console import Console

from hippomat_core.errors import ConfigError, HippomatError
from hippomat_sim.fleet_run import FleetRun, RunResult, require_linux
from hippomat_sim.lockstep_run import LockstepRun
from hippomat_sim.maps import find_demo_map
from hippomat_sim.run_logs import completions, log_files
from hippomat_sim.run_settings import Carried, RunSettings
from hippomat_sim.views import view_for
from hippomat_sim.world import WALL

_EPILOG = """\
exit codes: 0 the run was clean; 1 usage error, bad map, or a daemon failed; 2 robots touched something,
a task was done twice, or (demo) a replay diverged

examples:
  hippomat-sim demo
  hippomat-sim run --map lab.yaml --robots 3 --seconds 120 --loss 0.3
  hippomat-sim run --map lab.yaml --robots 5 --seconds 600 --lockstep --out runs/five
  hippomat-sim run --map willow-full-0.05.pgm --resolution 0.05 --slam --speed 0.5 --seconds 300
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(1, f"{self.prog}: {message} (see {self.prog} --help)\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    options = _parser().parse_args(arguments)
    console = Console()
    try:
        require_linux()
        if options.command == "demo":
            from hippomat_sim.demo import run_demo  # here, because matplotlib loads slowly

            return run_demo(_settings(options), console)
        settings = _settings(options)
        run = LockstepRun if options.lockstep else FleetRun
        result = run(settings, view_for(console)).execute()
        _say_where(result, settings, console)
    except HippomatError as error:
        print(f"hippomat-sim: {error}", file=sys.stderr)
        return error.exit_code
    return _summary(result, console)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="hippomat-sim",
        description="Simulated robots with real daemons: each robot's radio (the firmware's own C), base and "
        "lidar are pseudo-terminals that speak the real devices' protocols.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="run | demo")
    run = commands.add_parser("run", help="start a fleet on a map and watch it")
    demo = commands.add_parser("demo", help="five robots for one minute, then replay and report")
    run.add_argument("--map", type=Path, required=True, help="ROS map: its .yaml, or a bare image of it")
    run.add_argument(
        "--resolution", type=float, default=0.05, metavar="M", help="of a bare image: metres per pixel (0.05)"
    )
    demo.add_argument("--map", type=Path, help="ROS map; default: the turtlebot3 world, else our own room")
    run.add_argument(
        "--carry",
        action="append",
        default=[],
        metavar="S:N:X,Y,YAW",
        help="after S seconds somebody carries robot N there (metres, radians); may be given again",
    )
    run.add_argument(
        "--clock-years",
        type=float,
        default=0.0,
        metavar="Y",
        help="the robots' clocks are off by up to Y years (default 0)",
    )
    run.add_argument(
        "--clock-ppm",
        type=float,
        default=0.0,
        metavar="P",
        help="and drift by up to P parts per million (default 0)",
    )
    run.add_argument(
        "--lockstep",
        action="store_true",
        help="everything in this process, as fast as it can: no daemons, no clock; equal runs, equal logs",
    )
    for command in (run, demo):
        _add_run_options(command)
    return parser


def _add_run_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--robots", type=int, default=5, metavar="N", help="fleet size (default 5)")
    add("--tasks", type=int, default=12, metavar="M", help="task slots (default 12)")
    add("--seconds", type=float, default=60.0, metavar="S", help="duration with all robots up (default 60)")
    add(
        "--loss",
        type=float,
        default=0.1,
        metavar="P",
        help="probability that a receiver misses a frame (default 0.1)",
    )
    add("--seed", type=int, default=1, help="start poses, tasks, noise, radio losses (default 1)")
    add("--speed", type=float, metavar="M/S", help="speed limit of the robots (default: as configured, 0.2)")
    add("--config", type=Path, metavar="TOML", help="base for the hippomat.toml that all daemons get")
    add(
        "--slam",
        action=argparse.BooleanOptionalAction,
        help="robots find their place in the map by lidar (default: as configured, on), or trust wheels",
    )
    add("--sealed", action="store_true", help="the fleet has a key: frames are encrypted and authentic")
    add("--out", type=Path, metavar="DIR", help="where everything goes (default runs/sim-TIME)")
    add(
        "--record-truth",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="write truth.npz: true poses at 10 Hz, contacts (default on)",
    )


def _settings(options: argparse.Namespace) -> RunSettings:
    out = options.out or Path("runs") / time.strftime(f"sim-{options.command}-%Y%m%d-%H%M%S")
    return RunSettings(
        options.map or find_demo_map(),
        out,
        options.robots,
        options.tasks,
        options.seconds,
        options.loss,
        options.seed,
        options.speed,
        options.config,
        options.record_truth,
        sealed=options.sealed,
        slam=options.slam,
        resolution_m=getattr(options, "resolution", 0.05),
        carried=tuple(_carried(text) for text in getattr(options, "carry", [])),
        clock_years=getattr(options, "clock_years", 0.0),
        clock_ppm=getattr(options, "clock_ppm", 0.0),
    )


def _carried(text: str) -> Carried:
    try:
        at, robot, place = text.split(":")
        x_m, y_m, yaw_rad = (float(part) for part in place.split(","))
        return Carried(float(at), int(robot), (x_m, y_m, yaw_rad))
    except ValueError:
        raise ConfigError(f"--carry {text!r} is not S:N:X,Y,YAW, e.g. 20:1:2.0,1.5,0.5") from None


def _say_where(result: RunResult, settings: RunSettings, console: Console) -> None:
    """How well the robots knew where they were, and a picture of where that was."""
    whole = not result.troubles and all(any(folder.rglob("*.mcap")) for folder in result.logs)
    if not whole:  # logs of daemons that died are left as they are
        return
    from hippomat_sim.pose_errors import pose_errors, pose_table  # here, because NumPy and logs load slowly
    from hippomat_sim.run_picture import draw_run

    logs = log_files(result.logs)
    console.print(pose_table(pose_errors(logs, result.truth_ns, result.truth, result.clock_errors)))
    picture = draw_run(result, completions(logs), settings)
    console.print(f"picture: {picture}", markup=False, highlight=False, soft_wrap=True)


def _summary(result: RunResult, console: Console) -> int:
    def line(text: str) -> None:
        console.print(text, markup=False, highlight=False, soft_wrap=True)

    line(f"{sum(result.served)} tasks done in {result.seconds:.1f} s (heard on the air); files: {result.out}")
    for contact in result.contacts:
        other = "a wall" if contact.other == WALL else f"robot {contact.other}"
        line(f"contact at {contact.start_s:.1f} s: robot {contact.robot} and {other}")
    if result.slipped_s > 1.0:
        line(
            f"the processor was too busy: the run took {result.slipped_s:.0f} s longer than the world's time"
        )
    if result.real_s:
        factor = result.seconds / result.real_s
        line(f"in lockstep: {result.seconds:.1f} s in {result.real_s:.1f} s, {factor:.1f} x real time")
    else:
        line(f"the world took {100 * result.busy:.0f} % of one processor")
    if result.troubles:
        return 1
    return 2 if result.contacts else 0


if __name__ == "__main__":
    sys.exit(main())
