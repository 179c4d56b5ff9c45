"""hippomat-logs doctor: every fault of every log, named. Exit code 3 if anything is damaged or missing."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from hippomat_core.errors import HippomatError
from hippomat_logs.each_file import each_file, share_bar
from hippomat_logs.examination import DAMAGE, LOSS, Examination, between_parts, examine
from hippomat_logs.file_kinds import each_once, logs_among
from hippomat_logs.opened_run import log_files
from hippomat_logs.report import DAMAGED, REPRODUCED, TOOL_ERROR
from hippomat_logs.sink import ACTIVE

SHOWN = 20
_COLOURS = {DAMAGE: "red", LOSS: "red"}


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("paths", nargs="+", type=Path, metavar="LOG", help="logs, or directories of logs")
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(options: argparse.Namespace, console: Console) -> int:
    given = each_once(path for one in options.paths for path in _with_unfinished(one))
    paths, foreign = logs_among(given)
    if len(paths) == 1:
        with share_bar(f"examining {paths[0].name}") as told:
            examined = [examine(paths[0], told)]
    else:
        examined = [found for _, found in each_file(paths, examine, "examining")]
    between = between_parts(examined)
    sound = all(found.sound for found in examined) and not between
    if options.json:
        facts = {"files": [_as_json(found) for found in examined], "runs": between, "sound": sound}
        print(json.dumps({**facts, "no_logs": foreign}, indent=2))
    else:
        for found in examined:
            _show(found, console)
        for line in between:
            console.print(f"[red]loss[/red]    {escape(line)}")
        good = sum(found.sound for found in examined)
        console.print(f"{good} of {len(examined)} files are sound")
        for line in foreign:
            console.print(f"left out: {line}", style="yellow", markup=False)
    return DAMAGED if not sound else TOOL_ERROR if foreign else REPRODUCED


def _with_unfinished(path: Path) -> list[Path]:
    """Logs in a directory, those that were never finished too."""
    unfinished = sorted(path.rglob(f"*.mcap{ACTIVE}")) if path.is_dir() else []
    try:
        return [*log_files(path), *unfinished]
    except HippomatError:
        if unfinished:
            return unfinished
        raise


def _show(found: Examination, console: Console) -> None:
    verdict = "sound" if found.sound else "[red]not sound[/red]"
    kinds = f": {found.records:,} records and {found.views:,} views for ROS tools" if found.views else ""
    total = f"{found.records + found.views:,} messages examined"
    console.print(f"[bold]{escape(found.path.name)}[/bold]: {verdict}, {total}{kinds}")
    for (kind, text), count in list(found.faults.items())[:SHOWN]:
        times = f" ({count} times)" if count > 1 else ""
        console.print(f"  [{_COLOURS.get(kind, 'yellow')}]{kind:8}[/]{escape(text)}{times}")
    if len(found.faults) > SHOWN:
        console.print(f"  and {len(found.faults) - SHOWN} more (all with --json)")


def _as_json(found: Examination) -> dict[str, Any]:
    faults = [{"kind": kind, "text": text, "times": n} for (kind, text), n in found.faults.items()]
    counts = {"messages": found.records + found.views, "views": found.views}
    return {"file": str(found.path), "sound": found.sound, **counts, "faults": faults}
