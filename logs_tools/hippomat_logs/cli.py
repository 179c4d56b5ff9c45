"""hippomat-logs: what is in a log (info), what the fleet achieved (metrics), rescue after a crash (recover).

Exit codes: 0 done, 1 tool or usage error, 3 a log is damaged or lossy.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections import Counter
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from hippomat_core.errors import HippomatError
from hippomat_logs.metrics import FleetMetrics, run_metrics
from hippomat_logs.reader import Run, open_runs
from hippomat_logs.recovery import recover
from hippomat_logs.replay_cli import Parser
from hippomat_logs.report import DAMAGED, REPRODUCED
from hippomat_logs.tables import fleet_lines, metrics_table


def main(arguments: Sequence[str] | None = None) -> int:
    options = parser().parse_args(arguments)
    console = Console(highlight=False, soft_wrap=not sys.stdout.isatty())
    commands = {"info": _info, "metrics": _metrics, "recover": _recover}
    try:
        return commands[options.command](options, console)
    except HippomatError as error:
        console.print(f"error: {error}", style="red", markup=False)
        return error.exit_code
    except OSError as error:
        print(f"error: {error.filename or 'output'}: {error.strerror or error}", file=sys.stderr)
        return 1
    except (KeyboardInterrupt, BufferError):  # the second where the first strikes inside a memory map
        print("hippomat-logs: interrupted", file=sys.stderr)
        return 1


def parser() -> Parser:
    made = Parser(
        prog="hippomat-logs",
        description="Look into the logs of runs. To reproduce a run: hippomat-replay.",
        epilog="exit codes: 0 done, 1 tool or usage error, 3 a log is damaged or lossy",
    )
    commands = made.add_subparsers(dest="command", required=True, parser_class=Parser, metavar="COMMAND")
    info = commands.add_parser("info", help="what a log holds, after a check of every byte")
    info.add_argument("paths", nargs="+", type=Path, metavar="LOG", help="logs, or directories of logs")
    metrics = commands.add_parser("metrics", help="tasks, travel cost, conflicts, allocation time, frames")
    metrics.add_argument(
        "paths", nargs="+", type=Path, metavar="LOG", help="logs of one fleet, or directories"
    )
    metrics.add_argument("--json", action="store_true", help="print JSON")
    rescue = commands.add_parser("recover", help="make logs of what a dead daemon left (NAME.mcap.active)")
    rescue.add_argument("paths", nargs="+", type=Path, metavar="PATH", help="directories or files")
    return made


def _recover(options: argparse.Namespace, console: Console) -> int:
    lines = [line for path in options.paths for line in recover(path)]
    for line in lines or ["nothing to recover"]:
        console.print(line, markup=False)
    return REPRODUCED


def _metrics(options: argparse.Namespace, console: Console) -> int:
    metrics = run_metrics(options.paths)
    if options.json:
        print(json.dumps(as_json(metrics), indent=2))
        return REPRODUCED
    console.print(metrics_table(metrics))
    for line in fleet_lines(metrics):
        console.print(line)
    return REPRODUCED


def as_json(metrics: FleetMetrics) -> dict[str, Any]:
    """Everything but the paths driven and the single compute times."""
    robots = []
    for robot in metrics.robots:
        facts = dataclasses.asdict(robot)
        for name in ("path", "compute_ms", "requested", "confirmed", "seen"):
            del facts[name]
        if not robot.guard_limited:
            facts["guard_nearest_m"] = None  # JSON has no infinity
        robots.append({**facts, "travel_cost_s": robot.travel_cost_s, "driven_m": robot.driven_m})
    return {
        "completed": len(metrics.completed),
        "completed_twice": metrics.completed_twice,
        "travel_cost_s": metrics.travel_cost_s,
        "travel_time_s": metrics.travel_time_s,
        "conflict_free_rate": metrics.conflict_free_rate,
        "allocation_s": metrics.allocation_s,
        "robots": robots,
    }


def _info(options: argparse.Namespace, console: Console) -> int:
    code = REPRODUCED
    for run in open_runs(options.paths):
        counts: Counter[str] = Counter()
        times: list[int] = []
        for record in run.records_in_order():
            counts[record.topic] += 1
            times = [times[0] if times else record.log_time_ns, record.log_time_ns]
        _show_run(run, times, console)
        table = Table(box=None, pad_edge=False, show_header=False)
        table.add_column("topic")
        table.add_column("records", justify="right")
        for topic, count in sorted(counts.items()):
            table.add_row(f"  {topic}", f"{count:,}")
        console.print(table)
        for line in run.lost:
            console.print(f"  [red]lost[/red]: {line}")
        code = DAMAGED if run.lost else code
    return code


def _show_run(run: Run, times: list[int], console: Console) -> None:
    facts = run.manifest
    who = f"robot {run.robot}" if run.robot >= 0 else "observer"
    size_mib = sum(path.stat().st_size for path in run.paths) / 2**20
    console.print(f"[bold]{run.name}[/bold]: {who} of fleet {facts.get('fleet', '?')}")
    for path in run.paths:
        console.print(f"  {path}", markup=False)
    if times:
        begun = datetime.fromtimestamp(times[0] / 1e9, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
        lasted_s = (times[1] - times[0]) / 1e9
        console.print(f"  begun {begun}, {lasted_s:.1f} s, {run.records:,} records, {size_mib:.1f} MiB")
    state = "recovered after a crash: its last moments are missing" if run.recovered else "whole"
    console.print(f"  {state}; recorded by hippomat {facts.get('hippomat', '?')} on {facts.get('host', '?')}")
    console.print(f"  map {facts.get('map_hash', '')[:16] or 'none'}, allocator {run.config.fleet.allocator}")


if __name__ == "__main__":
    sys.exit(main())
