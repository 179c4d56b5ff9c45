"""What an alignment found, for people and programs: a table, JSON, and a picture of every link over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.markup import escape
from rich.table import Table

from hippomat_logs.alignment import Alignment, RunClock
from hippomat_logs.metrics.as_json import plain
from hippomat_logs.pictures import new_figure
from hippomat_logs.quick_look import DPI

YEAR_S = 31_557_600
MOST_DRAWN = 3000  # frames of a link
_COLUMNS = (
    "run",
    "offset",
    "drift\n[ppm]",
    "frames\nshared",
    "late by\n[us]",
    "95 %\n[us]",
    "known to\n[ms]",
    "heard\ntoo early",
)


def alignment_table(alignment: Alignment) -> Table:
    """One row per run; 80 characters wide."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for name in _COLUMNS:
        table.add_column(escape(name), justify="left" if name == "run" else "right", no_wrap=True)
    for clock in alignment.clocks:
        median_ns, most_ns, _ = clock.residual_ns
        table.add_row(
            _who(clock),
            "reference" if clock.name == alignment.reference else span(clock.offset_ns),
            f"{clock.drift_ppm:+.2f}",
            f"{clock.pairs:,}",
            _number(median_ns / 1e3, 0),
            _number(most_ns / 1e3, 0),
            _number(clock.uncertainty_ns / 1e6, 2),
            str(clock.violations),
        )
    return table


def alignment_lines(alignment: Alignment) -> list[str]:
    """What the table cannot say."""
    if len(alignment.clocks) == 1:
        return ["one run: its own log time is common time"]
    if not alignment.reference:
        return ["the wall clocks of all logs are trusted"]
    lines = [f"common time is the log time of {alignment.reference}"]
    names = {clock.name: _who(clock) for clock in alignment.clocks}
    for clock in alignment.clocks:
        if clock.through and clock.through != alignment.reference:
            lines.append(f"{_who(clock)} is aligned through {names[clock.through]}")
        if clock.boots > 1:
            lines.append(f"{_who(clock)}: its radio was started {clock.boots} times during the run")
    return lines


def _who(clock: RunClock) -> str:
    return f"robot {clock.robot}" if clock.robot >= 0 else "observer"


def span(ns: int) -> str:
    """A signed span of time in the unit that suits it."""
    seconds = ns / 1e9
    for unit, size in (("y", YEAR_S), ("d", 86_400), ("h", 3600), ("s", 1), ("ms", 1e-3)):
        if abs(seconds) >= size:
            return f"{seconds / size:+.3f} {unit}"
    return f"{ns / 1e3:+.1f} us"


def _number(value: float, digits: int) -> str:
    return "-" if value != value else f"{value:,.{digits}f}"


def as_json(alignment: Alignment) -> dict[str, Any]:
    return {
        "reference": alignment.reference,
        "trusted": not alignment.reference,
        "runs": [_clock_json(clock) for clock in alignment.clocks],
        "links": [
            {
                "first": alignment.clocks[link.first].name,
                "second": alignment.clocks[link.second].name,
                "frames": [len(link.there.sent_ns), len(link.back.sent_ns)],
                "half_width_ns": link.half_ns,
            }
            for link in alignment.links
        ],
    }


def _clock_json(clock: RunClock) -> dict[str, Any]:
    names = ("name", "robot", "offset_ns", "drift_ppm", "pairs", "violations", "through", "boots")
    facts = {name: getattr(clock, name) for name in names}
    facts["residual_ns"] = dict(zip(("median", "p95", "max"), clock.residual_ns, strict=True))
    facts["uncertainty_ns"] = clock.uncertainty_ns
    made: dict[str, Any] = plain(facts)
    return made


def draw_alignment(alignment: Alignment, path: Path) -> bool:
    """Per receiver: how much later than it was sent each frame was heard, in common time.

    False, and no picture, where nobody heard anybody.
    """
    heard = _heard(alignment)
    if not heard:
        return False
    begun_ns = min(int(at.min()) for links in heard.values() for _, at, _ in links)
    late = np.concatenate([us for links in heard.values() for _, _, us in links])
    low, high = np.percentile(late, (0.5, 99.5)) + np.array([-50.0, 50.0])
    columns = min(len(heard), 3)
    rows = -(-len(heard) // columns)
    size = (4.2 * columns, 2.8 * rows + 0.5)
    figure = new_figure(size)
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    figure.suptitle("frames on the radios' clocks, heard after they were sent")
    for place, axis in enumerate(axes.flat):
        axis.set_visible(place < len(heard))
    for axis, (receiver, links) in zip(axes.flat, heard.items(), strict=False):
        axis.axhline(0.0, color="0.5", linewidth=0.8)
        for sender, at, us in links:
            step = max(1, len(at) // MOST_DRAWN)
            axis.plot((at[::step] - begun_ns) / 1e9, us[::step], ".", markersize=1.5, label=sender)
        axis.set_title(f"heard by {receiver}", fontsize=9)
        axis.set_ylim(min(low, -50.0), high)
        if len(links) <= 8:
            axis.legend(fontsize=7, markerscale=5, loc="lower right")
    figure.supxlabel("common time since the first frame [s]")
    figure.supylabel("late by [us]")
    figure.tight_layout()
    figure.savefig(path, dpi=DPI)
    return True


def _heard(alignment: Alignment) -> dict[str, list[tuple[str, NDArray[np.int64], NDArray[np.float64]]]]:
    """By receiver: (sender, common times of its frames [ns], lateness [us])."""
    found: dict[str, list[tuple[str, NDArray[np.int64], NDArray[np.float64]]]] = {}
    maps = list(alignment.maps_in_order)
    for link in alignment.links:
        ways = ((link.first, link.second, link.there), (link.second, link.first, link.back))
        for sender, receiver, pairs in ways:
            if len(pairs.sent_ns):
                sent_ns = maps[sender](pairs.sent_ns)
                late_us = (maps[receiver](pairs.heard_ns) - sent_ns) / 1e3
                who, by = _who(alignment.clocks[receiver]), _who(alignment.clocks[sender])
                found.setdefault(who, []).append((by, sent_ns, late_us))
    return dict(sorted(found.items()))
