"""What has a time axis, as Bokeh figures: what every robot did, and what happened.

Decides marks, units and hover texts. playback.js finds figures and sources by the names given here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from bokeh.models import (
    BoxZoomTool,
    ColumnDataSource,
    HoverTool,
    PanTool,
    Range1d,
    ResetTool,
    WheelZoomTool,
)
from bokeh.plotting import figure

from hippomat_core.messages import INFO
from hippomat_logs.report_html import look
from hippomat_logs.report_html.data import NO_SLOT, ClaimEnd, Happening, ReportData, RobotView, Span

ROW_PX, AXES_PX, TOOLS_PX, LEGEND_PX = 26, 70, 30, 24


def time_range(data: ReportData) -> Range1d:
    """One for all figures over time: who zooms one zooms all."""
    return Range1d(0.0, data.span_s, bounds=(0.0, data.span_s), name="time")


def _time_figure(rows: Sequence[str], shared: Range1d, name: str, tools: bool) -> Any:
    """tools: whether it shows them; who zooms one such figure zooms all."""
    plot = figure(
        x_range=shared,
        y_range=list(reversed(rows)),
        x_axis_label="time since the start [s]",
        height=AXES_PX + ROW_PX * max(len(rows), 2),
        toolbar_location="above" if tools else None,
        sizing_mode="stretch_width",
        tools=[
            PanTool(dimensions="width"), BoxZoomTool(dimensions="width"),
            WheelZoomTool(dimensions="width"), ResetTool(),
        ],
        active_scroll=None,
        name=name,
    )  # fmt: skip
    plot.toolbar.logo = None
    plot.ygrid.visible = False
    return plot


def gantt_figure(data: ReportData, shared: Range1d) -> Any:
    """What every robot did: one bar per state, the task's slot and generation on the bars of a claim."""
    plot = _time_figure([look.label_of(robot) for robot in data.robots], shared, "gantt", tools=True)
    plot.height += TOOLS_PX
    columns: dict[str, list[Any]] = {
        key: []
        for key in ("row", "begin", "end", "fill", "alpha", "rim", "hatch", "phase", "task", "seconds", "how")
    }
    for k, robot in enumerate(data.robots):
        for doing in robot.spans:
            for key, value in _bar(robot, look.colour_of(k), doing).items():
                columns[key].append(value)
    bars = ColumnDataSource(columns, name="bars")
    drawn = plot.hbar(
        "row", left="begin", right="end", height=0.72, fill_color="fill", fill_alpha="alpha",
        line_color="rim", line_width=0.8, hatch_pattern="hatch", hatch_color="rim", hatch_scale=8,
        source=bars,
    )  # fmt: skip
    labels = ColumnDataSource(_claim_labels(data), name="labels")
    plot.text(
        "x", "row", text="shown", text_font_size="11px", text_baseline="middle", x_offset=3, source=labels
    )
    plot.add_tools(
        HoverTool(
            visible=False,
            renderers=[drawn],
            tooltips=[
                ("", "@row: @phase"),
                ("task", "@task"),
                ("time", "@begin{0.0} to @end{0.0} s (@seconds{0.0} s)"),
                ("ended", "@how"),
            ],
        )
    )
    return plot


def _bar(robot: RobotView, colour: str, doing: Span) -> dict[str, Any]:
    claims = doing.slot != NO_SLOT
    end = how_ended(robot, doing) if claims else None
    looks = look.PHASE_LOOKS[doing.phase]
    return {
        "row": look.label_of(robot),
        "begin": round(doing.begin_s, 3),
        "end": round(doing.end_s, 3),
        "fill": looks.fill or colour,
        "alpha": looks.alpha,
        "rim": looks.fill or colour,
        "hatch": looks.hatch,
        "phase": look.PHASE_TEXTS[doing.phase],
        "task": f"slot {doing.slot}, generation {doing.generation}" if claims else "-",
        "seconds": round(doing.end_s - doing.begin_s, 3),
        "how": f"{end.what}, {end.cause}" if end else "-",
    }


def how_ended(robot: RobotView, doing: Span) -> ClaimEnd | None:
    """How the claim of this bar came to its end; None: not in the log."""
    return next(
        (end for end in robot.ends if (end.slot, end.generation) == doing.task and end.at_s >= doing.begin_s),
        None,
    )


def _claim_labels(data: ReportData) -> dict[str, list[Any]]:
    """Slot and generation once per claim, where its first bar begins; playback.js hides what has no room."""
    labels: dict[str, list[Any]] = {"x": [], "row": [], "label": [], "shown": [], "room": []}
    for robot in data.robots:
        before: Span | None = None
        for doing in robot.spans:
            if before is not None and before.slot != NO_SLOT and before.task == doing.task:
                labels["room"][-1] = round(doing.end_s - labels["x"][-1], 3)
            elif doing.slot != NO_SLOT:
                labels["x"].append(round(doing.begin_s, 3))
                labels["row"].append(look.label_of(robot))
                labels["label"].append(f"{doing.slot}·{doing.generation}")
                labels["shown"].append("")
                labels["room"].append(round(doing.end_s - doing.begin_s, 3))
            before = doing
    return labels


EVENT_MARKS = {  # kind -> (marker; "" a bar while it lasts, colour, what the legend says)
    "alarm": ("triangle", "#D55E00", "alarm"),
    "conflict": ("x", "#CC79A7", "conflict"),
    "stop": ("square", "#000000", "STOP, RESUME"),
    "guard": ("", "#0072B2", "guard slowed it"),
    "recovery": ("circle", "#E69F00", "stuck"),
    "loss": ("inverted_triangle", "#5C6470", "records lost"),
}
INFO_COLOUR = "#8A93A1"


def events_figure(data: ReportData, shared: Range1d) -> Any | None:
    """Everything that went wrong or was told, by robot and time; None where nothing was."""
    plot = _time_figure([look.label_of(robot) for robot in data.robots], shared, "events", tools=False)
    drawn = []
    for kind, (marker, colour, text) in EVENT_MARKS.items():
        columns = _event_columns(data, kind, colour)
        if not columns["x"]:
            continue
        source = ColumnDataSource(columns, name=f"events_{kind}")
        looks = {"line_color": "colour", "fill_color": "colour", "line_width": 2, "legend_label": text}
        if marker:
            marks = plot.scatter("x", "row", marker=marker, size=10, fill_alpha=0.8, source=source, **looks)
        else:
            marks = plot.hbar("row", left="x", right="end", height=0.4, source=source, **looks)
        drawn.append(marks)
    if not drawn:
        return None
    legend = plot.legend[0]
    legend.update(orientation="horizontal", location="top_left", click_policy="hide", spacing=18)
    legend.update(glyph_width=14, glyph_height=14, label_standoff=6, padding=4, margin=0)
    plot.add_layout(legend, "above")
    plot.height += LEGEND_PX
    tooltips = [("", "@row, @x{0.0} s"), ("", "@what"), ("", "@text")]
    plot.add_tools(HoverTool(visible=False, renderers=drawn, tooltips=tooltips))
    return plot


def _event_columns(data: ReportData, kind: str, colour: str) -> dict[str, list[Any]]:
    columns: dict[str, list[Any]] = {key: [] for key in ("x", "end", "row", "colour", "what", "text")}
    told = _conflicts_told(data) if kind == "conflict" else _told(data, kind)
    for robot, one in told:
        shade = INFO_COLOUR if kind == "alarm" and one.level == INFO else colour
        end_s = one.at_s if math.isnan(one.end_s) else one.end_s
        row = round(one.at_s, 3), round(end_s, 3), look.label_of(robot), shade, one.code, one.text
        for key, value in zip(columns, row, strict=True):
            columns[key].append(value)
    return columns


def _told(data: ReportData, kind: str) -> list[tuple[RobotView, Happening]]:
    return [(robot, one) for robot in data.robots for one in robot.happenings if one.kind == kind]


def _conflicts_told(data: ReportData) -> list[tuple[RobotView, Happening]]:
    """On the row of each of the two robots."""
    views = {robot.robot: robot for robot in data.robots}
    told = []
    for one in data.conflicts:
        first, second = one.robots
        title = f"{one.kind} of slot {one.slot}, generation {one.generation}: {one.cause}"
        pairs = [(first, second), (second, first)] if data.explained else [(first, second)]
        for robot, other in pairs:
            if robot in views:
                happening = Happening(one.at_s, "conflict", INFO, title, f"with robot {other}; {one.text}")
                told.append((views[robot], happening))
    return told
