"""hippomat-logs: look into logs, check and rescue them, cut and convert them, and say what a fleet achieved.

Exit codes: 0 done, 1 tool or usage error, 2 conflicts: a task had two confirmed holders, 3 a log is
damaged or lossy. The commands are in commands/.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import Any

from rich.console import Console

from hippomat_core.errors import HippomatError
from hippomat_logs.commands import (
    conflicts,
    convert,
    doctor,
    explain,
    export,
    fuse,
    info,
    make_map,
    metrics,
    plot,
    recover,
    report,
    select,
)
from hippomat_logs.outputs import RULE
from hippomat_logs.recovery import unfinished
from hippomat_logs.replay_arguments import Parser
from hippomat_logs.terminal import Terminal

_COMMANDS: tuple[tuple[str, Callable[..., None], Callable[..., int], str], ...] = (
    ("info", info.add_options, info.run, "what logs hold, by their indexes"),
    ("doctor", doctor.add_options, doctor.run, "read every byte and name every fault"),
    (
        "filter",
        select.add_filter_options,
        select.run_filter,
        "some topics, times or robots as a new log",
    ),
    (
        "merge",
        select.add_merge_options,
        select.run_merge,
        "several logs side by side in a file, for viewers",
    ),
    (
        "fuse",
        fuse.add_options,
        fuse.run,
        "a fleet's logs as one causal run on one clock, which replays",
    ),
    ("convert", convert.add_options, convert.run, "between .mcap, ROS 1 .bag and ROS 2 bags"),
    ("export", export.add_options, export.run, "topics as CSV or Parquet, trajectories for evo"),
    ("map", make_map.add_options, make_map.run, "the map of a place from the log of a robot that was there"),
    (
        "metrics",
        metrics.add_options,
        metrics.run,
        "tasks, travel cost, conflicts, times, links; over many trials too",
    ),
    (
        "conflicts",
        conflicts.add_options,
        conflicts.run,
        "double requests, double claims, their causes",
    ),
    ("explain", explain.add_options, explain.run, "why a task went to whom, why a robot decided as it did"),
    (
        "report",
        report.add_options,
        report.run,
        "a fleet's run as one HTML page: animated map, time bars, radio",
    ),
    ("plot", plot.add_options, plot.run, "a picture: path, speed, battery, rounds; or scans from above"),
    (
        "recover",
        recover.add_options,
        recover.run,
        "make logs of what a dead daemon left, and of damaged ones",
    ),
)


def main(arguments: Sequence[str] | None = None) -> int:
    options = parser().parse_args(arguments)
    try:
        if options.command not in ("doctor", "recover"):  # which read it
            for line in unfinished(getattr(options, "paths", ())):
                Terminal(stderr=True).print(f"note: {line}", style="yellow", markup=False)
        return int(options.run(options, Terminal()))
    except HippomatError as error:
        Terminal(stderr=True).print(f"error: {error}", style="red", markup=False)
        return error.exit_code
    except BrokenPipeError:
        raise
    except OSError as error:
        print(
            f"error: {error.filename or 'the results cannot be written'}: {error.strerror or error}",
            file=sys.stderr,
        )
        return 1
    except KeyboardInterrupt:
        print("hippomat-logs: interrupted", file=sys.stderr)
        return 1


def parser() -> Parser:
    made = Parser(
        prog="hippomat-logs",
        description="Look into the logs of runs. To reproduce a run: hippomat-replay.",
        epilog="exit codes: 0 done, 1 tool or usage error, 2 conflicts: a task had two confirmed holders, "
        f"3 a log is damaged or lossy; {RULE}",
    )
    commands = made.add_subparsers(dest="command", required=True, parser_class=Parser, metavar="COMMAND")

    def add(name: str, text: str, run: Callable[[argparse.Namespace, Console], int]) -> Any:
        command = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        command.set_defaults(run=run)
        return command

    for name, add_options, run, text in _COMMANDS:
        add_options(add(name, text, run))
    return made


if __name__ == "__main__":
    sys.exit(main())
