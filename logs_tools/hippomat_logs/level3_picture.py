"""Level L3 as a picture: recorded and simulated way on the map, the error with its bound, the drift.

Decides what is drawn. Knows matplotlib (extras `sim` and `viz`), no simulator.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hippomat_core.maps.map_event import grid_in
from hippomat_logs.level3 import BOUND_M, WINDOW_S, Driven, Motion
from hippomat_logs.pictures import new_figure
from hippomat_logs.reader import Run

INCHES, DPI = (11.0, 6.5), 110
RECORDED, SIMULATED, WHOLE = "#222222", "#d95f02", "#1f78b4"


def draw(run: Run, motion: Motion, driven: Driven, directory: Path) -> Path:
    """Write NAME_L3.png into `directory`, which is made if it does not exist."""
    figure = new_figure(INCHES, layout="constrained")
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / f"{run.name}_L3.png"
    grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1.0))
    _ways(figure.add_subplot(grid[:, 0]), motion, driven)
    _errors(figure.add_subplot(grid[0, 1]), driven)
    _drift(figure.add_subplot(grid[1, 1]), driven)
    figure.suptitle(f"{run.name}: recorded commands, simulated again")
    figure.savefig(path, dpi=DPI)
    return path


def _ways(axes: Any, motion: Motion, driven: Driven) -> None:
    if motion.map is not None:
        grid = grid_in(motion.map)
        walls = np.where(grid.cells < 50, np.nan, grid.cells)
        east_m, north_m = (size * grid.resolution_m for size in (grid.width, grid.height))
        x, y = grid.origin_x_m, grid.origin_y_m
        edges = (x, x + east_m, y, y + north_m)
        axes.imshow(walls, origin="lower", extent=edges, cmap="Greys", vmin=0, vmax=160)
    axes.plot(*driven.recorded[:, :2].T, color=RECORDED, lw=2.2, label="recorded")
    axes.plot(*driven.whole[:, :2].T, color=WHOLE, lw=0.9, ls="--", label="simulated in one go")
    pieces = np.insert(driven.windows[:, :2], [k + 1 for k in driven.begins[1:]], np.nan, axis=0)
    axes.plot(*pieces.T, color=SIMULATED, lw=1.2, label=f"simulated in {WINDOW_S:g} s windows")
    axes.plot(*driven.recorded[0, :2], "o", color=RECORDED, ms=6)
    ways = np.concatenate([driven.recorded[:, :2], driven.whole[:, :2]])
    low, high = ways.min(axis=0) - 0.5, ways.max(axis=0) + 0.5
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncol=3, frameon=False, fontsize=8)


def _errors(axes: Any, driven: Driven) -> None:
    axes.plot(driven.times_s[1:], driven.errors_m, color=SIMULATED, lw=0.9)
    axes.axhline(BOUND_M, color="red", lw=1.0, ls=":")
    axes.text(driven.times_s[-1], BOUND_M, "bound ", color="red", ha="right", va="bottom", fontsize=8)
    share = float(np.mean(driven.errors_m <= BOUND_M))
    axes.set_title(f"error in {WINDOW_S:g} s windows: {100 * share:.1f} % within", fontsize=9)
    top_m = max(float(driven.errors_m.max()), BOUND_M)
    axes.set(ylabel="error [m]", ylim=(0.0, 1.15 * top_m))


def _drift(axes: Any, driven: Driven) -> None:
    axes.plot(driven.times_s, driven.drift_m, color=WHOLE, lw=0.9)
    axes.set_title(f"drift of the whole run: {driven.drift_m[-1]:.2f} m at its end", fontsize=9)
    axes.set(xlabel="time [s]", ylabel="drift [m]")
    axes.set_ylim(bottom=0.0)
