"""The map with all that lies and moves on it, as a Bokeh figure.

Decides marks, units and hover texts. Sources of what moves are empty here: playback.js fills them, and finds
them by the names given here.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from bokeh.models import (
    ColumnDataSource,
    DataRange1d,
    HoverTool,
    LinearColorMapper,
    PanTool,
    ResetTool,
    SaveTool,
    WheelZoomTool,
)
from bokeh.plotting import figure
from numpy.typing import NDArray

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_logs.report_html import look
from hippomat_logs.report_html.data import ReportData, RobotView

Floats = NDArray[np.float32]

MARGIN_M = 0.3
FINE_M = 0.04  # all of a way is painted again for every picture of a playing run
OCCUPIED_FROM = 65  # percent, as nav2's map server
MOST_CELLS = 1_500  # a side; larger maps are drawn coarser, walls kept
CORNERS = 20  # of a drawn disc


def map_figure(data: ReportData) -> Any:
    """Map, whole ways, and the empty sources of what moves: trails, ways, tasks, robots."""
    plot = figure(
        x_range=DataRange1d(range_padding=0.02),
        y_range=DataRange1d(range_padding=0.02),
        x_axis_label="x [m]",
        y_axis_label="y [m]",
        match_aspect=True,
        sizing_mode="stretch_both",  # of what page.css gives it
        tools=[PanTool(), WheelZoomTool(), ResetTool(), SaveTool()],
        active_scroll=None,
        name="map",
    )
    plot.toolbar.logo = None
    left, right, low, top = _extent(data)
    ground = plot.rect((left + right) / 2, (low + top) / 2, right - left, top - low, alpha=0.0)
    plot.x_range.renderers = plot.y_range.renderers = [ground]  # all of it, whatever moves on it
    if data.grid is not None:
        _draw_grid(plot, data.grid)
    colours = [look.colour_of(k) for k in range(len(data.robots))]
    frames = data.frames
    tracks = {"xs": list(frames.x_m), "ys": list(frames.y_m), "yaws": list(frames.yaw_rad)}
    plot.tags = [ColumnDataSource(tracks, name="tracks")]  # not drawn; it travels with the figure
    xs, ys = zip(*map(thinned, frames.x_m, frames.y_m), strict=True) if colours else ((), ())
    whole = ColumnDataSource({"xs": list(xs), "ys": list(ys), "colour": colours})
    plot.multi_line("xs", "ys", color="colour", alpha=0.22, line_width=1.2, source=whole)
    trails = _empty("trails", "xs", "ys", "colour")
    plot.multi_line("xs", "ys", color="colour", alpha=0.9, line_width=2.2, line_cap="round", source=trails)
    ways = _empty("ways", "xs", "ys", "colour")
    plot.multi_line("xs", "ys", color="colour", alpha=0.9, line_width=1.4, line_dash=[3, 4], source=ways)
    _draw_tasks(plot)
    _draw_robots(plot)
    return plot


def thinned(x_m: Floats, y_m: Floats) -> tuple[Floats, Floats]:
    """A way without poses nearer than FINE_M to the one before; where it is broken (nan) it stays so."""
    kept, last = [], (math.inf, math.inf)
    for k, (x, y) in enumerate(zip(x_m.tolist(), y_m.tolist(), strict=True)):
        if not math.hypot(x - last[0], y - last[1]) < FINE_M:
            kept.append(k)
            last = x, y
    return x_m[kept], y_m[kept]


def _extent(data: ReportData) -> tuple[float, float, float, float]:
    """left, right, low, top [m] of all that is known of the map and all that drove or lay somewhere."""
    xs: list[NDArray[np.float32]] = [data.frames.x_m.ravel()]
    ys: list[NDArray[np.float32]] = [data.frames.y_m.ravel()]
    xs.append(np.array([task.x_m for task in data.tasks], np.float32))
    ys.append(np.array([task.y_m for task in data.tasks], np.float32))
    if data.grid is not None:
        _, edges = cropped(data.grid)
        xs.append(np.array(edges[:2], np.float32))
        ys.append(np.array(edges[2:], np.float32))
    x, y = (np.concatenate(parts) for parts in (xs, ys))
    x, y = x[np.isfinite(x)], y[np.isfinite(y)]
    if not len(x) or not len(y):
        return -1.0, 1.0, -1.0, 1.0
    return (
        float(x.min()) - MARGIN_M,
        float(x.max()) + MARGIN_M,
        float(y.min()) - MARGIN_M,
        float(y.max()) + MARGIN_M,
    )


def cropped(grid: OccupancyGrid) -> tuple[NDArray[np.uint8], tuple[float, float, float, float]]:
    """The part of a map that is known: 0 unknown, 1 free, 2 wall; and its left, right, low, top [m]."""
    kinds = np.where(grid.cells < 0, 0, np.where(grid.cells >= OCCUPIED_FROM, 2, 1)).astype(np.uint8)
    known_y, known_x = (np.flatnonzero((kinds > 0).any(axis=axis)) for axis in (1, 0))
    if not len(known_x):
        known_y, known_x = np.arange(grid.height), np.arange(grid.width)
    ix, iy = int(known_x[0]), int(known_y[0])
    kinds = kinds[iy : int(known_y[-1]) + 1, ix : int(known_x[-1]) + 1]
    high, wide = kinds.shape
    left, low = grid.origin_x_m + ix * grid.resolution_m, grid.origin_y_m + iy * grid.resolution_m
    edges = left, left + wide * grid.resolution_m, low, low + high * grid.resolution_m
    return kinds, edges


def coarser(kinds: NDArray[np.uint8], factor: int) -> tuple[NDArray[np.uint8], int, int]:
    """A wall stays one in every block that holds some; and how many rows and columns were added for that."""
    high, wide = kinds.shape
    more_y, more_x = -high % factor, -wide % factor
    padded = np.pad(kinds, ((0, more_y), (0, more_x)))
    blocks = padded.reshape(len(padded) // factor, factor, -1, factor)
    return blocks.max(axis=(1, 3)), more_y, more_x


def _draw_grid(plot: Any, grid: OccupancyGrid) -> None:
    kinds, (left, right, low, top) = cropped(grid)
    factor = -(-max(kinds.shape) // MOST_CELLS)
    kinds, more_y, more_x = coarser(kinds, factor)
    right, top = right + more_x * grid.resolution_m, top + more_y * grid.resolution_m
    palette = [look.UNKNOWN_COLOUR, look.FREE_COLOUR, look.WALL_COLOUR]
    mapper = LinearColorMapper(palette=palette, low=0, high=2)
    plot.image([kinds], x=left, y=low, dw=right - left, dh=top - low, color_mapper=mapper, level="image")
    plot.grid.visible = False
    plot.background_fill_color = look.UNKNOWN_COLOUR


def _empty(name: str, *columns: str) -> ColumnDataSource:
    return ColumnDataSource({column: [] for column in columns}, name=name)


def _draw_tasks(plot: Any) -> None:
    source = _empty("tasks", "x", "y", "fill", "line", "alpha", "size", "mark", "label", "text")
    drawn = plot.scatter(
        "x", "y", marker="mark", size="size", fill_color="fill", line_color="line", line_width=1.8,
        fill_alpha="alpha", line_alpha="alpha", source=source,
    )  # fmt: skip
    plot.text(
        "x", "y", text="label", text_font_size="11px", x_offset=8, y_offset=-4, alpha="alpha", padding=1,
        background_fill_color="#FFFFFF", background_fill_alpha=0.75, border_radius=3, source=source,
    )  # fmt: skip
    plot.add_tools(HoverTool(visible=False, renderers=[drawn], tooltips=[("task", "@text")]))


def _draw_robots(plot: Any) -> None:
    columns = ("x", "y", "hx", "hy", "xs", "ys", "name", "colour", "rim", "rim_px", "text")
    source = _empty("robots", *columns)
    plot.scatter("x", "y", size=12, color="colour", source=source)  # of a body that is smaller on the screen
    bodies = plot.patches(
        "xs", "ys", fill_color="colour", line_color="rim", line_width="rim_px", source=source
    )
    plot.segment("x", "y", "hx", "hy", line_color="#FFFFFF", line_width=2, line_cap="round", source=source)
    plot.text(
        "x", "y", text="name", text_font_size="13px", text_font_style="bold", text_color="colour",
        background_fill_color="#FFFFFF", background_fill_alpha=0.75, padding=1, border_radius=3,
        x_offset=10, y_offset=20, source=source,
    )  # fmt: skip
    plot.add_tools(HoverTool(visible=False, renderers=[bodies], tooltips=[("robot", "@name"), ("", "@text")]))


def outline_of(robot: RobotView) -> list[tuple[float, float]]:
    """Corners of the body, base frame [m]."""
    if robot.body.corners:
        return list(robot.body.corners)
    turns = [2 * math.pi * k / CORNERS for k in range(CORNERS)]
    return [(robot.body.radius_m * math.cos(a), robot.body.radius_m * math.sin(a)) for a in turns]
