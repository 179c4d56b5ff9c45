"""hippomat-logs recover: readable logs of what a dead daemon left, and of damaged ones.

Decides the exit code: 3 where a log stays damaged. What a recovered one lacks is said by whoever reads it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from hippomat_core.errors import HippomatError
from hippomat_logs.recovery import recover
from hippomat_logs.report import DAMAGED, REPRODUCED
from hippomat_logs.terminal import Terminal


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("paths", nargs="+", type=Path, metavar="PATH", help="directories or files")


def run(options: argparse.Namespace, console: Console) -> int:
    """What cannot be recovered keeps no other log from it."""
    codes, said = {REPRODUCED}, False
    for path in options.paths:
        try:
            outcomes = recover(path)
        except HippomatError as error:
            Terminal(stderr=True).print(f"error: {error}", style="red", markup=False)
            codes.add(error.exit_code)
            said = True
            continue
        for outcome in outcomes:
            console.print(outcome.line, markup=False, style="red" if outcome.stays_damaged else "")
            codes.add(DAMAGED if outcome.stays_damaged else REPRODUCED)
            said = True
    if not said:
        console.print("nothing to recover")
    return max(codes)
