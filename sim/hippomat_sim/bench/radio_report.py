"""How a run of `hippomat-bench radio` is shown: tables for people, one JSON object for programs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hippomat_sim.bench.radio_plain import LONGEST_S
from hippomat_sim.bench.radio_run import OurFigures, Traffic
from hippomat_sim.bench.radio_settings import RadioSettings
from hippomat_sim.bench.radio_targets import Target

NOTES = (
    "direct: STATE frames that reach a station in reach of their sender, of those sent; with relays: rows "
    "that a robot holds at the end of the round, hidden pairs included; worst: of all pairs; airtime: of all "
    "stations together, over the time; collided: receptions lost to collisions. The two others send as many "
    f"frames of the same sizes on the same medium, for at most {LONGEST_S:.0f} s, without faults."
)


@dataclass(frozen=True, slots=True)
class RadioReport:
    """All that is shown. plain: by name; empty where it was not asked for."""

    settings: RadioSettings
    ours: OurFigures
    plain: Mapping[str, Traffic]
    targets: Sequence[Target]

    @property
    def met(self) -> bool:
        return all(target.met for target in self.targets)


def show(report: RadioReport, console: Console) -> None:
    """Tables, targets, verdict."""
    console.print(_traffic_table(report))
    console.print(Text(NOTES, style="dim"))
    console.print(_fleet_table(report.ours))
    console.print(_target_table(report.targets))
    missed = [target.name for target in report.targets if not target.met]
    if missed:
        console.print(Text(f"missed: {', '.join(missed)}", style="bold red"))
    else:
        console.print(Text("all targets met", style="bold green"))


def as_json(report: RadioReport) -> dict[str, Any]:
    """What --json prints; NaN becomes null."""
    ours = asdict(report.ours)
    for series in ("times_s", "spreads_us"):
        del ours[series]
    targets = [asdict(target) | {"met": target.met} for target in report.targets]
    plain = {name: asdict(traffic) for name, traffic in report.plain.items()}
    whole = {"settings": asdict(report.settings), "ours": ours, "plain": plain, "targets": targets}
    return _without_nan(whole | {"met": report.met})  # type: ignore[no-any-return]


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(one) for one in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold")
    table.box, table.padding = SIMPLE_HEAD, (0, 1, 0, 0)
    for number, name in enumerate(columns):
        table.add_column(name, justify="right" if number else "left", no_wrap=True)
    return table


def _traffic_table(report: RadioReport) -> Table:
    settings, ours = report.settings, report.ours
    title = (
        f"{settings.nodes} nodes at {settings.rate_hz:g} Hz, {settings.tasks} tasks, {settings.seconds:g} s, "
        f"{settings.loss:.0%} loss, {settings.hidden:.0%} of the pairs hidden, seed {settings.seed}"
    )
    columns = ("direct\n%", "worst\n%", "with\nrelays %", "worst\n%", "frames\na round", "airtime\n%")
    table = _table(title, "sending", *columns, "collided")
    rows = (f"{100 * ours.rows.mean:.2f}", f"{100 * ours.rows.worst:.2f}")
    table.add_row("our schedule", *_traffic_row(ours.traffic, rows), style="bold")
    for name, traffic in report.plain.items():
        table.add_row(name, *_traffic_row(traffic, ("-", "-")))
    return table


def _traffic_row(traffic: Traffic, rows: tuple[str, str]) -> list[str]:
    return [
        f"{100 * traffic.direct.mean:.2f}",
        f"{100 * traffic.direct.worst:.2f}",
        *rows,
        f"{traffic.frames_per_round:.1f}",
        f"{100 * traffic.airtime:.1f}",
        f"{traffic.collided}",
    ]


def _fleet_table(ours: OurFigures) -> Table:
    table = _table("our fleet", "what", "figure")
    median_us, p99_us, max_us = ours.agreement_us
    table.add_row("complete snapshots", f"{100 * ours.complete:.3f} % of {ours.judged}")
    table.add_row("rounds in which all hold the same rows", f"{100 * ours.identical:.2f} %")
    table.add_row("rows that are not what was sent", f"{ours.wrong_rows}")
    widest = f"{median_us:.0f} / {p99_us:.0f} / {max_us:.0f} us"
    table.add_row("widest difference of fleet time: median / p99 / max", widest)
    table.add_row("steps back of fleet time", f"{ours.steps_back}")
    stops = ", ".join("not in 3 s" if math.isnan(stop) else f"{stop:.1f}" for stop in ours.stop_ms)
    table.add_row("STOP raised until the last robot has it, ms", stops or "-")
    table.add_row("faults played", f"{ours.faults}")
    return table


def _target_table(targets: Sequence[Target]) -> Table:
    table = _table("targets", "what", "measured", "required", "")
    for target in targets:
        sign = ">=" if target.at_least else "<="
        verdict = Text("met", style="green") if target.met else Text("missed", style="bold red")
        required = f"{sign} {target.bound:g} {target.unit}"
        table.add_row(target.name, f"{target.value:.6g} {target.unit}", required, verdict)
    return table
