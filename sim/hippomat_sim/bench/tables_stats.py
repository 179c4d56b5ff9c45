"""Estimates with 95 % intervals: percentile bootstrap over instances, the same draws for every method.

Because all methods meet the same instances and the same draws, differences between them are paired.
A figure that was the same in all instances has an interval of no width: the bootstrap knows no other world.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

RESAMPLES = 1000
_SEED = 20250
_EDGES = (2.5, 97.5)  # per cent: a 95 % interval


@dataclass(frozen=True, slots=True)
class Estimate:
    """A figure and its 95 % interval; NaN where there was nothing to count."""

    value: float
    low: float
    high: float
    count: int  # instances

    def scaled(self, factor: float, offset: float = 0.0) -> Estimate:
        """factor * x + offset of everything; factor > 0."""
        value, low, high = (factor * x + offset for x in (self.value, self.low, self.high))
        return Estimate(value, low, high, self.count)


NOTHING = Estimate(float("nan"), float("nan"), float("nan"), 0)


@lru_cache(maxsize=32)
def _weights(count: int) -> NDArray[np.float64]:
    """(RESAMPLES, count): how often each instance is drawn."""
    random = np.random.default_rng((_SEED, count))
    return random.multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES).astype(np.float64)


def _ratios(parts: ArrayLike, wholes: ArrayLike) -> tuple[float, NDArray[np.float64]]:
    """The ratio of the sums, and that of every resample (RESAMPLES,)."""
    over, under = np.asarray(parts, np.float64), np.asarray(wholes, np.float64)
    weights = _weights(len(over))
    with np.errstate(invalid="ignore", divide="ignore"):
        return float(over.sum() / under.sum()), (weights @ over) / (weights @ under)


def _estimate(value: float, resampled: NDArray[np.float64], count: int) -> Estimate:
    low, high = np.percentile(resampled, _EDGES)
    return Estimate(value, float(low), float(high), count)


def ratio(parts: ArrayLike, wholes: ArrayLike) -> Estimate:
    """Sum of parts over sum of wholes, both (B,): shares, costs per task, costs over other costs."""
    count = len(np.asarray(parts))
    if count == 0 or not np.any(np.asarray(wholes)):
        return NOTHING
    return _estimate(*_ratios(parts, wholes), count)


def mean(values: ArrayLike) -> Estimate:
    """Mean over the instances, (B,)."""
    return ratio(values, np.ones(len(np.asarray(values))))


def ratio_of_ratios(
    parts: ArrayLike, wholes: ArrayLike, other_parts: ArrayLike, other_wholes: ArrayLike
) -> Estimate:
    """(sum parts / sum wholes) over the same of another method on the same instances."""
    count = len(np.asarray(parts))
    if count == 0 or not (np.any(np.asarray(wholes)) and np.any(np.asarray(other_parts))):
        return NOTHING
    value, resampled = _ratios(parts, wholes)
    other, other_resampled = _ratios(other_parts, other_wholes)
    return _estimate(value / other, resampled / other_resampled, count)


def difference(
    parts: ArrayLike, wholes: ArrayLike, other_parts: ArrayLike, other_wholes: ArrayLike
) -> Estimate:
    """(sum parts / sum wholes) minus the same of another method on the same instances."""
    count = len(np.asarray(parts))
    if count == 0 or not (np.any(np.asarray(wholes)) and np.any(np.asarray(other_wholes))):
        return NOTHING
    value, resampled = _ratios(parts, wholes)
    other, other_resampled = _ratios(other_parts, other_wholes)
    return _estimate(value - other, resampled - other_resampled, count)
