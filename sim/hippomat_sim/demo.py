"""hippomat-sim demo: a simulated run, every log replayed, one table, one picture, one verdict."""

from __future__ import annotations

import shlex
import time
from collections.abc import Sequence

import numpy as np
from rich.console import Console

from hippomat_logs.metrics import run_metrics
from hippomat_sim.demo_report import DemoReport, show
from hippomat_sim.fleet_run import FleetRun, RunResult
from hippomat_sim.picture import PictureData, draw
from hippomat_sim.run_logs import Completion, completions, log_files, replay
from hippomat_sim.run_settings import RunSettings
from hippomat_sim.views import view_for
from hippomat_sim.world import WALL

REPRODUCED, FAILED, RUN_FAILED = 0, 1, 2


def run_demo(settings: RunSettings, console: Console) -> int:
    """Run, replay, report; returns the exit code."""
    _say(console, f"{_about(settings)} on {settings.map_yaml.stem}; everything goes to {settings.out}")
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
    picture = result.out / "ways.png"
    draw(_picture(result, completions(logs), settings), picture)
    show(report, console)
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


def _about(settings: RunSettings) -> str:
    robots = "one robot" if settings.robots == 1 else f"{settings.robots} robots"
    loss = f"{100 * settings.loss:g} % of frames lost"
    return f"{robots}, {settings.tasks} task slots, {settings.seconds:g} s, {loss}"


def _picture(result: RunResult, completed: Sequence[Completion], settings: RunSettings) -> PictureData:
    return PictureData(
        result.grid,
        result.truth,
        [(one.robot, one.x_m, one.y_m) for one in completed],
        _contact_places(result),
        result.config.robot.radius_m,
        f"{len(completed)} tasks completed, {len(result.contacts)} contacts",
        f"{_about(settings)}; map {settings.map_yaml.stem}, seed {settings.seed}",
    )


def _contact_places(result: RunResult) -> list[tuple[float, float]]:
    """Where the contacts were: between two robots, or at the robot that touched a wall."""
    places = []
    for contact in result.contacts:
        moment = int(np.searchsorted(result.truth_us, contact.start_s * 1e6))
        poses = result.truth[min(moment, len(result.truth) - 1)]
        touching = [contact.robot] if contact.other == WALL else [contact.robot, contact.other]
        x, y = poses[touching, :2].mean(axis=0).tolist()
        places.append((x, y))
    return places


def _say(console: Console, text: str) -> None:
    console.print(text, markup=False, highlight=False, soft_wrap=True)
