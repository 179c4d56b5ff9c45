"""A picture of how well the radios' fleet times agreed over a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hippomat_sim.bench.radio_run import OurFigures
from hippomat_sim.bench.radio_settings import RadioSettings
from hippomat_sim.bench.radio_targets import MAX_AGREEMENT_US

_COLUMNS = 600  # of samples that are drawn: each the median and the maximum of its stretch


def draw(settings: RadioSettings, ours: OurFigures, path: Path) -> None:
    """Write the file; its suffix says of which kind. No samples: a picture without a curve."""
    figure = Figure(figsize=(9.0, 4.2), dpi=150, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.085, 0.13, 0.89, 0.71))
    samples = len(ours.times_s)
    stretches = np.array_split(np.arange(samples), min(_COLUMNS, samples)) if samples else []
    times_s = np.array([ours.times_s[stretch[0]] for stretch in stretches])
    median_us = np.array([np.median(ours.spreads_us[stretch]) for stretch in stretches])
    highest_us = np.array([ours.spreads_us[stretch].max() for stretch in stretches])
    axes.fill_between(times_s, median_us, highest_us, color="#9ecae1", label="up to the maximum", linewidth=0)
    axes.plot(times_s, median_us, color="#0072B2", linewidth=1.0, label="median")
    axes.axhline(MAX_AGREEMENT_US, color="#D55E00", linewidth=1.2, linestyle="--", label="target")
    axes.set_xlim(0, max(float(ours.times_s.max(initial=0)), 1.0))
    axes.set_ylim(0, 1.25 * max(MAX_AGREEMENT_US, float(ours.spreads_us.max(initial=0))))
    axes.set_xlabel("time since the fleet settled [s]")
    axes.set_ylabel("widest difference of fleet time [us]")
    axes.grid(color="#e5e5e5", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="upper right", frameon=False, ncols=3, fontsize=9)
    figure.text(0.085, 0.94, _title(settings), fontsize=12, fontweight="bold", va="center")
    figure.text(0.085, 0.885, _subtitle(settings, ours), fontsize=9, color="#555555", va="center")
    figure.savefig(path)


def _title(settings: RadioSettings) -> str:
    return f"{settings.nodes} radios without a master agree on the time"


def _subtitle(settings: RadioSettings, ours: OurFigures) -> str:
    return (
        f"clocks off by up to {settings.drift_ppm:g} ppm, {settings.loss:.0%} loss, {settings.hidden:.0%} of "
        f"the pairs hidden, {settings.late:.0%} of the frames late, {ours.faults} faults"
    )
