"""Training curves as pictures: reward and entropy over steps (the paper's two figures), the frozen set."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

Row = dict[str, Any]
Floats = NDArray[np.float64]

_COLOURS = ("#2a6fbb", "#c4572b", "#3f8f4f", "#8a5fb0", "#8a7a2b", "#4aa3a3")


def draw_curves(folder: Path, rows: Sequence[Row]) -> list[Path]:
    """Writes reward.png, entropy.png and, after an evaluation, evaluation.png; returns the paths."""
    written = [
        _picture(
            folder / "reward.png",
            rows,
            {
                "mean reward of an agent": [("reward", "reward")],
                "R(t), sum over the fleet": [("R(t)", "team_reward")],
            },
        ),
        _picture(folder / "entropy.png", rows, {"entropy of the policy [nat]": [("entropy", "entropy")]}),
    ]
    asked = [row for row in rows if "evaluation" in row]
    if asked:
        flat = [{"agent_steps": row["agent_steps"], **_flat(row["evaluation"])} for row in asked]
        sizes = sorted({size for row in asked for size in row["evaluation"]}, key=int)
        panels = {
            title: [(f"N = M = {size}", f"{figure} {size}") for size in sizes]
            for title, figure in (("CF1 [%]", "cf1"), ("gap to Hungarian [%]", "gap"))
        }
        written.append(_picture(folder / "evaluation.png", flat, panels))
    return written


def _flat(evaluation: dict[str, dict[str, float]]) -> dict[str, float]:
    return {
        f"{name} {size}": figure for size, figures in evaluation.items() for name, figure in figures.items()
    }


def _picture(path: Path, rows: Sequence[Row], panels: dict[str, list[tuple[str, str]]]) -> Path:
    """One panel above the other; panels: label of the y axis -> (name, key) of its curves."""
    figure = Figure(figsize=(7.0, 2.2 + 2.0 * len(panels)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = np.atleast_1d(figure.subplots(len(panels), 1, sharex=True))
    for panel, (label, curves) in zip(axes, panels.items(), strict=True):
        for (name, key), colour in zip(curves, _COLOURS * len(curves), strict=False):
            _curve(panel, rows, name, key, colour)
        panel.set_ylabel(label)
        panel.grid(alpha=0.3)
        if len(curves) > 1:
            panel.legend(frameon=False)
    axes[-1].set_xlabel("agent steps")
    figure.savefig(path, dpi=150)
    return path


def _curve(axes: Axes, rows: Sequence[Row], name: str, key: str, colour: str) -> None:
    steps = np.array([row["agent_steps"] for row in rows if key in row], np.float64)
    figures = np.array([row[key] for row in rows if key in row], np.float64)
    if len(figures) > 100:
        axes.plot(steps, figures, color=colour, alpha=0.25, linewidth=0.7)
        figures = _smoothed(figures, len(figures) // 50)
    axes.plot(steps, figures, color=colour, label=name, linewidth=1.6)


def _smoothed(figures: Floats, width: int) -> Floats:
    """Running mean over 2 width + 1 neighbours, fewer at the ends."""
    sums = np.concatenate([[0.0], np.cumsum(figures)])
    at = np.arange(len(figures))
    first, last = np.maximum(at - width, 0), np.minimum(at + width + 1, len(figures))
    smoothed: Floats = (sums[last] - sums[first]) / (last - first)
    return smoothed
