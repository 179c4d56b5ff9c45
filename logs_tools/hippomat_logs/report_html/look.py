"""Colours and the looks that all figures share.

A robot has one colour everywhere, of Okabe and Ito's (2008), which people with any colour vision tell apart;
what it does shows in how full that colour is, or in grey and hatching.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hippomat_logs.report_html.data import (
    CONFIRMED,
    IDLE,
    LOST,
    NOT_READY,
    RECOVERY,
    REQUESTED,
    SERVING,
    STOPPED,
    RobotView,
)

ROBOT_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8B6508", "#5B3E96")


@dataclass(frozen=True, slots=True)
class PhaseLook:
    """fill "": the robot's colour."""

    fill: str
    alpha: float
    hatch: str = " "


PHASE_LOOKS = {
    IDLE: PhaseLook("#C9CED6", 0.7),
    NOT_READY: PhaseLook("#C9CED6", 0.25),
    REQUESTED: PhaseLook("", 0.12),
    CONFIRMED: PhaseLook("", 0.5),
    SERVING: PhaseLook("", 1.0),
    RECOVERY: PhaseLook("", 0.12, "/"),
    STOPPED: PhaseLook("#1F2733", 1.0),
    LOST: PhaseLook("#C9CED6", 0.25, "x"),
}
PHASE_TEXTS = {
    IDLE: "idle",
    NOT_READY: "not ready to be given a task",
    REQUESTED: "drives, claim not yet confirmed",
    CONFIRMED: "drives, claim confirmed",
    SERVING: "serves its task",
    RECOVERY: "stuck, tries to get free",
    STOPPED: "stopped by STOP",
    LOST: "does not know where it is",
}
FREE_COLOUR, UNKNOWN_COLOUR, WALL_COLOUR = "#FFFFFF", "#E8EAEE", "#252A33"
INK, SOFT_INK, GRID = "#1F2733", "#5C6470", "#E3E6EB"
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"


def colour_of(index: int) -> str:
    """Of the index-th robot; they come again after eight, so every robot has its number beside it."""
    return ROBOT_COLOURS[index % len(ROBOT_COLOURS)]


def label_of(robot: RobotView) -> str:
    return f"robot {robot.robot}" + (" (heard)" if robot.heard_by is not None else "")


def theme() -> Any:
    from bokeh.themes import Theme

    text = {"text_font": FONT, "text_color": INK}
    return Theme(
        json={
            "attrs": {
                "Plot": {
                    "background_fill_color": "#FFFFFF",
                    "border_fill_color": None,
                    "outline_line_color": GRID,
                },
                "Axis": {
                    "axis_label_text_font": FONT,
                    "axis_label_text_font_style": "normal",
                    "axis_label_text_font_size": "12px",
                    "axis_label_text_color": SOFT_INK,
                    "major_label_text_font": FONT,
                    "major_label_text_font_size": "12px",
                    "major_label_text_color": INK,
                    "axis_line_color": "#AEB4BE",
                    "major_tick_line_color": "#AEB4BE",
                    "minor_tick_line_color": None,
                },
                "Grid": {"grid_line_color": GRID},
                "Text": text,
                "ColorBar": {
                    "title_text_font": FONT,
                    "title_text_font_style": "normal",
                    "title_text_font_size": "12px",
                    "title_text_color": SOFT_INK,
                    "major_label_text_font": FONT,
                    "major_label_text_color": INK,
                },
                "Legend": {
                    "label_text_font": FONT,
                    "label_text_font_size": "12px",
                    "label_text_color": INK,
                    "border_line_color": None,
                    "background_fill_alpha": 0.0,
                },
            }
        }
    )
