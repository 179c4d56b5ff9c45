"""Who conflicted with whom, who heard whom, how late frames came and how old rows were: Bokeh figures."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.models import BasicTicker, ColorBar, ColumnDataSource, HoverTool, LinearColorMapper
from bokeh.palettes import Cividis256
from bokeh.plotting import figure
from numpy.typing import NDArray

from hippomat_core.wire.frames import OPERATOR
from hippomat_logs.report_html.data import LATENCY_STEP_MS, NEVER_HEARD_MS, ReportData

PALETTE = tuple(reversed(Cividis256))  # perceptually even, the same for all colour vision (Nunez et al. 2018)
READABLE = 12  # robots; cells of more have no room for numbers
SIDE_PX, HISTOGRAM_PX = 400, 300
BINS = 45
SHOWN_SHARE = 0.995  # of a histogram; what lies beyond would press it against its axis
DARK_FROM = 0.55  # of the palette: white numbers on it


def conflict_figure(data: ReportData) -> Any | None:
    """Rows saw a conflict with columns; None where nobody saw any."""
    counts: Counter[tuple[int, int]] = Counter()
    causes: dict[tuple[int, int], Counter[str]] = {}
    for robot in data.robots:
        for conflict in robot.conflicts:
            pair = robot.robot, conflict.other
            counts[pair] += 1
            causes.setdefault(pair, Counter())[conflict.cause] += 1
    if not counts:
        return None
    names = sorted({robot.robot for robot in data.robots} | {robot for pair in counts for robot in pair})
    cells = [
        {
            "x": str(column),
            "y": str(row),
            "value": float(counts[row, column]),
            "label": str(counts[row, column] or ""),
            "text": ", ".join(f"{n} x {cause}" for cause, n in sorted(causes.get((row, column), {}).items())) or "none",
        }
        for row in names
        for column in names
        if row != column
    ]
    tooltips = [("robot @y", "@value{0} conflicts with robot @x"), ("cause", "@text")]
    axes = "the other robot", "robot that saw the conflict"
    high = max(counts.values())
    return _matrix(cells, [str(name) for name in names], [str(name) for name in names], axes, (0.0, high), tooltips, "conflicts", "conflicts")


def delivery_figure(data: ReportData) -> Any | None:
    """Rows heard columns: share of the frames sent, and the mean signal strength. None: nobody heard any."""
    if not data.links:
        return None
    cells = [
        {
            "x": _named(link.sender),
            "y": _named(link.receiver),
            "value": 100 * link.ratio,
            "label": f"{100 * link.ratio:.0f}",
            "text": f"{link.received:,} frames heard, {link.lost:,} lost, {_dbm(link.rssi_dbm)}",
        }
        for link in data.links
        if link.received
    ]
    senders = [_named(sender) for sender in sorted({link.sender for link in data.links})]
    receivers = [_named(receiver) for receiver in sorted({link.receiver for link in data.links})]
    tooltips = [("@y heard @x", "@value{0.0} %"), ("", "@text")]
    low = min([90.0, *(math.floor(cell["value"] / 10) * 10.0 for cell in cells)])
    return _matrix(cells, senders, receivers, ("sender", "receiver"), (low, 100.0), tooltips, "delivery", "frames delivered [%]")


def _named(robot: int) -> str:
    return {OPERATOR: "operator", -1: "observer"}.get(robot, str(robot))


def _dbm(rssi_dbm: float) -> str:
    return "signal unknown" if math.isnan(rssi_dbm) else f"mean {rssi_dbm:.0f} dBm"


def _matrix(
    cells: list[dict[str, Any]], columns: Sequence[str], rows: Sequence[str], axes: tuple[str, str],
    limits: tuple[float, float], tooltips: list[tuple[str, str]], name: str, title: str,
) -> Any:  # fmt: skip
    """cells: x, y, value, label, text of each."""
    low, high = limits
    for cell in cells:
        share = (cell["value"] - low) / max(high - low, 1e-9)
        cell["ink"] = "#FFFFFF" if share > DARK_FROM else "#1F2733"
    columns_of = {key: [cell[key] for cell in cells] for key in ("x", "y", "value", "label", "text", "ink")}
    plot = figure(
        x_range=list(columns), y_range=list(reversed(rows)), x_axis_label=axes[0], y_axis_label=axes[1],
        height=SIDE_PX, sizing_mode="stretch_width", tools="save", name=name,
    )  # fmt: skip
    plot.toolbar.logo = None
    plot.grid.visible = False
    source = ColumnDataSource(columns_of)
    mapper = LinearColorMapper(palette=PALETTE, low=low, high=high)
    fill = {"field": "value", "transform": mapper}
    drawn = plot.rect("x", "y", 0.96, 0.96, fill_color=fill, line_color=None, source=source)
    if max(len(columns), len(rows)) <= READABLE:
        plot.text(
            "x", "y", text="label", text_color="ink", text_font_size="13px", text_align="center",
            text_baseline="middle", source=source,
        )  # fmt: skip
    bar = ColorBar(color_mapper=mapper, title=title, width=10, border_line_color=None, ticker=BasicTicker(desired_num_ticks=5))
    plot.add_layout(bar, "right")
    plot.add_tools(HoverTool(renderers=[drawn], tooltips=tooltips))
    return plot


def latency_figure(data: ReportData) -> Any | None:
    """Time from radio to radio on the fleet's clock."""
    return _histogram(
        data.latency_counts, LATENCY_STEP_MS, "time from the sender's radio to the receiver's [ms]", "frames", "latency"
    )


def age_figure(data: ReportData) -> Any | None:
    """Age of the rows of peers when decisions were made on them, on each receiver's own clock."""
    counts = data.age_counts[:NEVER_HEARD_MS]
    return _histogram(counts, 1.0, "age of a peer's row when it was decided on [ms]", "rows in decisions", "age")


def quantile(counts: NDArray[np.int64], step: float, share: float) -> float:
    """Of a histogram whose k-th bin holds k * step .. (k + 1) * step: the middle of the quantile's bin."""
    sums = np.cumsum(counts)
    return float(np.searchsorted(sums, share * sums[-1]) + 0.5) * step


def _histogram(counts: NDArray[np.int64], step: float, x_label: str, y_label: str, name: str) -> Any | None:
    if not counts.sum():
        return None
    last = int(np.ceil(quantile(counts, step, SHOWN_SHARE) / step)) + 1
    width = max(1, -(-last // BINS))
    bins = -(-last // width)
    heights = np.pad(counts[: bins * width], (0, max(bins * width - len(counts), 0))).reshape(bins, width).sum(axis=1)
    lefts = np.arange(bins) * width * step
    plot = figure(
        x_axis_label=x_label, y_axis_label=y_label, height=HISTOGRAM_PX, sizing_mode="stretch_width",
        tools="save", name=name, y_range=(0, float(heights.max()) * 1.08), x_range=(0.0, float(bins * width * step)),
    )  # fmt: skip
    plot.toolbar.logo = None
    columns = {"left": lefts, "right": lefts + width * step, "top": heights}
    drawn = plot.quad(
        left="left", right="right", top="top", bottom=0, fill_color="#0072B2", line_color="#FFFFFF",
        line_width=0.6, source=ColumnDataSource(columns),
    )  # fmt: skip
    plot.add_tools(HoverTool(renderers=[drawn], tooltips=[("", "@left{0.00} to @right{0.00} ms: @top{0,0}")]))
    return plot


def spread_text(counts: NDArray[np.int64], step: float) -> str:
    """median and 95th percentile, for a caption."""
    if not counts.sum():
        return ""
    digits = 2 if step < 0.5 else 0
    return f"median {quantile(counts, step, 0.5):.{digits}f} ms, 95 % below {quantile(counts, step, 0.95):.{digits}f} ms"
