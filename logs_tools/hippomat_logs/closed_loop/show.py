"""What is printed of closed loops and counterfactuals: tables that fit 80 columns, and sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from hippomat_logs.closed_loop.figures import (
    FEWEST_PAIRS,
    FEWEST_RERUNS,
    Distribution,
    PairedDifference,
)
from hippomat_logs.closed_loop.open_loop import OpenLoop
from hippomat_logs.metrics.figures import Figure

if TYPE_CHECKING:
    from hippomat_logs.closed_loop.command import ClosedLoop


def notes(lines: Sequence[str], console: Console) -> None:
    """What a reader has to know before the figures."""
    for line in lines:
        console.print(f"note: {line}", markup=False)


def opened(found: OpenLoop, recorded: str, other: str, console: Console) -> None:
    """The two allocators on the recorded problems."""
    for note in found.notes:
        console.print(f"note: {note}", markup=False)
    console.print(f"open loop: {other} asked in the rounds of the recorded {recorded}", markup=False)
    if not found.rounds:
        console.print("no robot's allocator was ever asked: there is nothing to compare")
        return
    table = _table(("", "left"), (recorded, "right"), (other, "right"))
    sides = (found.recorded, found.other)
    table.add_row("requests", *(str(side.requests) for side in sides))
    table.add_row("cost of a request, mean (s)", *(_number(side.cost_s, 2) for side in sides))
    table.add_row("would-be conflicts", *(str(side.conflicts) for side in sides))
    console.print(table)
    share = 100 * found.differ / found.rounds
    console.print(f"{found.differ} of {found.rounds} decisions differ ({share:.1f} %)")
    if recorded != other or found.differ:
        console.print("these rounds came about by the recorded decisions: --closed-loop plays both out")


def closed(found: ClosedLoop, console: Console) -> None:
    """Distributions over the re-runs, then the pairs with another allocator."""
    count = len(found.seeds)
    runs = "re-run" if count == 1 else "re-runs"
    console.print(f"L4: {count} {runs}, radio {found.radio}, allocator {found.allocator}", markup=False)
    table = _table(
        ("", "left"), ("recorded", "right"), ("5 %", "right"), ("median", "right"), ("95 %", "right"),
        ("percentile", "right"),
    )  # fmt: skip
    for one in found.distributions:
        table.add_row(
            _title(one.figure),
            _number(one.recorded, one.figure.digits),
            *(_number(value, one.figure.digits) for value in one.quantiles),
            _place(one, found),
        )
    console.print(table)
    console.print("percentile: share of the re-runs below the recorded value, ties half")
    if count < FEWEST_RERUNS:
        console.print(f"level L4 judges by {FEWEST_RERUNS} re-runs or more: --seeds {FEWEST_RERUNS}")
    beyond = [figure.label for figure in found.beyond]
    if beyond:
        verb = "lies" if len(beyond) == 1 else "lie"
        console.print(f"beyond all re-runs {verb} the recorded: {', '.join(beyond)}", markup=False)
    if found.other is not None:
        _pairs(found.differences, found.allocator, found.other.text, console)


def _pairs(differences: Sequence[PairedDifference], recorded: str, other: str, console: Console) -> None:
    pairs = max((one.pairs for one in differences), default=0)
    console.print(f"\n{other} against {recorded}: means of {pairs} pairs with the same seed", markup=False)
    table = _table(
        ("", "left"),
        (recorded, "right"),
        (other, "right"),
        ("difference", "right"),
        ("95 % interval", "right"),
    )
    for one in differences:
        digits = max(one.figure.digits, 1)
        interval = (
            "-" if math.isnan(one.low) else f"{_signed(one.low, digits)} .. {_signed(one.high, digits)}"
        )
        table.add_row(
            _title(one.figure),
            _number(one.recorded, digits),
            _number(one.other, digits),
            _signed(one.difference, digits),
            interval,
        )
    console.print(table)
    for line in verdicts(differences, recorded, other):
        console.print(line, markup=False)


def verdicts(differences: Sequence[PairedDifference], recorded: str, other: str) -> list[str]:
    """Which figures tell the two apart, in sentences."""
    clear = [one for one in differences if one.distinguishable]
    lines = []
    for one in clear:
        more = "higher" if one.difference > 0 else "lower"
        by = _number(abs(one.difference), max(one.figure.digits, 1))
        unit = f" {one.figure.unit}" if one.figure.unit else ""
        lines.append(f"{one.figure.label}: {other} is {more} by {by}{unit} than {recorded}")
    compared = [one for one in differences if one.pairs]
    same = [one.figure.label for one in compared if one.low == one.high == 0.0]
    if same and len(same) == len(compared):
        return [f"{other} and {recorded} differ in nothing, seed by seed"]
    if same:
        lines.append(f"equal, seed by seed: {', '.join(same)}")
    unclear = [one.figure.label for one in compared if one.low <= 0.0 <= one.high and one.low < one.high]
    if unclear:
        lines.append(f"not distinguishable with so many seeds: {', '.join(unclear)}")
    if any(0 < one.pairs < FEWEST_PAIRS for one in differences):
        lines.append(
            f"fewer than {FEWEST_PAIRS} pairs have no interval and decide nothing: --seeds {FEWEST_RERUNS}"
        )
    return lines


def _table(*columns: tuple[str, str]) -> Table:
    table = Table(box=None, pad_edge=False)
    for name, justify in columns:
        table.add_column(name, justify=justify, overflow="fold")  # type: ignore[arg-type]
    return table


def _title(figure: Figure) -> str:
    return f"{figure.label} ({figure.unit})" if figure.unit else figure.label


def _place(one: Distribution, found: ClosedLoop) -> str:
    if math.isnan(one.percentile) or not found.whole:
        return "-"
    return f"{one.percentile:.0f}{'!' if one.figure in found.beyond else ''}"


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _signed(value: float, digits: int) -> str:
    if math.isnan(value):
        return "-"
    text = f"{value:+.{digits}f}"
    return text[1:] if float(text) == 0.0 else text
