"""The demo's table: what each robot and the fleet achieved, and whether their logs were reproduced."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hippomat_logs.metrics import FleetMetrics, RobotMetrics, quantiles
from hippomat_sim.run_logs import Verdict
from hippomat_sim.world import Contact

# The table fits 80 columns: that is what a log file or a pipe gets.
_COLUMNS = (
    *("tasks", "travel\ncost s", "CF1\n%", "alloc.\ns", "settle\ns", "comp.\nms"),
    *("frames\nsent", "recei-\nved", "lost", "con-\ntacts"),
)
NOTES = (
    "travel cost: sum of the claims' costs when requested; CF1: share of requested tasks that exactly "
    "one robot requested; alloc.: median from task seen to claim confirmed, with the wait for a free robot; "
    "settle: median from request to claim confirmed; comp.: median computing time per pass of the daemon's "
    "loop; frames: by the robots' logs; contacts: by the simulated world"
)


@dataclass(frozen=True, slots=True)
class DemoReport:
    """What is shown."""

    metrics: FleetMetrics
    verdicts: Sequence[Verdict]
    contacts: Sequence[Contact]
    troubles: Sequence[str]


def show(report: DemoReport, console: Console) -> None:
    """Table, findings, verdict."""
    console.print(fleet_table(report))
    console.print(Text(NOTES, style="dim"))
    for verdict in report.verdicts:
        style = "red" if verdict.exit_code else "green"
        console.print(Text(f"robot {verdict.robot}: {verdict.text}", style=style))
        for finding in verdict.findings:
            console.print(Text(f"    {finding}", style="red"))
    for slot, generation in report.metrics.completed_twice:
        console.print(Text(f"task {slot}.{generation} was completed twice", style="bold red"))
    for trouble in report.troubles:
        console.print(Text(trouble, style="red"))
    console.print(Text("fleet: ", style="bold") + Text(verdict_line(report), style=_style(report)))


def fleet_table(report: DemoReport) -> Table:
    """One row per robot, one for the fleet."""
    table = Table(title="what the logs say", title_justify="left", title_style="bold")
    table.box, table.padding = SIMPLE_HEAD, (0, 0)
    for name in ("robot", *_COLUMNS):
        table.add_column(name, justify="right", no_wrap=True, min_width=5)
    alone = Counter(task for robot in report.metrics.robots for task in robot.requested)
    for robot in report.metrics.robots:
        touched = sum(robot.robot in (contact.robot, contact.other) for contact in report.contacts)
        table.add_row(str(robot.robot), *_figures(robot, _conflict_free(robot, alone), touched))
    table.add_section()
    rate = report.metrics.conflict_free_rate
    table.add_row("fleet", *_figures(report.metrics, rate, len(report.contacts)), style="bold")
    return table


def verdict_line(report: DemoReport) -> str:
    """One line for people and scripts."""
    metrics, twice = report.metrics, report.metrics.completed_twice
    return (
        f"{_common_verdict(report)}; {len(metrics.completed)} tasks completed, "
        f"{len(twice) or 'none'} done twice, {len(report.contacts) or 'no'} "
        f"contact{'' if len(report.contacts) == 1 else 's'}"
    )


def _figures(of: RobotMetrics | FleetMetrics, conflict_free: float, contacts: int) -> list[str]:
    robots = of.robots if isinstance(of, FleetMetrics) else [of]
    return [
        str(len(of.completed)),
        f"{of.travel_cost_s:.1f}",
        _number(100 * conflict_free, 0),
        _number(quantiles(of.allocation_s)[0], 2),
        _number(quantiles([wait_s for robot in robots for wait_s in _settling_s(robot)])[0], 2),
        _number(quantiles(of.compute_ms)[0], 1),
        str(sum(robot.frames_sent for robot in robots)),
        str(sum(robot.frames_received for robot in robots)),
        str(sum(robot.frames_lost for robot in robots)),
        str(contacts),
    ]


def _conflict_free(robot: RobotMetrics, requests: Counter[tuple[int, int]]) -> float:
    """Of the tasks that this robot requested, the share that no other robot requested."""
    mine = robot.requested
    return sum(requests[task] == 1 for task in mine) / len(mine) if mine else math.nan


def _settling_s(robot: RobotMetrics) -> list[float]:
    """Own request -> own claim confirmed."""
    return [at_s - robot.requested[task] for task, at_s in robot.confirmed.items() if task in robot.requested]


def _common_verdict(report: DemoReport) -> str:
    texts = {verdict.text for verdict in report.verdicts}
    if len(texts) == 1:
        return texts.pop()
    return f"{_reproduced(report)} of {len(report.verdicts)} logs reproduced"


def _reproduced(report: DemoReport) -> int:
    return sum(verdict.exit_code == 0 for verdict in report.verdicts)


def _style(report: DemoReport) -> str:
    clean = _reproduced(report) == len(report.verdicts) and not report.contacts and not report.troubles
    return "bold green" if clean and not report.metrics.completed_twice else "bold red"


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"
