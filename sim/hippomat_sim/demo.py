"""hippomat-sim demo: a simulated run, every log replayed, one table, one picture, one verdict."""

from __future__ import annotations

import shlex
import time

from rich.console import Console

from hippomat_logs.metrics import run_metrics
from hippomat_sim.demo_report import DemoReport, show
from hippomat_sim.fleet_run import FleetRun
from hippomat_sim.pose_errors import pose_errors, pose_table
from hippomat_sim.run_logs import completions, log_files, replay
from hippomat_sim.run_picture import about, draw_run
from hippomat_sim.run_settings import RunSettings
from hippomat_sim.views import view_for

REPRODUCED, FAILED, RUN_FAILED = 0, 1, 2


def run_demo(settings: RunSettings, console: Console) -> int:
    """Run, replay, report; returns the exit code."""
    _say(console, f"{about(settings)} on {settings.map_yaml.stem}; everything goes to {settings.out}")
    run = FleetRun(settings, view_for(console))
    result = run.execute()
    if run.interrupted:
        _say(console, f"interrupted: what was recorded so far is in {result.out / 'logs'}")
        return FAILED
    logs = log_files(result.logs)
    began_s = time.monotonic()
    _say(console, f"replaying {len(logs)} logs: bytes, decisions, the real daemon, motion ...")
    verdicts = replay(logs)  # shows its own progress on a terminal
    _say(console, f"{len(logs)} logs replayed in {time.monotonic() - began_s:.0f} s")
    report = DemoReport(run_metrics(logs), verdicts, result.contacts, result.troubles)
    picture = draw_run(result, completions(logs), settings)
    show(report, console)
    console.print(pose_table(pose_errors(logs, result.truth_ns, result.truth, result.clock_errors)))
    _say(console, f"picture: {picture}")
    _say(
        console,
        f"logs:    {result.out / 'logs'}  (again: hippomat-replay {shlex.quote(str(result.out / 'logs'))})",
    )
    return exit_code(report)


def exit_code(report: DemoReport) -> int:
    """A daemon that failed, then the worst replay, then contacts and tasks done twice."""
    if report.troubles:
        return FAILED
    worst = max((verdict.exit_code for verdict in report.verdicts), default=FAILED)
    if worst != REPRODUCED:
        return worst
    return RUN_FAILED if report.contacts or report.metrics.completed_twice else REPRODUCED


def _say(console: Console, text: str) -> None:
    console.print(text, markup=False, highlight=False, soft_wrap=True)
