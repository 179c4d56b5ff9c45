"""A picture of a map and of the way that the robot took in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hippomat_core.maps.occupancy_grid import FREE, OCCUPIED, OccupancyGrid

WIDTH_IN = 9.0
UNKNOWN_GREY, FREE_GREY = 0.82, 1.0


def draw(grid: OccupancyGrid, way: NDArray[np.float64], title: str, path: Path) -> None:
    """Write the file; its suffix says of which kind. way: (n, 3) poses in the map frame."""
    cells, (left, right, low, top) = _cropped(grid)
    shade = np.full(cells.shape, UNKNOWN_GREY)
    shade[cells == FREE] = FREE_GREY
    shade[cells == OCCUPIED] = 0.0
    ratio = (top - low) / (right - left)
    figure = Figure(
        figsize=(WIDTH_IN, min(max(WIDTH_IN * ratio, 4.0), 14.0) + 0.8), dpi=120, facecolor="white"
    )
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.imshow(
        shade,
        cmap="gray",
        vmin=0,
        vmax=1,
        origin="lower",
        extent=(left, right, low, top),
        interpolation="none",
    )
    axes.plot(way[:, 0], way[:, 1], color="#0072B2", linewidth=0.7, label="way of the robot")
    axes.plot(way[0, 0], way[0, 1], "o", color="#D55E00", markersize=4, label="start")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(title, fontsize=11, loc="left")
    axes.legend(loc="upper right", fontsize=8)
    figure.tight_layout()
    figure.savefig(path)


def _cropped(grid: OccupancyGrid) -> tuple[NDArray[np.int8], tuple[float, float, float, float]]:
    """The cells between the outermost walls, and left, right, low and top [m] of them."""
    iy, ix = np.nonzero(grid.cells == OCCUPIED)
    if not len(ix):
        iy, ix = np.array([0, grid.height - 1]), np.array([0, grid.width - 1])
    first_x, last_x, first_y, last_y = ix.min(), ix.max() + 1, iy.min(), iy.max() + 1
    extent = (
        grid.origin_x_m + first_x * grid.resolution_m,
        grid.origin_x_m + last_x * grid.resolution_m,
        grid.origin_y_m + first_y * grid.resolution_m,
        grid.origin_y_m + last_y * grid.resolution_m,
    )
    return grid.cells[first_y:last_y, first_x:last_x], extent
