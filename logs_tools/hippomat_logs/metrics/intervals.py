"""Means over trials with 95 % intervals. Knows numbers, not what they are of.

Student's t over trials: it asks that trials are independent and nearly normal, and covers well from three
trials on, where a percentile bootstrap of so few is too narrow. One trial has no interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

LEVEL = 0.95


@dataclass(frozen=True, slots=True)
class Interval:
    """mean ± half; half is nan for one value, both are for none."""

    mean: float
    half: float
    n: int


def mean_interval(values: Sequence[float]) -> Interval:
    """Of the values that are numbers."""
    known = np.array([value for value in values if not math.isnan(value)])
    if not known.size:
        return Interval(math.nan, math.nan, 0)
    if known.size == 1:
        return Interval(float(known[0]), math.nan, 1)
    error = float(known.std(ddof=1)) / math.sqrt(known.size)
    half = float(stats.t.ppf((1.0 + LEVEL) / 2.0, known.size - 1)) * error
    return Interval(float(known.mean()), half, int(known.size))
