"""`hippomat-bench motion`: its options, and what it does with them."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from hippomat_core.errors import ConfigError
from hippomat_sim.bench.motion_report import MotionReport, as_json, show
from hippomat_sim.bench.motion_run import MotionFigures, MotionRun
from hippomat_sim.bench.motion_settings import NAMES, MotionSettings, checked
from hippomat_sim.bench.radio_command import MISSED, check_plot

_WARM_UP_STEPS = 30


def add_options(parser: argparse.ArgumentParser) -> None:
    """What run() reads."""
    default = MotionSettings()
    add = parser.add_argument
    maps = "warehouse, corridors (one cell wide), random:P (P of the cells occupied), a ROS map's .yaml or a "
    add("--map", default=default.map, metavar="MAP", help=f"{maps}MovingAI .map (default {default.map})")
    numbers: tuple[tuple[str, type, float, str, str], ...] = (
        ("--agents", int, default.agents, "N", "robots"),
        ("--steps", int, default.steps, "T", "ticks of a run; a move takes one where all are equally fast"),
        ("--seeds", int, default.seeds, "K", "runs, with seeds 0 .. K - 1"),
        ("--loss", float, default.loss, "P", "probability that a receiver misses a frame"),
        ("--idle", int, default.idle, "K", "robots that never get a task and park"),
        (
            "--rounds",
            int,
            default.rounds,
            "R",
            "times that every robot decides and sends before the moves of a tick",
        ),
    )
    for option, of_type, value, metavar, text in numbers:
        add(option, type=of_type, default=value, metavar=metavar, help=f"{text} (default {value:g})")
    planners = "ours: windows, who fails first; pibt: without swap; replan: the paper's wait and replan"
    add("--planner", choices=tuple(NAMES), default=default.planner, help=planners)
    add("--speeds", default="1", metavar="V,V..", help="speeds in m/s, given to the robots in turn (3,5)")
    add("--uav", action="store_true", help="pile the map up to columns of random height and fly")
    add("--diagonals", action="store_true", help="moves to all cells around, without cutting corners")
    add("--picture", type=Path, metavar="FILE", help="draw the first run: png, pdf, svg")
    add("--json", action="store_true", help="one JSON object instead of tables")


def run(options: argparse.Namespace) -> int:
    """The exit code: MISSED when a judged target was."""
    settings = checked(_settings(options))
    if options.picture is not None:
        check_plot(options.picture, "--picture")
    report = MotionReport(settings, _measure(settings))
    if options.json:
        print(json.dumps(as_json(report)))
    else:
        show(report, Console(highlight=False))
    if options.picture is not None:
        from hippomat_sim.bench.motion_picture import draw  # here, because matplotlib loads slowly

        draw(settings, report.runs[0], options.picture)
        print(f"written: {options.picture}", file=sys.stderr if options.json else sys.stdout)
    return 0 if report.met else MISSED


def _measure(settings: MotionSettings) -> list[MotionFigures]:
    # What numba compiles or loads must not count as planning.
    MotionRun(dataclasses.replace(settings, steps=_WARM_UP_STEPS), 0, lambda _: None).execute()
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task("", total=settings.steps * settings.seeds)
        runs = []
        for seed in range(settings.seeds):
            bar.update(task, description=f"seed {seed}")
            begun = seed * settings.steps

            def told(tick: int, begun: int = begun) -> None:
                bar.update(task, completed=begun + tick)

            runs.append(MotionRun(settings, seed, told).execute())
    return runs


def _settings(options: argparse.Namespace) -> MotionSettings:
    try:
        speeds_mps = tuple(float(speed) for speed in options.speeds.split(","))
    except ValueError:
        raise ConfigError(
            f"--speeds {options.speeds}: give numbers with commas between, such as 3,5"
        ) from None
    return MotionSettings(
        map=options.map,
        agents=options.agents,
        steps=options.steps,
        seeds=options.seeds,
        loss=options.loss,
        planner=options.planner,
        speeds_mps=speeds_mps,
        uav=options.uav,
        diagonals=options.diagonals,
        idle=options.idle,
        rounds=options.rounds,
    )
