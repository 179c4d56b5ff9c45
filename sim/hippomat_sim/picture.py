"""A picture of a run: the map, the ways that the robots really drove, and the tasks they completed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.costmap import OCCUPIED_FROM

# Okabe and Ito's colours, which colour-blind readers can tell apart; more robots go round again, dashed.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#6A3D9A", "#8C564B")
_UNKNOWN, _FREE, _WALL = "#dfdcd5", "#ffffff", "#3b3b3b"
_MARGIN_M, _SCALE_BAR_M = 0.25, 0.3  # around the map, and more below it for the scale bar
_CASING = [Stroke(linewidth=3.6, foreground="white"), Normal()]


@dataclass(frozen=True, slots=True)
class PictureData:
    """What is drawn. Map frame throughout."""

    grid: OccupancyGrid
    poses: NDArray[np.float64]  # (T, N, 3)
    completed: Sequence[tuple[int, float, float]]  # robot, x [m], y [m]
    contacts: Sequence[tuple[float, float]]  # x [m], y [m]
    robot_radius_m: float
    title: str
    subtitle: str = ""


def draw(data: PictureData, path: Path) -> None:
    """Write the PNG."""
    x0, y0, x1, y1 = _frame(data.grid)
    width = 7.2
    figure = Figure(figsize=(width + 2.4, width * (y1 - y0) / (x1 - x0) + 1.0), dpi=150, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.02, 0.03, 0.74, 0.86))
    _map(axes, data.grid)
    for robot in range(data.poses.shape[1]):
        _way(axes, data.poses[:, robot], robot, data.robot_radius_m)
    for robot, x, y in data.completed:
        axes.plot(x, y, "*", color=colour(robot), markersize=13, markeredgecolor="white", zorder=5)
    for x, y in data.contacts:
        axes.plot(x, y, "x", color="red", markersize=12, markeredgewidth=3, zorder=8)
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)
    axes.set_aspect("equal", anchor="W")
    axes.axis("off")
    _scale_bar(axes, x0, y0)
    figure.text(0.025, 0.955, data.title, fontsize=13, fontweight="bold", va="center")
    figure.text(0.025, 0.915, data.subtitle, fontsize=9.5, color="#555555", va="center")
    _legend(figure, data)
    figure.savefig(path)


def colour(robot: int) -> str:
    return COLOURS[robot % len(COLOURS)]


def _frame(grid: OccupancyGrid) -> tuple[float, float, float, float]:
    """x0, y0, x1, y1 [m] of what is known of the map, with a margin."""
    iy, ix = np.nonzero(grid.cells >= 0)
    if not len(ix):
        ix, iy = np.array([0, grid.width - 1]), np.array([0, grid.height - 1])
    left, low = grid.centre_of(int(ix.min()), int(iy.min()))
    right, high = grid.centre_of(int(ix.max()), int(iy.max()))
    return left - _MARGIN_M, low - _MARGIN_M - _SCALE_BAR_M, right + _MARGIN_M, high + _MARGIN_M


def _map(axes: Axes, grid: OccupancyGrid) -> None:
    kinds = np.where(grid.cells < 0, 0, np.where(grid.cells >= OCCUPIED_FROM, 2, 1))
    x0, y0 = grid.origin_x_m, grid.origin_y_m
    extent = (x0, x0 + grid.width * grid.resolution_m, y0, y0 + grid.height * grid.resolution_m)
    colours = ListedColormap([_UNKNOWN, _FREE, _WALL])
    axes.imshow(
        kinds, origin="lower", extent=extent, cmap=colours, vmin=0, vmax=2, interpolation="nearest", zorder=0
    )
    axes.set_facecolor(_UNKNOWN)


def _way(axes: Axes, poses: NDArray[np.float64], robot: int, radius_m: float) -> None:
    """The path, a ring with the robot's number where it began, its body where it ended."""
    if not len(poses):
        return
    style = "-" if robot < len(COLOURS) else "--"
    line = axes.plot(poses[:, 0], poses[:, 1], style, color=colour(robot), linewidth=2.0, zorder=3)[0]
    line.set_path_effects(_CASING)
    (x, y, _), (end_x, end_y, yaw) = poses[0].tolist(), poses[-1].tolist()
    body = Circle(
        (end_x, end_y), radius_m, facecolor=colour(robot), edgecolor="white", linewidth=1.2, zorder=6
    )
    axes.add_patch(body)
    nose = [end_x, end_x + radius_m * math.cos(yaw)], [end_y, end_y + radius_m * math.sin(yaw)]
    axes.plot(*nose, color="white", linewidth=1.8, zorder=6.5, solid_capstyle="round")
    ring = axes.plot(x, y, "o", markersize=14, markerfacecolor="white", markeredgewidth=2.0, zorder=6)[0]
    ring.set_markeredgecolor(colour(robot))
    axes.text(x, y, str(robot), fontsize=8, fontweight="bold", ha="center", va="center", zorder=7)


def _scale_bar(axes: Axes, x0: float, y0: float) -> None:
    x, y = x0 + 0.12, y0 + 0.12
    axes.plot([x, x + 1.0], [y, y], color="#333333", linewidth=2.5, zorder=9, solid_capstyle="butt")
    axes.text(x + 0.5, y + 0.05, "1 m", fontsize=9, color="#333333", ha="center", va="bottom", zorder=9)


def _legend(figure: Figure, data: PictureData) -> None:
    handles = []
    for robot in range(data.poses.shape[1]):
        way = np.diff(data.poses[:, robot, :2], axis=0)
        metres = float(np.hypot(way[:, 0], way[:, 1]).sum())
        tasks = sum(one == robot for one, _, _ in data.completed)
        label = f"robot {robot}: {tasks} task{'' if tasks == 1 else 's'}, {metres:.1f} m"
        handles.append(Line2D([], [], color=colour(robot), linewidth=3, label=label))
    grey = "#777777"
    ring = Line2D([], [], color="white", marker="o", markeredgecolor=grey, markeredgewidth=2, markersize=10)
    star = Line2D(
        [], [], color="white", marker="*", markerfacecolor=grey, markeredgecolor="white", markersize=14
    )
    disc = Line2D([], [], color="white", marker="o", markerfacecolor=grey, markersize=11)
    for handle, label in ((ring, "start"), (disc, "end"), (star, "task completed")):
        handle.set_label(label)
        handles.append(handle)
    if data.contacts:
        handles.append(Line2D([], [], color="white", marker="x", markeredgecolor="red", label="contact"))
    figure.legend(handles=handles, loc="center left", bbox_to_anchor=(0.76, 0.5), frameon=False, fontsize=9)
