"""hippomat-bench, the command line: a sub-command for each part that has targets. Exit codes: see --help."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
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
  hippomat-bench motion --map warehouse
  hippomat-bench motion --map random:0.3 --loss 0.3 --seeds 2 --picture motion.png
  hippomat-bench tables --out build/tables --resume
  hippomat-bench tables --only fixed --methods graphsage,greedy --agents 5,10 --episodes 200
"""
_RADIO = """\
Simulates the firmware's own radio cores on a medium with carrier sense, hidden stations and
collisions, each with a minimal host and a clock of its own; beside it the same traffic with random
jitter and unsynchronised periodic sending."""
_TABLES = """\
Compares every way to allocate on the same frozen problems: the paper's four tables beside its own
values, fixed and continuous tasks, what learning adds, losses, larger fleets, permuted slots. Writes
Markdown, CSV, JSON and pictures; what was measured stays in a file, and --resume goes on from there."""

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
    from hippomat_sim.bench import (
        motion_command,
        radio_command,
        tables_command,
    )  # here: guarded() names a missing package

    parser = _Parser(
        prog="hippomat-bench",
        description="What the parts of hippomat achieve, against the targets that they were given.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="radio | motion | tables")
    radio = commands.add_parser(
        "radio",
        help="delivery, fleet time, snapshots and STOP of a fleet of radios",
        description=_RADIO,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    radio_command.add_options(radio)
    radio.set_defaults(run=radio_command.run)
    motion = commands.add_parser(
        "motion",
        help="collision-free motion of many robots: collisions, stuck robots, throughput, time to plan",
        description=_MOTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    motion_command.add_options(motion)
    motion.set_defaults(run=motion_command.run)
    tables = commands.add_parser(
        "tables",
        help="what the ways to allocate achieve, beside the paper's values",
        description=_TABLES,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    tables_command.add_options(tables)
    tables.set_defaults(run=tables_command.run)
    options = parser.parse_args(arguments)
    try:
        return int(options.run(options))
    except HippomatError as error:
        print(f"hippomat-bench: {error}", file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
