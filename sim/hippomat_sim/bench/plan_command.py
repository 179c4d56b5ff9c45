"""`hippomat-bench plan`: its options, and what it does with them."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from hippomat_core.errors import ConfigError
from hippomat_sim.bench.plan_matrix import run_matrix
from hippomat_sim.bench.plan_peers import peers
from hippomat_sim.bench.plan_report import PlanReport, as_json, show
from hippomat_sim.bench.plan_run import run_file
from hippomat_sim.maps.movingai import load_scenario

MISSED = 2
SAMPLE, PAIRS = 60, 900


def add_options(parser: argparse.ArgumentParser) -> None:
    """What run() reads."""
    add = parser.add_argument
    add("files", nargs="*", type=Path, metavar="FILE.scen", help="scenarios, each with its .map beside it")
    add("--matrix", action="store_true", help="the cost matrix in the air, too (a minute)")
    known = ",".join(peers())
    add("--peers", default=known, metavar="NAMES", help=f"beside heapq A*, or none (default {known})")
    limit = f"queries for each peer and file (default {SAMPLE}), and pairs of --matrix (default {PAIRS}: all)"
    add("--limit", type=int, metavar="N", help=limit)
    add("--json", action="store_true", help="one JSON object instead of tables")


def run(options: argparse.Namespace) -> int:
    """The exit code: MISSED where an answer is wrong or a target was missed."""
    if not options.files and not options.matrix:
        raise ConfigError("plan: nothing to do: name scenarios (FILE.scen ...) or give --matrix")
    if options.limit is not None and options.limit < 1:
        raise ConfigError(f"--limit {options.limit}: at least 1 query is needed")
    names = [] if options.peers == "none" else options.peers.split(",")
    unknown = [name for name in names if name not in peers()]
    if unknown:
        raise ConfigError(f"--peers {unknown[0]!r} is not known: choose from {', '.join(peers())} or none")
    scenarios = [load_scenario(path) for path in options.files]  # all are read before the first is run
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task("", total=None)

        def progress(what: str, done: int, of: int) -> None:
            bar.update(task, description=what, completed=done, total=of)

        results = [run_file(scenario, names, options.limit or SAMPLE, progress) for scenario in scenarios]
        matrix = run_matrix(options.limit or PAIRS, progress) if options.matrix else None
    report = PlanReport(results, matrix)
    if options.json:
        print(json.dumps(as_json(report)))
    else:
        show(report, Console(highlight=False))
    return 0 if report.met else MISSED
