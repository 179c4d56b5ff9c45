"""hippomat-bench, the command line: a sub-command for each part that has targets. Exit codes: see --help."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import NoReturn

from hippomat_core.errors import HippomatError
from hippomat_sim.entry import guarded

_EPILOG = """\
exit codes: 0 all judged targets met; 1 wrong usage, nothing was run; 2 a judged target was missed
(a target that was set for other runs than the one asked for is listed as not judged)

examples:
  hippomat-bench radio
  hippomat-bench radio --nodes 30 --rate 10 --hidden 0.2 --seconds 60
  hippomat-bench radio --loss 0.3 --json
  hippomat-bench radio --faults --seconds 3600 --no-plain --plot agreement.png
  hippomat-bench plan FILE.scen... --matrix
  hippomat-bench motion --map warehouse
  hippomat-bench motion --map random:0.3 --loss 0.3 --seeds 2 --picture motion.png
  hippomat-bench slam intel_raw_odometry.log.gz --picture map.png
  hippomat-bench tables --out build/tables --resume
  hippomat-bench tables --only fixed --methods graphsage,greedy --agents 5,10 --episodes 200
  hippomat-bench logs runs/robot03_*.mcap
  hippomat-bench logs --large
  hippomat-bench replay runs/robot03_*.mcap
"""


@dataclass(frozen=True, slots=True)
class _Command:
    """One part: its module NAME_command has add_options(parser) and run(options)."""

    name: str
    help: str
    description: str


_COMMANDS = (
    _Command(
        "radio",
        "delivery, fleet time, snapshots and STOP of a fleet of radios",
        "Simulates the firmware's own radio cores on a medium with carrier sense, hidden stations and\n"
        "collisions, each with a minimal host and a clock of its own; beside it the same traffic with\n"
        "random jitter and unsynchronised periodic sending.",
    ),
    _Command(
        "plan",
        "shortest paths on published scenarios: right, feasible, how fast",
        "Asks every query of MovingAI scenarios, judges each path by an independent checker, and a\n"
        "sample of the queries also plain A* with heapq and other people's path finders; --matrix compares\n"
        "the travel costs of a decision in the air.",
    ),
    _Command(
        "motion",
        "collision-free motion of many robots: collisions, stuck robots, throughput, time to plan",
        "Robots that drive to one goal after another on one map, each planning for the whole fleet from\n"
        "what it heard; a checker that knows only geometry looks for collisions. The bound is every robot\n"
        "driving its shortest ways without a pause, as if it were alone.",
    ),
    _Command(
        "slam",
        "mapping from lidar logs: errors against measured relations, time per scan, the map",
        "Maps a lidar log in CARMEN's format as a robot would, scan by scan, closes loops, sharpens the\n"
        "map, and compares the poses with measured relations where there are any.",
    ),
    _Command(
        "tables",
        "what the ways to allocate achieve, beside the paper's values",
        "Compares every way to allocate on the same frozen problems: the paper's four tables beside its own\n"
        "values, fixed and continuous tasks, what learning adds, losses, larger fleets, permuted slots.\n"
        "Writes Markdown, CSV, JSON and pictures; what was measured stays in a file, and --resume goes on\n"
        "from there.",
    ),
    _Command(
        "logs",
        "reading logs beside other readers, what recording costs",
        "Decodes every message of a log with our reader, rosbags, mcap and mcap_ros2, each in a process of\n"
        "its own; records as a robot of ten does, in real time beside a loop that works; and, with --large,\n"
        "summarises a log of gigabytes.",
    ),
    _Command(
        "replay",
        "replaying logs: how many times faster than real time, by level",
        "Opens and replays logs in one process with one thread, level by level, and compares its processor\n"
        "time with the time recorded. Without logs it records two short runs of three simulated robots.",
    ),
)

_MOTION = """\
Robots that drive to one goal after another on one map, each planning for the whole fleet from what it
heard; a checker that knows only geometry looks for collisions. The bound is every robot driving its
shortest ways without a pause, as if it were alone."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(1, f"{self.prog}: {message} (see {self.prog} --help)\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    return guarded("hippomat-bench", lambda: _main(arguments))


def _main(arguments: Sequence[str] | None) -> int:
    parser = _Parser(
        prog="hippomat-bench",
        description="What the parts of hippomat achieve, against the targets that they were given.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    names = " | ".join(command.name for command in _COMMANDS)
    parts = parser.add_subparsers(dest="command", required=True, metavar=names)
    for command in _COMMANDS:
        part = parts.add_parser(
            command.name,
            help=command.help,
            description=command.description,
            epilog=_EPILOG,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module = import_module(
            f"hippomat_sim.bench.{command.name}_command"
        )  # guarded() names a missing package
        module.add_options(part)
        part.set_defaults(run=module.run)
    options = parser.parse_args(arguments)
    try:
        return int(options.run(options))
    except HippomatError as error:
        print(f"hippomat-bench: {error}", file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
