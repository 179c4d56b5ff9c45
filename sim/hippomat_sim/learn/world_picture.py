"""A picture of one world of a pool from above: obstacles by height, task sites, start cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from hippomat_sim.learn.settings import UAV, UGV
from hippomat_sim.learn.world_pool import WorldPool

# Okabe and Ito's colours, which colour-blind readers can tell apart.
_UGV, _UAV, _GROUND_SITE, _AIR_SITE = "#E69F00", "#56B4E9", "#D55E00", "#0072B2"
_PLOT_INCHES, _DPI = 6.4, 150


def draw_world(pool: WorldPool, world: int, path: Path) -> None:
    """Write the file; its suffix says of which kind (png, pdf, svg)."""
    _, height, width = pool.free[world].shape
    figure = Figure(
        figsize=(_PLOT_INCHES + 3.0, _PLOT_INCHES * height / width + 1.3), dpi=_DPI, facecolor="white"
    )
    FigureCanvasAgg(figure)
    figure.subplots_adjust(left=0.07, right=0.73, bottom=0.08, top=0.87)
    axes = figure.add_subplot()
    _obstacles(figure, axes, pool.free[world])
    _places(axes, pool, world)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.spines[:].set_visible(False)
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False, borderaxespad=0.0, fontsize=9)
    figure.text(
        0.07, 0.95, f"World {world} of the {pool.split} pool", fontsize=13, fontweight="bold", va="center"
    )
    figure.text(0.07, 0.905, _subtitle(pool, world), fontsize=9, color="#555555", va="center")
    figure.savefig(path)


def obstacle_heights(free: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(Y, X) cells from the ground to the top of what no one can enter, 0 where the ground is free."""
    blocked = ~free
    tops = len(free) - np.argmax(blocked[::-1], axis=0)
    return np.where(blocked.any(axis=0), tops, 0)


def _obstacles(figure: Figure, axes: Axes, free: NDArray[np.bool_]) -> None:
    heights = obstacle_heights(free)
    layers, height, width = free.shape
    image = axes.imshow(
        np.where(heights > 0, heights, np.nan),
        origin="lower",
        extent=(0, width, 0, height),
        cmap="Greys",
        vmin=-layers / 4,  # the lowest box is still told from the ground
        vmax=layers,
        interpolation="nearest",
    )
    axes.add_patch(Rectangle((0, 0), width, height, fill=False, edgecolor="#3b3b3b", linewidth=1.0))
    axes.set_xlim(-0.5, width + 0.5)
    axes.set_ylim(-0.5, height + 0.5)
    scale = figure.add_axes((0.77, 0.12, 0.018, 0.36))
    figure.colorbar(image, cax=scale, boundaries=np.arange(layers + 1) + 0.5)
    scale.set_ylabel("height of the obstacles [m]", fontsize=9)


def _places(axes: Axes, pool: WorldPool, world: int) -> None:
    starts = pool.settings.starts
    centres = pool.places_cell[world, :, :, :2] + 0.5
    airborne = pool.airborne[world]
    sites = centres[UGV, starts:]
    groups = (
        (centres[UGV, :starts], "s", 7, _UGV, "starts of UGVs"),
        (centres[UAV, :starts], "^", 9, _UAV, "starts of UAVs"),
        (sites[~airborne], "o", 34, _GROUND_SITE, "sites on the ground"),
        (sites[airborne], "D", 30, _AIR_SITE, "sites in the air"),
    )
    for order, (cells, marker, area, colour, label) in enumerate(groups, start=2):
        if len(cells):
            x, y = cells.T
            axes.scatter(
                x,
                y,
                s=area,
                c=colour,
                marker=marker,
                edgecolors="white",
                linewidths=0.4,
                label=label,
                zorder=order,
            )


def _subtitle(pool: WorldPool, world: int) -> str:
    share = 1.0 - float(pool.ground[world].mean())
    return (
        f"{' x '.join(str(side) for side in pool.settings.size_m)} m, seed {pool.settings.seed}, "
        f"{share:.0%} of the ground closed, longest way of the pool {pool.c_max_s:.0f} s"
    )
