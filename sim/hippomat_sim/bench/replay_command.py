"""`hippomat-bench replay`: how much faster than real time a run is checked and decided again, on one core.

Decides what is measured: the processor time of opening and replaying a log in one process with one thread, by
level. Knows logs; without any it records a short fleet run, with and without SLAM.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from hippomat_core.errors import ConfigError, HippomatError
from hippomat_logs.each_file import progress_bar
from hippomat_logs.manifest import THREAD_SETTINGS
from hippomat_logs.numba_cache import ensure_numba_cache
from hippomat_logs.reader import Run, open_runs
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_sim.bench.core_speed import core_speed, said
from hippomat_sim.bench.radio_report import verdict
from hippomat_sim.bench.radio_targets import Target
from hippomat_sim.maps.demo_room import DEMO_ROOM

MISSED = 2
LEVELS = {"L0": ("L0",), "L1": ("L0", "L1"), "L2": ("L0", "L2"), "L0-L2": ("L0", "L1", "L2")}
MIN_RATIO, MIN_RATIO_SLAM = 50.0, 15.0
SET_FOR_S = 300.0  # the targets are of runs of ten minutes; short ones pay more for their map
PASSES = 2  # the faster one counts: the first also loads compiled code


@dataclass(frozen=True, slots=True)
class ReplayFigures:
    """One run: seconds recorded, and of processor time for each entry of LEVELS."""

    run: str
    slam: bool
    robots: int  # of the fleet
    recorded_s: float
    cpu_s: dict[str, float]
    verdict: str
    identical: bool  # all passes gave the same report
    core_speed: float  # million additions a second in Python, median over the passes

    @property
    def title(self) -> str:
        """robot00 of 5, SLAM."""
        return f"{self.run.split('_')[0]} of {self.robots}{', SLAM' if self.slam else ''}"

    def times_real(self, levels: str) -> float:
        return self.recorded_s / self.cpu_s[levels]


def add_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "logs",
        nargs="*",
        type=Path,
        metavar="LOG",
        help="logs to replay, or directories (default: made here)",
    )
    add("--seconds", type=float, default=30.0, metavar="S", help="length of the runs made here (default 30)")
    add("--json", action="store_true", help="one JSON object instead of a table")


def run(options: argparse.Namespace) -> int:
    """The exit code: MISSED when a target was."""
    if not options.seconds >= 5.0:
        raise ConfigError(f"--seconds {options.seconds:g}: a run needs 5 s at least")
    with tempfile.TemporaryDirectory(prefix="hippomat-bench-") as directory, progress_bar() as bar:
        logs = options.logs
        if not logs:
            task = bar.add_task("recording two runs", total=2)
            logs = []
            for slam in (False, True):
                logs.append(_recorded(Path(directory), options.seconds, slam))
                bar.advance(task)
        runs = open_runs(logs)
        task = bar.add_task("replaying", total=len(runs))
        figures = []
        for one in runs:
            figures.append(_in_one_thread(one))
            bar.advance(task)
    targets = list(_targets(figures))
    if options.json:
        print(json.dumps(_as_json(figures, targets)))
    else:
        _show(figures, targets, Console(highlight=False))
    return MISSED if any(target.missed for target in targets) else 0


def _recorded(directory: Path, seconds: float, slam: bool) -> Path:
    """The log of one of three simulated robots."""
    out = directory / ("slam" if slam else "wheels")
    command = [sys.executable, "-m", "hippomat_sim", "run", "--map", str(DEMO_ROOM), "--robots", "3"]
    command += ["--tasks", "6", "--loss", "0.1", "--seconds", f"{seconds:g}", "--out", str(out)]
    command += ["--slam" if slam else "--no-slam"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode == 1:
        raise HippomatError(f"no run could be recorded: {done.stderr.strip() or done.stdout.strip()}")
    return out / "logs" / "robot0"


def _in_one_thread(run: Run) -> ReplayFigures:
    os.environ.update(dict.fromkeys(THREAD_SETTINGS, "1"))
    ensure_numba_cache()
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(measure, run.paths).result()


def measure(paths: Sequence[Path]) -> ReplayFigures:
    """In this process; its libraries are loaded already."""
    cpu_s: dict[str, float] = {}
    reports, speeds = [], []
    for name, levels in LEVELS.items():
        spent = []
        for _ in range(PASSES):
            speeds.append(core_speed())
            begin_s = time.process_time()
            (run,) = open_runs(list(paths))
            report = replay_run(run, ReplayOptions(levels))
            spent.append(time.process_time() - begin_s)
            reports.append((name, json.dumps(report.as_json(), default=str)))
        cpu_s[name] = min(spent)
    times_ns = [raw.log_time_ns for _, raw in run.raw_in_order()]
    recorded_s = (max(times_ns) - min(times_ns)) / 1e9 if times_ns else 0.0
    identical = len(set(reports)) == len(LEVELS)
    config = run.config
    slam = config.slam.mode != "odometry"
    speed = statistics.median(speeds)
    return ReplayFigures(
        run.name, slam, config.fleet.size, recorded_s, cpu_s, report.verdict, identical, speed
    )


def _targets(figures: Sequence[ReplayFigures]) -> Iterator[Target]:
    for one in figures:
        least = MIN_RATIO_SLAM if one.slam else MIN_RATIO
        short = one.recorded_s < SET_FOR_S
        why_not = f"set for runs of {SET_FOR_S:g} s or more" if short else ""
        yield Target(f"L2 of {one.title}", one.times_real("L2"), least, True, "x real time", why_not)
        yield Target(f"passes of {one.title} that differ", float(not one.identical), 0.0, False, "")


def _as_json(figures: Sequence[ReplayFigures], targets: Sequence[Target]) -> dict[str, Any]:
    runs = [asdict(one) | {"times_real": {name: one.times_real(name) for name in LEVELS}} for one in figures]
    judged = [asdict(target) | {"met": target.met} for target in targets]
    return {"runs": runs, "targets": judged, "met": not any(target.missed for target in targets)}


def _show(figures: Sequence[ReplayFigures], targets: Sequence[Target], console: Console) -> None:
    table = Table(title="times real time, on one core", box=SIMPLE_HEAD, title_justify="left")
    for name in ("run", "recorded", *LEVELS):
        table.add_column(name, justify="left" if name == "run" else "right")
    for one in figures:
        rates = [f"{one.times_real(name):,.0f}x" for name in LEVELS]
        table.add_row(one.title, f"{one.recorded_s:.0f} s", *rates)
    console.print(table)
    if figures:
        console.print(said(statistics.median(one.core_speed for one in figures)))
    for one in figures:
        if not one.verdict.startswith("reproduced"):
            console.print(f"{one.run}: {one.verdict}", style="red", markup=False)
    for target in targets:
        state = "not judged" if target.not_judged else ("met" if target.met else "MISSED")
        sign = ">=" if target.at_least else "<="
        line = f"{state:10} {target.name}: {target.value:.1f} {target.unit} ({sign} {target.bound:g})"
        console.print(line, markup=False, style="red" if state == "MISSED" else "")
    missed = any(target.missed for target in targets)
    console.print(verdict(targets), style="bold red" if missed else "bold green", markup=False)
