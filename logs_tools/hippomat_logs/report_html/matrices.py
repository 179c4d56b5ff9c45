"""Who conflicted with whom, who heard whom, how late frames came and how old rows were: Bokeh figures."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.models import BasicTicker, ColorBar, ColumnDataSource, HoverTool, LinearColorMapper, NoOverlap
from bokeh.palettes import Cividis256
from bokeh.plotting import figure
from numpy.typing import NDArray

from hippomat_core.messages import NEVER_HEARD_MS
from hippomat_core.wire.frames import OPERATOR
from hippomat_logs.metrics import LinkMetrics, RobotMetrics
from hippomat_logs.metrics.figures import number, over_links
from hippomat_logs.report_html.data import ReportData

PALETTE = tuple(reversed(Cividis256))  # perceptually even, the same for all colour vision (Nunez et al. 2018)
ROOMY, READABLE = 8, 12  # robots; cells of more have room for one line of numbers, or for none
ROW_PX, LEAST_ROW_PX, BESIDE_PX = 56, 15, 90  # of a matrix; beside: its axis and names
MOST_PX, HISTOGRAM_PX = 400, 300
BINS = 45
LATENCY_STEP_MS, LATENCY_BINS = 0.01, 10_000
SHOWN_SHARE = 0.995  # of a histogram; what lies beyond would press it against its axis
NONE_COLOUR = "#F1F3F5"  # of a cell below the palette: no conflict
DARK_FROM = 0.47  # of the palette: from here on white numbers have the better contrast


def conflict_figure(data: ReportData) -> Any | None:
    """How often two robots wanted one task; None where that never was."""
    causes: dict[tuple[int, int], Counter[str]] = defaultdict(Counter)
    for conflict in data.conflicts:
        one, other = conflict.robots
        causes[one, other][conflict.cause] += 1
        if data.explained:  # the fleet's, once; else it is one robot's word, and the other has its own
            causes[other, one][conflict.cause] += 1
    if not causes:
        return None
    names = sorted({robot.robot for robot in data.robots} | {robot for pair in causes for robot in pair})
    cells: list[dict[str, Any]] = [
        {
            "x": str(column),
            "y": str(row),
            "value": float(causes[row, column].total()),
            "label": str(causes[row, column].total() or ""),
            "text": ", ".join(f"{n} x {cause}" for cause, n in causes[row, column].most_common()) or "none",
        }
        for row in names
        for column in names
        if row != column
    ]
    labels = [str(name) for name in names]
    tooltips = [("robots @y and @x", "@value{0} conflicts"), ("cause", "@text")]
    limits = 0.5, max(1.0, *(cell["value"] for cell in cells))
    return _matrix(cells, (labels, labels), ("robot", "robot"), limits, tooltips, "conflicts", "conflicts")


def delivery_figure(data: ReportData) -> Any | None:
    """Columns heard rows: share of the frames sent, median signal strength. None: nobody heard any."""
    heard = [(robot.robot, link) for robot in data.metrics.robots for link in robot.links if link.received]
    if not heard:
        return None
    roomy = len(data.robots) <= ROOMY
    links = {(receiver, link.sender): _link_cell(link, roomy) for receiver, link in heard}
    for receiver, sender in _deaf_pairs(data.metrics.robots):
        links.setdefault((receiver, sender), {"value": 0.0, "label": "0 %", "text": "no frame was heard"})
    cells = [
        {"x": _named(receiver), "y": _named(sender), **cell} for (receiver, sender), cell in links.items()
    ]
    senders = [_named(sender) for sender in sorted({sender for _, sender in links})]
    receivers = [_named(receiver) for receiver in sorted({receiver for receiver, _ in links})]
    tooltips = [("@x heard @y", "@value{0.0} %"), ("", "@text")]
    low = min(90.0, *(math.floor(cell["value"] / 10) * 10.0 for cell in cells))
    names = receivers, senders  # this way round in `hippomat-logs metrics --links` too
    axes = "to (receiver)", "from (sender)"
    return _matrix(cells, names, axes, (low, 100.0), tooltips, "delivery", "delivered [%]")


def _link_cell(link: LinkMetrics, roomy: bool) -> dict[str, Any]:
    return {
        "value": 100 * link.delivery,
        "label": f"{100 * link.delivery:.0f} %" + f"\n{link.rssi_dbm:.0f}" * roomy,
        "text": f"{link.received:,} frames heard, {link.lost:,} lost, median {link.rssi_dbm:.0f} dBm",
    }


def _deaf_pairs(robots: Sequence[RobotMetrics]) -> list[tuple[int, int]]:
    """Receiver and sender of which, by their own logs, the one listened while the other sent."""
    senders = [one.robot for one in robots if one.frames_sent and one.robot >= 0]
    return [(one.robot, sender) for one in robots for sender in senders if sender != one.robot]


def _named(robot: int) -> str:
    return {OPERATOR: "operator", -1: "observer"}.get(robot, str(robot))


def _matrix(
    cells: list[dict[str, Any]], names: tuple[list[str], list[str]], axes: tuple[str, str],
    limits: tuple[float, float], tooltips: list[tuple[str, str]], name: str, title: str,
) -> Any:  # fmt: skip
    """cells: x, y, value, label, text of each; names and axes: of the columns and of the rows."""
    (columns, rows), (low, high) = names, limits
    for cell in cells:
        share = (cell["value"] - low) / max(high - low, 1e-9)
        cell["ink"] = "#FFFFFF" if share > DARK_FROM else "#1F2733"
    columns_of = {key: [cell[key] for cell in cells] for key in ("x", "y", "value", "label", "text", "ink")}
    plot = figure(
        x_range=list(columns), y_range=list(reversed(rows)), x_axis_label=axes[0], y_axis_label=axes[1],
        height=_height_px(len(rows)), sizing_mode="stretch_width", tools="save", name=name,
    )  # fmt: skip
    plot.toolbar.logo = None
    plot.grid.visible = False
    plot.axis.major_label_policy = NoOverlap()
    source = ColumnDataSource(columns_of)
    mapper = LinearColorMapper(palette=PALETTE, low=low, high=high, low_color=NONE_COLOUR)
    fill = {"field": "value", "transform": mapper}
    drawn = plot.rect("x", "y", 0.96, 0.96, fill_color=fill, line_color=None, source=source)
    if max(len(columns), len(rows)) <= READABLE:
        plot.text(
            "x", "y", text="label", text_color="ink", text_font_size="12px", text_align="center",
            text_baseline="middle", source=source,
        )  # fmt: skip
    bar = ColorBar(
        color_mapper=mapper,
        title=title,
        width=10,
        border_line_color=None,
        ticker=BasicTicker(desired_num_ticks=5, min_interval=1),
    )
    plot.add_layout(bar, "right")
    plot.add_tools(HoverTool(visible=False, renderers=[drawn], tooltips=tooltips))
    return plot


def _height_px(rows: int) -> int:
    """Roomy cells as long as all fit, then smaller ones, but a name beside each."""
    return BESIDE_PX + max(min(ROW_PX * rows, MOST_PX - BESIDE_PX), LEAST_ROW_PX * rows)


def latency_figure(data: ReportData) -> Any | None:
    """Time from radio to radio, each by its own estimate of fleet time."""
    text = "time from the sender's radio to the receiver's [ms]"
    return _histogram(latency_counts(data), LATENCY_STEP_MS, text, "frames", "latency")


def latency_counts(data: ReportData) -> NDArray[np.int64]:
    """STATEs by time from radio to radio, in steps of LATENCY_STEP_MS, as far as fleet time was agreed on."""
    bins = np.round(1e3 * data.metrics.air_ms).astype(np.int64) // round(1e3 * LATENCY_STEP_MS)
    return np.bincount(bins[(bins >= 0) & (bins < LATENCY_BINS)], minlength=1)


def age_figure(data: ReportData) -> Any | None:
    """Age of the rows of peers when decisions were made on them, on each receiver's own clock."""
    counts = data.age_counts[:NEVER_HEARD_MS]
    return _histogram(
        counts, 1.0, "age of a peer's row when it was decided on [ms]", "rows in decisions", "age"
    )


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
    heights = (
        np.pad(counts[: bins * width], (0, max(bins * width - len(counts), 0)))
        .reshape(bins, width)
        .sum(axis=1)
    )
    lefts = np.arange(bins) * width * step
    plot = figure(
        x_axis_label=x_label, y_axis_label=y_label, height=HISTOGRAM_PX, sizing_mode="stretch_width",
        tools="save", name=name, y_range=(0, float(heights.max()) * 1.08),
        x_range=(0.0, float(bins * width * step)),
    )  # fmt: skip
    plot.toolbar.logo = None
    columns = {"left": lefts, "right": lefts + width * step, "top": heights}
    drawn = plot.quad(
        left="left", right="right", top="top", bottom=0, fill_color="#0072B2", line_color="#FFFFFF",
        line_width=0.6, source=ColumnDataSource(columns),
    )  # fmt: skip
    plot.add_tools(
        HoverTool(
            visible=False, renderers=[drawn], tooltips=[("", "@left{0.00} to @right{0.00} ms: @top{0,0}")]
        )
    )
    return plot


def age_text(data: ReportData) -> str:
    """For a caption: the mean that the metrics have, and what most rows kept to."""
    mean_ms = number(over_links(lambda link: link.row_age_ms)(data.metrics), 0)
    high_ms = int(quantile(data.age_counts[:NEVER_HEARD_MS], 1.0, 0.95))
    return f"mean {mean_ms} ms, 95 % within {high_ms} ms"
