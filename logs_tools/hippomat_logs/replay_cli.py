"""hippomat-replay: reproduce recorded runs, say how far, and name the first divergence.

Decides what is printed and the exit code: 0 reproduced, 1 tool or usage error, 2 diverged, 3 damaged.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from pathlib import Path
from queue import Empty
from typing import Any, NoReturn

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from hippomat_core.errors import HippomatError
from hippomat_logs.interrupts import interrupts_held
from hippomat_logs.manifest import recorded_threads
from hippomat_logs.reader import Run, open_again, open_runs
from hippomat_logs.replay import LEVELS, ReplayOptions, replay_run
from hippomat_logs.report import DAMAGED, LOSSY, TOOL_ERROR, LevelResult, RunReport, overall_exit_code
from hippomat_logs.serve import serve

EPILOG = """exit codes:
  0  reproduced            1  tool or usage error
  2  diverged              3  a log is damaged or lossy

levels:
  L0      every byte, checksum and record number
  L1      serial bytes decode to the recorded events and encode to the same bytes
  L2      the recorded events give the recorded decisions
  daemon  the real daemon on fake serial ports that offer the recorded bytes decides the same
  L3      the recorded commands move a simulated robot as recorded (needs hippomat[sim])
"""
_COLOURS = {"reproduced": "green", "diverged": "red", "damaged": "red", "error": "red"}
_CODES = {0: "green", 1: "red", 2: "red", 3: "red"}


class Parser(argparse.ArgumentParser):
    """argparse's own exit code for usage errors is 2, which here means "diverged"."""

    def error(self, message: str) -> NoReturn:
        self.print_usage(sys.stderr)
        self.exit(TOOL_ERROR, f"{self.prog}: {message}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    options = parser().parse_args(arguments)
    console = Console(highlight=False, soft_wrap=not sys.stdout.isatty())
    try:
        runs = open_runs(options.logs)
        if options.serve:
            return serve(runs, console)
        reports = _replay_all(runs, _options(options))
    except HippomatError as error:
        _say_error(error, options.json, console)
        return error.exit_code
    except KeyboardInterrupt:
        print("hippomat-replay: interrupted", file=sys.stderr)
        return TOOL_ERROR
    except OSError as error:
        print(f"hippomat-replay: {error}", file=sys.stderr)
        return TOOL_ERROR
    if options.json:
        print(json.dumps([report.as_json() for report in reports], indent=2, default=str))
    else:
        show(reports, console)
    return overall_exit_code(reports)


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
    made.add_argument(
        "--serve", action="store_true", help="only offer the recorded ports to a daemon of yours"
    )
    return made


def _levels(text: str) -> tuple[str, ...]:
    wanted = {name.strip() for name in text.split(",")} | {"L0"}
    unknown = wanted - set(LEVELS)
    if unknown:
        raise argparse.ArgumentTypeError(
            f"unknown level {', '.join(sorted(unknown))}; known: {', '.join(LEVELS)}"
        )
    return tuple(level for level in LEVELS if level in wanted)


def _options(options: argparse.Namespace) -> ReplayOptions:
    levels = tuple(name for name in options.levels if not (options.no_daemon and name == "daemon"))
    return ReplayOptions(levels, options.strict)


def _say_error(error: HippomatError, as_json: bool, console: Console) -> None:
    if as_json:
        level = LevelResult("L0", LOSSY if error.exit_code == DAMAGED else "error", detail=str(error))
        print(json.dumps([RunReport("", -1, [level]).as_json()], indent=2))
    else:
        console.print(f"[red]{'damaged' if error.exit_code == DAMAGED else 'error'}[/red]: ", end="")
        console.print(str(error), markup=False)


# ---- several runs at once ----

_progress: Any = None  # in a worker: the queue to its parent


def _start_worker(queue: Any) -> None:
    global _progress
    _progress = queue


def _replay_in_worker(run_paths: tuple[Path, ...], inside: str, options: ReplayOptions) -> RunReport:
    run = open_again(run_paths, inside)
    return replay_run(run, options, lambda level, done: _progress.put((run.name, level, done)))


def _replay_all(runs: list[Run], options: ReplayOptions) -> list[RunReport]:
    """Each run in a process of its own, which computes with as many threads as the daemon did."""
    os.environ.update(recorded_threads(runs[0].manifest))
    context = multiprocessing.get_context("spawn")
    queue: Any = context.Queue()
    workers = max(1, min(len(runs), os.cpu_count() or 1))
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    with bar, ProcessPoolExecutor(workers, context, _start_worker, (queue,)) as pool:
        try:
            with interrupts_held():  # workers inherit it: Ctrl-C is this process's affair
                futures = [pool.submit(_replay_in_worker, run.paths, run.inside, options) for run in runs]
            _watch(futures, runs, queue, bar)
        except KeyboardInterrupt:
            for worker in multiprocessing.active_children():
                worker.terminate()
            raise
        return [future.result() for future in futures]


def _watch(futures: list[Future[RunReport]], runs: list[Run], queue: Any, bar: Progress) -> None:
    rows = {run.name: bar.add_task(f"{run.name[:7]} start ", total=run.records or None) for run in runs}
    pending: set[Future[RunReport]] = set(futures)
    while pending:
        _, pending = wait(pending, timeout=0.1)
        try:
            while True:
                name, level, done = queue.get_nowait()
                bar.update(rows[name], description=f"{name[:7]} {level:6}", completed=done)
        except Empty:
            pass


# ---- what is printed ----


def show(reports: list[RunReport], console: Console) -> None:
    table = Table(title=None, pad_edge=False, box=None)
    for name, justify in (
        ("run", "left"),
        ("level", "left"),
        ("result", "left"),
        ("compared", "right"),
        ("", "left"),
    ):
        table.add_column(name, justify=justify, overflow="fold")  # type: ignore[arg-type]
    for report in reports:
        name = f"robot {report.robot}" if report.robot >= 0 else "observer"
        for index, result in enumerate(report.results):
            colour = _COLOURS.get(result.status, "yellow")
            amount = f"{result.compared:,} {result.unit}" if result.unit else ""
            status = f"[{colour}]{result.status}[/{colour}]"
            table.add_row(name if not index else "", result.level, status, amount, _plain(result.detail))
    console.print(table)
    for report in reports:
        _show_findings(report, console)
    for report in reports:
        colour = _CODES[report.exit_code]
        console.print(f"{report.name}: [{colour}]{report.verdict}[/{colour}]")


def _show_findings(report: RunReport, console: Console) -> None:
    for result in report.results:
        for note in result.notes:
            console.print(f"  robot {report.robot} {result.level}: {_plain(note)}")
        if result.divergence is not None:
            console.print("[red]first divergence[/red]: ", end="")
            console.print(f"{result.level}: {result.divergence}", markup=False)


def _plain(text: str) -> str:
    return text.replace("[", r"\[")


if __name__ == "__main__":
    sys.exit(main())
