"""Pictures of the report: fixed and continuous tasks by fleet size, and the sweep over losses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # no window, no display
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hippomat_sim.bench import tables_cells as kinds
from hippomat_sim.bench.tables_layout import Book
from hippomat_sim.bench.tables_sections import CONTINUOUS_PLOT, FIXED_PLOT, SWEEP
from hippomat_sim.bench.tables_stats import Estimate
from hippomat_sim.learn.method_registry import METHODS

_MARKERS = "osD^vP<>X*hdp8H"
_NEAR = 20.0  # %: differences up to this are drawn to scale
Point = tuple[float, Estimate]


def draw(book: Book, directory: Path) -> list[Path]:
    """Writes the pictures for which there are figures; returns their paths."""
    written = []
    for name, kind, picture in (
        (FIXED_PLOT, kinds.ONE_SHOT, _fixed),
        (CONTINUOUS_PLOT, kinds.CONTINUOUS, _continuous),
        (SWEEP, kinds.LOSS, _sweep),
    ):
        if any(one.kind == kind for one in book.figures):
            figure = picture(book)
            figure.savefig(directory / name, dpi=110)
            pyplot.close(figure)
            written.append(directory / name)
    return written


def _fixed(book: Book) -> Figure:
    figure, axes = pyplot.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    sizes = [size for size in book.sizes(kinds.ONE_SHOT, square=True) if size not in kinds.LARGE]
    panels = (("cf1", "CF1 [%]"), ("gap", "gap to the cheapest assignment [%]"))
    for axis, (metric, label) in zip(axes, panels, strict=True):
        for name in book.methods(kinds.ONE_SHOT):
            _line(axis, name, _points(book, kinds.ONE_SHOT, metric, name, sizes))
        axis.set(xlabel="agents N = tasks M", ylabel=label, xticks=[agents for agents, _ in sizes])
    axes[1].set_yscale("symlog", linthresh=0.1)  # from hundredths of a per cent to hundreds
    axes[1].set_ylim(bottom=0.0)
    axes[1].yaxis.set_major_formatter("{x:g}")
    _finish(figure, axes, "Fixed tasks, 95 % intervals")
    return figure


def _continuous(book: Book) -> Figure:
    figure, axes = pyplot.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    sizes = book.sizes(kinds.CONTINUOUS)
    panels = (("agent_s_over", "agent-seconds per task, above Hungarian [%]"), ("cf", "CF [%]"))
    for axis, (metric, label) in zip(axes, panels, strict=True):
        for name in book.methods(kinds.CONTINUOUS):
            _line(axis, name, _points(book, kinds.CONTINUOUS, metric, name, sizes))
        label_x = f"agents N, {kinds.CONTINUOUS_TASKS} open tasks"
        axis.set(xlabel=label_x, ylabel=label, xticks=[agents for agents, _ in sizes])
    if axes[0].get_ylim()[1] > 2.0 * _NEAR:  # random ones are hundreds of per cent worse
        axes[0].set_yscale("symlog", linthresh=_NEAR)
        axes[0].set_yticks([-10, 0, 10, 100, 1000])
        axes[0].yaxis.set_major_formatter("{x:g}")
    _finish(figure, axes, "Continuous tasks, 95 % intervals")
    return figure


def _sweep(book: Book) -> Figure:
    sizes = book.sizes(kinds.LOSS)
    losses = sorted({one.loss for one in book.figures if one.kind == kinds.LOSS})
    width = max(5.5 * len(sizes), 7.0)
    figure, grid = pyplot.subplots(1, len(sizes), figsize=(width, 4.6), layout="constrained", squeeze=False)
    for axis, (agents, tasks) in zip(grid[0], sizes, strict=True):
        for name in book.methods(kinds.LOSS):
            for relay in (True, False):
                points = [
                    (100.0 * loss, found)
                    for loss in losses
                    if (found := book.find(kinds.LOSS, "cf1", name, agents, tasks, loss, relay or not loss))
                ]
                _line(axis, name, points, dashed=not relay)
        axis.set(xlabel="frames lost [%]", ylabel="CF1 [%]", title=f"N = {agents}, M = {tasks}")
    _finish(figure, grid[0], "Under loss: solid with relay, dashed without")
    return figure


def _points(book: Book, kind: str, metric: str, method: str, sizes: Sequence[tuple[int, int]]) -> list[Point]:
    found = ((agents, book.find(kind, metric, method, agents, tasks)) for agents, tasks in sizes)
    return [(float(agents), estimate) for agents, estimate in found if estimate is not None]


def _line(axis: Axes, method: str, points: Sequence[Point], dashed: bool = False) -> None:
    """A method has the same colour and marker in every picture."""
    if not points:
        return
    number = list(METHODS).index(method)
    values = [estimate.value for _, estimate in points]
    below = [max(0.0, estimate.value - estimate.low) for _, estimate in points]
    above = [max(0.0, estimate.high - estimate.value) for _, estimate in points]
    aside = 1.0 + 0.004 * (number - len(METHODS) / 2.0)  # so that equal ones do not hide one another
    axis.errorbar(
        [x * aside for x, _ in points],
        values,
        [below, above],
        label=None if dashed else METHODS[method].label,
        color=pyplot.get_cmap("tab20")(number % 20),
        marker=_MARKERS[number % len(_MARKERS)],
        markersize=4.5,
        linestyle="--" if dashed else "-",
        linewidth=1.2,
        capsize=2,
    )


def _finish(figure: Figure, axes: Sequence[Axes], title: str) -> None:
    """One legend for all panels, beside them."""
    for axis in axes:
        axis.grid(alpha=0.3)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right center", fontsize=8, frameon=False)
    figure.suptitle(title)
