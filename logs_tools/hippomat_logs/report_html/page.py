"""ReportData -> one HTML file that needs nothing else.

Bokeh's code is inside, and the page's own policy forbids any network access.

Everything that came out of a log passes through Jinja's escaping or its JSON filter on its way here.
"""

from __future__ import annotations

import math
from importlib import resources
from importlib.util import find_spec
from typing import Any

from hippomat_core.errors import HippomatError
from hippomat_logs.metrics.fleet_tables import fleet_lines, metrics_table, spread
from hippomat_logs.report_html import look
from hippomat_logs.report_html.data import PHASES, ReportData, RobotView
from hippomat_logs.report_html.tables import MOST_ROWS, alarm_rows, metrics_html

FOR_EVER_S = 1e9  # JSON has no infinity
TRAIL_S = 15


def needs_bokeh() -> None:
    """Raises HippomatError where it is not installed: better before an hour of reading than after it."""
    if find_spec("bokeh") is None:
        raise HippomatError("bokeh is not installed: pip install 'hippomat[report]'")


def render(data: ReportData, version: str) -> str:
    """The file's text. Raises HippomatError where Bokeh is not installed."""
    needs_bokeh()
    from bokeh.embed import components
    from bokeh.resources import Resources
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    from hippomat_logs.report_html import map_figure, matrices, time_figures

    shared = time_figures.time_range(data)
    drawn = {
        "map": map_figure.map_figure(data),
        "gantt": time_figures.gantt_figure(data, shared),
        "events": time_figures.events_figure(data, shared),
        "conflicts": matrices.conflict_figure(data),
        "delivery": matrices.delivery_figure(data),
        "latency": matrices.latency_figure(data),
        "age": matrices.age_figure(data),
    }
    script, divs = components({k: v for k, v in drawn.items() if v is not None}, theme=look.theme())
    library = Resources(mode="inline", components=["bokeh"])
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(_asset("page.html")).render(
        data=data,
        version=version,
        bokeh_js=Markup("\n".join(library.js_raw)),
        bokeh_script=Markup(script),
        figures={name: Markup(divs[name]) if name in divs else None for name in drawn},
        style=Markup(_asset("page.css")),
        playback_js=Markup(_asset("playback.js")),
        motion=_motion(data),
        phases=[(look.PHASE_LOOKS[phase], look.PHASE_TEXTS[phase]) for phase in PHASES],
        colours=[look.colour_of(k) for k in range(len(data.robots))],
        labels=[look.label_of(robot) for robot in data.robots],
        metrics=metrics_html(metrics_table(data.metrics)),
        metric_lines=fleet_lines(data.metrics),
        alarms=alarm_rows(data),
        conflicts=data.conflicts[:MOST_ROWS],
        no_conflict=_no_conflict(data),
        latency_text=spread(data.metrics.air_ms, 2, "ms"),
        age_text=matrices.age_text(data),
    )


def _no_conflict(data: ReportData) -> str:
    """What the logs can say of conflicts where they hold none."""
    if data.explained:
        return "No two robots wanted one task at once."
    if all(robot.heard_by is not None for robot in data.robots):
        return "Only a robot's own log tells."
    return "No robot here noticed another that wanted its task."


def _asset(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text("utf-8")


def _motion(data: ReportData) -> dict[str, Any]:
    """What playback.js needs beside the figures' own columns."""
    colours = {robot.robot: look.colour_of(k) for k, robot in enumerate(data.robots)}
    return {
        "trail_s": TRAIL_S,
        "span_s": round(data.span_s, 3),
        "step_s": data.frames.step_s,
        "phases": PHASES,
        "texts": look.PHASE_TEXTS,
        "robots": [_robot(robot, look.colour_of(k)) for k, robot in enumerate(data.robots)],
        "tasks": [
            [
                task.slot,
                task.generation,
                _place(task.x_m),
                _place(task.y_m),
                round(task.seen_s, 2),
                round(min(task.closed_s, FOR_EVER_S), 2),
                round(task.completed_s, 2) if task.completed_by >= 0 else FOR_EVER_S,
                colours.get(task.completed_by, look.INK),
            ]
            for task in data.tasks
        ],
    }


def _robot(robot: RobotView, colour: str) -> dict[str, Any]:
    from hippomat_logs.report_html.map_figure import outline_of

    return {
        "name": str(robot.robot),
        "colour": colour,
        "front_m": max(x for x, _ in outline_of(robot)),
        "outline": [[round(x, 3), round(y, 3)] for x, y in outline_of(robot)],
        "spans": [
            [
                round(span.begin_s, 2),
                round(span.end_s, 2),
                PHASES.index(span.phase),
                span.slot,
                span.generation,
                _place(span.x_m),
                _place(span.y_m),
            ]
            for span in robot.spans
        ],
        "ways": [[round(way.at_s, 2), way.x_m, way.y_m] for way in robot.ways],
    }


def _place(metres: float) -> float | None:
    return None if math.isnan(metres) else round(metres, 2)
