"""Histograms of the re-runs with the recorded value marked, and of paired differences. Needs matplotlib."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hippomat_logs.closed_loop.figures import Distribution, PairedDifference
from hippomat_logs.metrics.figures import Figure
from hippomat_logs.pictures import new_figure

if TYPE_CHECKING:
    from hippomat_logs.closed_loop.command import ClosedLoop

COLUMNS = 4
_RERUNS, _OTHER, _RECORDED = "#4c78a8", "#f58518", "#d62728"


def draw(found: ClosedLoop, directory: Path) -> list[Path]:
    """closed_loop.png, and differences.png where there are pairs; the directory is made if missing."""
    directory.mkdir(parents=True, exist_ok=True)
    others = [[values[one.figure.key] for values in found.others] for one in found.distributions]
    paths = [directory / "closed_loop.png"]
    figure, axes = _grid(len(found.distributions))
    for axis, one, other in zip(axes, found.distributions, others, strict=False):
        _distribution(axis, one, found.allocator, other, found.other.allocator if found.other else "")
    handles, labels = axes[0].get_legend_handles_labels()
    _finish(axes, len(found.distributions), handles, labels)
    figure.suptitle(f"{len(found.seeds)} re-runs of one recorded run, radio {found.radio}")
    figure.savefig(paths[0], dpi=130)
    if found.differences:
        paths.append(directory / "differences.png")
        _differences(found).savefig(paths[1], dpi=130)
    return paths


def _grid(count: int) -> tuple[Any, list[Any]]:
    rows = math.ceil((count + 1) / COLUMNS)  # one place for the legend
    picture = new_figure((3.1 * COLUMNS, 2.6 * rows), layout="constrained")
    return picture, list(np.ravel(picture.subplots(rows, COLUMNS)))


def _finish(axes: list[Any], used: int, handles: list[Any], labels: list[str]) -> None:
    for axis in axes[used:]:
        axis.axis("off")
    axes[used].legend(handles, labels, loc="center", frameon=False)


def _distribution(axis: Any, one: Distribution, name: str, other: list[float], other_name: str) -> None:
    drawn = [(one.values, name, _RERUNS)]
    if other:
        numbers = np.array(other)
        drawn.append((numbers[~np.isnan(numbers)], other_name, _OTHER))
    everything = np.concatenate([values for values, _, _ in drawn])
    if not math.isnan(one.recorded):
        everything = np.append(everything, one.recorded)
    if not len(everything):
        axis.text(0.5, 0.5, "nothing", ha="center", transform=axis.transAxes)
        axis.set_title(one.figure.label, fontsize=10)
        return
    edges = _edges(everything, one.figure)
    for values, label, colour in drawn:
        axis.hist(values, edges, color=colour, alpha=0.65, label=f"re-runs, {label}")
    if not math.isnan(one.recorded):
        axis.axvline(one.recorded, color=_RECORDED, lw=2, label="recorded")
    axis.set_title(one.figure.label, fontsize=10)
    axis.set_xlabel(one.figure.unit or "", fontsize=9)
    axis.set_ylabel("re-runs", fontsize=9)
    axis.yaxis.get_major_locator().set_params(integer=True)
    if one.figure.digits == 0:
        axis.xaxis.get_major_locator().set_params(integer=True)
    axis.tick_params(labelsize=8)


def _edges(values: np.ndarray[Any, np.dtype[np.float64]], figure: Figure) -> np.ndarray[Any, Any]:
    """Counts get a bin per whole number, as long as those are few."""
    low, high = float(values.min()), float(values.max())
    if figure.digits == 0 and high - low <= 24:  # bars around whole numbers
        return np.arange(low - 0.5, high + 1.0)
    if low == high:
        return np.linspace(low - 0.5, high + 0.5, 4)
    return np.linspace(low, high, 13)


def _differences(found: ClosedLoop) -> Any:
    assert found.other is not None
    picture, axes = _grid(len(found.differences))
    reruns = {key: np.array([values[key] for values in found.reruns]) for key in found.recorded}
    others = {key: np.array([values[key] for values in found.others]) for key in found.recorded}
    for axis, one in zip(axes, found.differences, strict=False):
        _difference(axis, one, others[one.figure.key] - reruns[one.figure.key])
    handles, labels = axes[0].get_legend_handles_labels()
    _finish(axes, len(found.differences), handles, labels)
    picture.suptitle(f"{found.other.text} - {found.allocator}, seed by seed (radio {found.radio})")
    return picture


def _difference(axis: Any, one: PairedDifference, values: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    values = np.sort(values[~np.isnan(values)])
    axis.axvline(0.0, color="black", lw=0.8)
    axis.plot(values, np.arange(1, len(values) + 1), "o", ms=3.5, color=_OTHER, label="one seed's difference")
    if not math.isnan(one.low):
        axis.axvspan(one.low, one.high, color=_RERUNS, alpha=0.35, label="mean, 95 % interval")
    axis.set_title(one.figure.label, fontsize=10)
    axis.set_xlabel(one.figure.unit or "", fontsize=9)
    axis.set_yticks([])
    axis.xaxis.get_major_locator().set_params(nbins=5)
    axis.tick_params(labelsize=8)
