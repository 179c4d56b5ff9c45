"""A picture of one run of `hippomat-bench motion`: where robots drove, where they waited, where they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from hippomat_core.motion.graph import motion_graph
from hippomat_sim.bench.motion_run import MotionFigures
from hippomat_sim.bench.motion_settings import MotionSettings
from hippomat_sim.picture import COLOURS

_TAIL = 40  # ticks of the way behind each robot that are drawn


def draw(settings: MotionSettings, figures: MotionFigures, path: Path) -> None:
    """Write the picture; seen from above."""
    figure = Figure(figsize=(13.0, 6.8), dpi=130, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    ways, waits = figure.subplots(1, 2)
    cells = motion_graph(figures.free, settings.diagonals).cells
    _ways(ways, figures, cells)
    figure.colorbar(_waits(waits, figures, cells), ax=[ways, waits], shrink=0.7)
    figure.suptitle(
        f"{settings.planner} on {settings.map}, seed {figures.seed}: {settings.agents} robots, "
        f"{settings.steps} ticks, {settings.loss:.0%} of the frames lost\n"
        f"{figures.verdict.collisions} collisions, "
        f"{figures.stuck} stuck, {figures.tasks} tasks, {100 * figures.of_bound:.1f} % of the bound"
    )
    figure.savefig(path)


def _walls(axes: Axes, free: NDArray[np.bool_], title: str) -> None:
    axes.imshow(~free.any(axis=0), cmap=ListedColormap(["white", "#3b3b3b"]), origin="lower", vmin=0, vmax=1)
    axes.set_title(title, fontsize=10)
    axes.set_xticks([])
    axes.set_yticks([])


def _ways(axes: Axes, figures: MotionFigures, cells: NDArray[np.int32]) -> None:
    _walls(axes, figures.free, f"the last {_TAIL} ticks; circles: robots, crosses: their goals")
    for robot in range(figures.trace.shape[1]):
        colour = COLOURS[robot % len(COLOURS)]
        way = cells[figures.trace[-_TAIL:, robot], :2].astype(np.float64)
        lines = LineCollection(
            list(np.stack([way[:-1], way[1:]], axis=1)),
            colors=colour,
            linewidths=np.linspace(0.3, 2.0, len(way) - 1),
        )
        axes.add_collection(lines)
        axes.plot(*way[-1], "o", color=colour, markersize=6, markeredgecolor="white", zorder=4)
        axes.plot(*cells[figures.goals[robot], :2], "x", color=colour, markersize=6, zorder=3)


def _waits(axes: Axes, figures: MotionFigures, cells: NDArray[np.int32]) -> AxesImage:
    _walls(axes, figures.free, "ticks in which a robot stood in a cell, in the whole run")
    stands = figures.trace[1:][figures.trace[1:] == figures.trace[:-1]]
    counts = np.zeros(figures.free.shape[1:])
    np.add.at(counts, (cells[stands, 1], cells[stands, 0]), 1)
    counts[counts == 0] = np.nan
    return axes.imshow(counts, origin="lower", cmap="viridis_r", vmin=1)
