"""What re-runs are compared by: a few figures of a fleet's run, their distribution, differences of pairs.

Definitions of the figures are those of `hippomat-logs metrics`. Statistics: percentiles of the recorded value
among the re-runs; of paired differences the mean with a bootstrap interval (BCa, Efron 1987).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap, percentileofscore

from hippomat_logs.metrics import FleetMetrics
from hippomat_logs.metrics.figures import Figure, per_task
from hippomat_logs.metrics.samples import mean

Values = dict[str, float]  # by Figure.key
CONFIDENCE = 0.95
FEWEST_RERUNS = 20  # fewer are no distribution that a recorded value could lie outside of
FEWEST_PAIRS = 10  # of fewer, resampling makes intervals that are much too narrow
VARIES = 1e-9  # what varies by less is equal but for how sums are rounded


FIGURES = (
    Figure("completed", "tasks completed", "", 0, lambda metrics: float(len(metrics.completed))),
    Figure("travel_cost_s", "total travel cost", "s", 1, lambda metrics: metrics.travel_cost_s),
    Figure("cost_per_task_s", "travel cost per task", "s", 2, per_task(lambda one: one.travel_cost_s)),
    Figure("conflicts", "conflicts", "", 0, lambda metrics: float(sum(metrics.conflicts.values()))),
    Figure("cf1", "conflict-free rate CF1", "", 3, lambda metrics: metrics.conflict_free_rate),
    Figure("allocation_s", "allocation time, mean", "s", 2, lambda metrics: mean(metrics.allocation_s)),
    Figure("driven_m", "way driven", "m", 1, lambda metrics: metrics.driven_m),
)


def values_of(metrics: FleetMetrics) -> Values:
    """All figures of one run."""
    return {figure.key: float(figure.of(metrics)) for figure in FIGURES}


@dataclass(frozen=True, slots=True)
class Distribution:
    """One figure over the re-runs, and the recorded run's value among them."""

    figure: Figure
    values: NDArray[np.float64]  # (n,) that are numbers
    recorded: float

    @property
    def quantiles(self) -> tuple[float, float, float]:
        """5 %, median, 95 %; nan where there is nothing."""
        if not len(self.values):
            return math.nan, math.nan, math.nan
        low, middle, high = np.percentile(self.values, (5, 50, 95)).tolist()
        return low, middle, high

    @property
    def percentile(self) -> float:
        """Share of the re-runs below the recorded value, ties half [%]; nan where there is none."""
        if math.isnan(self.recorded) or not len(self.values):
            return math.nan
        return float(percentileofscore(self.values, self.recorded, kind="mean"))

    @property
    def outside(self) -> bool:
        """The recorded value is beyond all re-runs."""
        return len(self.values) > 0 and not (
            math.isnan(self.recorded) or self.values.min() <= self.recorded <= self.values.max()
        )


def distributions(reruns: Sequence[Values], recorded: Values) -> list[Distribution]:
    """One per figure."""
    found = []
    for figure in FIGURES:
        column = np.array([values[figure.key] for values in reruns])
        found.append(Distribution(figure, column[~np.isnan(column)], recorded[figure.key]))
    return found


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """other - recorded allocator's, seed by seed."""

    figure: Figure
    pairs: int
    recorded: float  # means over the pairs
    other: float
    difference: float
    low: float  # of the 95 % interval
    high: float

    @property
    def distinguishable(self) -> bool:
        """The interval holds no zero."""
        return self.low > 0.0 or self.high < 0.0


def paired_differences(reruns: Sequence[Values], others: Sequence[Values]) -> list[PairedDifference]:
    """One per figure. reruns, others: of the same seeds, in the same order."""
    found = []
    for figure in FIGURES:
        pairs = np.array([(a[figure.key], b[figure.key]) for a, b in zip(reruns, others, strict=True)])
        pairs = pairs.reshape(-1, 2)
        pairs = pairs[~np.isnan(pairs).any(axis=1)]
        if not len(pairs):
            found.append(PairedDifference(figure, 0, *(math.nan,) * 5))
            continue
        differences = pairs[:, 1] - pairs[:, 0]
        before, after = pairs.mean(axis=0).tolist()
        interval = mean_interval(differences)
        found.append(
            PairedDifference(figure, len(pairs), before, after, float(differences.mean()), *interval)
        )
    return found


def mean_interval(values: NDArray[np.float64]) -> tuple[float, float]:
    """95 % interval of the mean, of enough values. The same values give the same interval."""
    if len(values) < FEWEST_PAIRS:
        return math.nan, math.nan
    if np.ptp(values) < VARIES:  # nothing to resample
        return float(values[0]), float(values[0])
    found = bootstrap((values,), np.mean, confidence_level=CONFIDENCE, rng=np.random.default_rng(1))
    low, high = found.confidence_interval
    return float(low), float(high)
