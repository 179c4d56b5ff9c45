"""The command line of hippomat-replay: what can be asked, and what is refused before a log is opened."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NoReturn

from hippomat_core.errors import HippomatError
from hippomat_logs.closed_loop import command as closed_loop
from hippomat_logs.outputs import refuse_directory, refuse_existing, refuse_suffix
from hippomat_logs.pictures import require_matplotlib
from hippomat_logs.replay import LEVELS, ReplayOptions
from hippomat_logs.report import TOOL_ERROR

EPILOG = """exit codes:
  0  reproduced            1  tool or usage error
  2  diverged              3  a log is damaged or lossy

levels:
  L0      every byte, checksum and record number
  L1      serial bytes decode to the recorded events and encode to the same bytes
  L2      the recorded events give the recorded decisions
  daemon  the real daemon on fake serial ports that offer the recorded bytes decides the same
  L3      the recorded commands move a simulated robot as recorded (needs hippomat[sim])
  L4      --closed-loop: the whole fleet again in simulation, many times (needs hippomat[sim])
"""


class Parser(argparse.ArgumentParser):
    """argparse's own exit code for usage errors is 2, which here means "diverged"."""

    def error(self, message: str) -> NoReturn:
        self.print_usage(sys.stderr)
        self.exit(TOOL_ERROR, f"{self.prog}: {message}\n")


def parser() -> Parser:
    made = Parser(
        prog="hippomat-replay",
        description="Reproduce recorded runs: check every log, then decide everything again from its events.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("logs", nargs="+", type=Path, metavar="RUN.mcap", help="logs, or directories of logs")
    made.add_argument("--levels", type=_levels, default=LEVELS, metavar="L0,L1,...", help="only these levels")
    made.add_argument(
        "--no-daemon", action="store_true", help="do not start the daemon (same as leaving it out)"
    )
    made.add_argument("--strict", action="store_true", help="a miss of L3's bar is a divergence")
    made.add_argument("--json", action="store_true", help="print the results as JSON")
    made.add_argument("--sim", action="store_true", help="only L0 and L3, with pictures if --plots is given")
    made.add_argument(
        "-o",
        "--plots",
        type=Path,
        metavar="DIR",
        help="pictures of L3 for each robot, or of --closed-loop, in this directory (needs hippomat[viz])",
    )
    _add_serve(made.add_argument_group("offering a run to a daemon of yours"))
    _add_clip(made.add_argument_group("cutting a divergence out"))
    _add_golden(made.add_argument_group("golden runs (docs/replay.md)"))
    closed_loop.add_options(made)
    return made


def _add_serve(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--serve", action="store_true", help="only offer the recorded ports, as pseudo-terminals"
    )
    group.add_argument("--speed", type=float, default=1.0, metavar="X", help="times real time (default 1)")
    group.add_argument(
        "--step", action="store_true", help="wait for Enter: one read; N: so many; Ns: so many seconds"
    )


def _add_clip(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--clip", type=Path, metavar="OUT.mcap", help="the smallest log that shows the first divergence"
    )
    group.add_argument(
        "--at", type=float, metavar="S", help="with --clip: 2 s around this moment instead, to look at"
    )


def _add_golden(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--update-golden", action="store_true", help="accept what is decided now; needs --reason"
    )
    group.add_argument("--reason", default="", metavar="TEXT", help="why the new decisions are right")
    group.add_argument(
        "--allow-dirty", action="store_true", help="bless although the work tree is not committed"
    )


def check(options: argparse.Namespace) -> None:
    """HippomatError for options that do not go together."""
    modes = [name for name in ("serve", "clip", "update_golden", "sim") if getattr(options, name)]
    again = closed_loop.asked(options)
    levels = ["levels"] if again and options.levels != LEVELS else []
    if len(modes) > 1 or (again and (modes or levels)):
        named = " and ".join(f"--{name.replace('_', '-')}" for name in (*modes, *levels, *again[:1]))
        raise HippomatError(f"{named}: choose one")
    for name, mode in (("at", "clip"), ("step", "serve"), ("reason", "update_golden")):
        if getattr(options, name) not in (None, False, "") and mode not in modes:
            raise HippomatError(f"--{name} goes with --{mode.replace('_', '-')}")
    if options.speed != 1.0 and not options.serve:
        raise HippomatError("--speed goes with --serve")
    if options.clip is not None:
        refuse_suffix(options.clip, (".mcap",))
        refuse_existing(options.clip)
    if options.plots is not None:
        refuse_directory(options.plots)
        require_matplotlib()
    if not 0.0 < options.speed < float("inf"):
        raise HippomatError(f"--speed {options.speed:g}: give a factor above 0")


def _levels(text: str) -> tuple[str, ...]:
    wanted = {name.strip() for name in text.split(",")} | {"L0"}
    if "L4" in wanted:
        raise argparse.ArgumentTypeError("L4 is of a fleet, not of one log: --closed-loop runs it")
    unknown = wanted - set(LEVELS)
    if unknown:
        raise argparse.ArgumentTypeError(
            f"unknown level {', '.join(sorted(unknown))}; known: {', '.join(LEVELS)}"
        )
    return tuple(level for level in LEVELS if level in wanted)


def replay_options(options: argparse.Namespace) -> ReplayOptions:
    asked = ("L0", "L3") if options.sim else options.levels
    levels = tuple(name for name in asked if not (options.no_daemon and name == "daemon"))
    return ReplayOptions(levels, options.strict, options.plots)
