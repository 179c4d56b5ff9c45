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
    "stations together, over the time; collided: receptions lost to collisions."
)
PLAIN_NOTE = (
    "The two others send as many frames of the same sizes on the same medium, "
    f"for at most {LONGEST_S:.0f} s, without faults."
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
        return not any(target.missed for target in self.targets)


def show(report: RadioReport, console: Console) -> None:
    """Tables, targets, verdict."""
    console.print(_traffic_table(report))
    console.print(Text(f"{NOTES} {PLAIN_NOTE}" if report.plain else NOTES, style="dim"))
    console.print(_fleet_table(report.ours))
    console.print(target_table(report.targets))
    console.print(Text(verdict(report.targets), style="bold green" if report.met else "bold red"))


def verdict(targets: Sequence[Target]) -> str:
    """What was missed or that nothing was, and what nobody judged, with the reasons."""
    judged = [target for target in targets if not target.not_judged]
    missed = "; ".join(target.name for target in judged if target.missed)
    said = f"missed: {missed}" if missed else f"all {len(judged)} judged targets met"
    unjudged = "; ".join(f"{target.name} ({target.not_judged})" for target in targets if target.not_judged)
    return f"{said}; not judged: {unjudged}" if unjudged else said


def as_json(report: RadioReport) -> dict[str, Any]:
    """What --json prints; NaN becomes null, and so does `met` of a target that is not judged."""
    ours = asdict(report.ours)
    for series in ("times_s", "spreads_us"):
        del ours[series]
    targets = [
        asdict(target) | {"met": None if target.not_judged else target.met} for target in report.targets
    ]
    plain = {name: asdict(traffic) for name, traffic in report.plain.items()}
    whole = {"settings": asdict(report.settings), "ours": ours, "plain": plain, "targets": targets}
    return without_nan(whole | {"met": report.met})  # type: ignore[no-any-return]


def without_nan(value: Any) -> Any:
    """The same tree with None for NaN: JSON has no NaN."""
    if isinstance(value, dict):
        return {key: without_nan(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_nan(one) for one in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def plain_table(title: str, *columns: str) -> Table:
    """The first column gives way where the terminal is narrow; what it says goes on in the next line."""
    table = Table(title=title, title_justify="left", title_style="bold")
    table.box, table.padding = SIMPLE_HEAD, (0, 1, 0, 0)
    for number, name in enumerate(columns):
        table.add_column(name, justify="right" if number else "left", overflow="fold", no_wrap=number > 0)
    return table


def _traffic_table(report: RadioReport) -> Table:
    """A column for each way of sending: three of them fit where eight figures side by side do not."""
    settings, ours = report.settings, report.ours
    title = (
        f"{settings.nodes} nodes at {settings.rate_hz:g} Hz, {settings.tasks} tasks, {settings.seconds:g} s, "
        f"{settings.loss:.0%} loss, {settings.hidden:.0%} of the pairs hidden, seed {settings.seed}"
    )
    table = plain_table(title, "sending", "ours", *report.plain)
    sent = [ours.traffic, *report.plain.values()]
    nothing = ["-"] * len(report.plain)
    table.add_row("direct, %", *(_percent(one.direct.mean, 2) for one in sent))
    table.add_row("direct, worst pair, %", *(_percent(one.direct.worst, 2) for one in sent))
    table.add_row("with relays, %", _percent(ours.rows.mean, 2), *nothing)
    table.add_row("with relays, worst pair, %", _percent(ours.rows.worst, 2), *nothing)
    table.add_row("frames a round", *(f"{one.frames_per_round:.1f}" for one in sent))
    table.add_row("airtime, %", *(_percent(one.airtime, 1) for one in sent))
    table.add_row("collided", *(f"{one.collided}" for one in sent))
    return table


def _percent(share: float, digits: int) -> str:
    """A share of 1; a dash where nothing was due."""
    return "-" if math.isnan(share) else f"{100 * share:.{digits}f}"


def _fleet_table(ours: OurFigures) -> Table:
    table = plain_table("our fleet", "what", "figure")
    table.columns[1].no_wrap = False  # a list of STOPs is long
    median_us, p99_us, max_us = ours.agreement_us
    table.add_row("complete snapshots", f"{_percent(ours.complete, 3)} % of {ours.judged}")
    table.add_row("rounds that hosts are told", f"{_percent(ours.told.mean, 2)} %")
    table.add_row("rounds in which STATE is sent", f"{_percent(ours.sent.mean, 2)} %")
    table.add_row("rounds in which all hold the same rows", f"{100 * ours.identical:.2f} %")
    table.add_row("rows that are not what was sent", f"{ours.wrong_rows}")
    widest = "-" if math.isnan(max_us) else f"{median_us:.0f} / {p99_us:.0f} / {max_us:.0f} us"
    table.add_row("widest difference of fleet time: median / p99 / max", widest)
    table.add_row("steps back of fleet time", f"{ours.steps_back}")
    stops = ", ".join("not in 3 s" if math.isnan(stop) else f"{stop:.1f}" for stop in ours.stop_ms)
    table.add_row("STOP raised until the last robot has it, ms", stops or "-")
    table.add_row("faults played", f"{ours.faults}")
    return table


def target_table(targets: Sequence[Target]) -> Table:
    """One row each: measured, required, verdict."""
    table = plain_table("targets", "what", "measured", "required", "")
    for target in targets:
        measured = "-" if math.isnan(target.value) else f"{target.value:.6g} {target.unit}"
        required = f"{'>=' if target.at_least else '<='} {target.bound:g} {target.unit}"
        table.add_row(target.name, measured, required, _verdict_on(target))
    return table


def _verdict_on(target: Target) -> Text:
    if target.not_judged:
        return Text("not judged", style="dim")
    return Text("met", style="green") if target.met else Text("missed", style="bold red")
