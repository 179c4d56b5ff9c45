"""How `hippomat-bench motion` is judged and shown: tables for people, one JSON object for programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from statistics import mean, median
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hippomat_sim.bench.motion_run import STUCK_TICKS, MotionFigures
from hippomat_sim.bench.motion_settings import MotionSettings
from hippomat_sim.bench.radio_report import verdict
from hippomat_sim.bench.radio_targets import Target

MOST_US = 3.0
LEAST_OF_BOUND = {"warehouse": 88.0, "corridors": 80.0, "random:0.2": 90.0, "random:0.3": 90.0}
NOTES = (
    "% of bound: ticks that the ways to all goals, driven by the shortest way and alone, take (the ways "
    "under way for the part driven), of the ticks that the robots had. stuck: robots that for "
    f"{STUCK_TICKS} moves' time neither got a new goal nor came nearer to theirs than ever before. "
    "nearest: of two robots' centres at any moment, in cells; below 0.4 is a collision. us: to plan for the "
    "whole fleet, of one robot's time, by robot and tick."
)


@dataclass(frozen=True, slots=True)
class MotionReport:
    """All that is shown."""

    settings: MotionSettings
    runs: Sequence[MotionFigures]

    @property
    def targets(self) -> list[Target]:
        """Safety is judged in every run; the rest where it was asked for."""
        return targets_of(self.settings, self.runs)

    @property
    def met(self) -> bool:
        return not any(target.missed for target in self.targets)


def targets_of(settings: MotionSettings, runs: Sequence[MotionFigures]) -> list[Target]:
    """The same ones for every run, judged or not."""
    least = LEAST_OF_BOUND.get(settings.map)
    others = "set for the planner 'ours'" if settings.planner != "ours" else ""
    usual = (settings.agents, settings.speeds_mps, settings.uav, settings.diagonals) == (
        30,
        (1.0,),
        False,
        False,
    )
    unusual = others or ("" if usual and least is not None else "set for 30 equal robots on four maps")
    lossy = others or unusual or ("set for a run without losses" if settings.loss else "")
    return [
        Target("collisions", sum(run.verdict.collisions for run in runs), 0, False, ""),
        Target("moves that cannot be", sum(len(run.verdict.wrong_moves) for run in runs), 0, False, ""),
        Target("robots stuck", sum(run.stuck for run in runs), 0, False, "", others),
        Target("of the bound", 100 * mean(run.of_bound for run in runs), least or 90.0, True, "%", lossy),
        Target("planning", median(run.plan_us for run in runs), MOST_US, False, "us", lossy),
    ]


def as_json(report: MotionReport) -> dict[str, Any]:
    """What --json prints; `met` of a target that is not judged is null."""
    runs = [
        {
            "seed": run.seed,
            "collisions_at_ticks": run.verdict.at_ticks,
            "collisions_between_ticks": run.verdict.between_ticks,
            "wrong_moves": list(run.verdict.wrong_moves),
            "nearest_cells": run.verdict.nearest if run.verdict.nearest < 1e9 else None,
            "stuck": run.stuck,
            "tasks": run.tasks,
            "of_bound_percent": 100 * run.of_bound,
            "plan_us": run.plan_us,
        }
        for run in report.runs
    ]
    targets = [asdict(one) | {"met": None if one.not_judged else one.met} for one in report.targets]
    return {"settings": asdict(report.settings), "runs": runs, "targets": targets, "met": report.met}


def show(report: MotionReport, console: Console) -> None:
    """The runs, the targets, the verdict."""
    console.print(_runs_table(report))
    console.print(Text(NOTES, style="dim"))
    table = _table("targets", "what", "measured", "required", "")
    for target in report.targets:
        required = f"{'>=' if target.at_least else '<='} {target.bound:g} {target.unit}"
        met = "not judged" if target.not_judged else "met" if target.met else "missed"
        style = {"not judged": "dim", "met": "green", "missed": "bold red"}[met]
        table.add_row(target.name, f"{target.value:.4g} {target.unit}", required, Text(met, style=style))
    console.print(table)
    for run in report.runs:
        for fault in run.verdict.wrong_moves[:3]:
            console.print(Text(f"seed {run.seed}: {fault}", style="red"))
    console.print(Text(verdict(report.targets), style="bold green" if report.met else "bold red"))


def _runs_table(report: MotionReport) -> Table:
    settings = report.settings
    title = (
        f"{settings.planner} on {settings.map}{' in the air' if settings.uav else ''}: "
        f"{settings.agents} robots, {settings.steps} ticks, {settings.loss:.0%} of the frames lost"
    )
    table = _table(title, "seed", "collisions", "stuck", "tasks", "% of bound", "nearest", "us")
    for run in report.runs:
        table.add_row(
            f"{run.seed}",
            f"{run.verdict.collisions}",
            f"{run.stuck}",
            f"{run.tasks}",
            f"{100 * run.of_bound:.1f}",
            f"{run.verdict.nearest:.2f}",
            f"{run.plan_us:.2f}",
        )
    return table


def _table(title: str, *columns: str) -> Table:
    table = Table(
        title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, padding=(0, 1, 0, 0)
    )
    for number, name in enumerate(columns):
        table.add_column(name, justify="right" if number else "left", no_wrap=True)
    return table
