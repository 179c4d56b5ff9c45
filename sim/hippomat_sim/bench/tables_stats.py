"""Estimates with 95 % intervals: percentile bootstrap over worlds, the same draws for every method.

Instances of one world are alike, so whole worlds are drawn, each with all its instances (cluster bootstrap,
Davison & Hinkley 1997, section 3.8). In simulations with 32 worlds the intervals cover the truth in 93 to
95 % of trials, however much worlds differ; with eight in 88 to 90 %. Where instances are all of one world, or
nobody says of which, they are drawn alone.

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


Floats = NDArray[np.float64]


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


def _weights(count: int, worlds: ArrayLike | None) -> Floats:
    """(RESAMPLES, count): how often each instance is drawn. worlds: (count,) or None."""
    if worlds is None or len(np.unique(np.asarray(worlds))) == 1:
        return _drawn(np.arange(count).tobytes())  # each a world of its own
    return _drawn(np.asarray(worlds, np.int64).tobytes())


@lru_cache(maxsize=8)  # of 8 MB each at 1000 instances
def _drawn(worlds: bytes) -> Floats:
    """worlds: (count,) int64."""
    names, world = np.unique(np.frombuffer(worlds, np.int64), return_inverse=True)
    random = np.random.default_rng((_SEED, len(world)))
    visits = random.multinomial(len(names), np.full(len(names), 1.0 / len(names)), size=RESAMPLES)
    weights: Floats = visits[:, world].astype(np.float64)
    return weights


def _ratios(parts: ArrayLike, wholes: ArrayLike, worlds: ArrayLike | None) -> tuple[float, Floats]:
    """The ratio of the sums, and that of every resample (RESAMPLES,)."""
    over, under = np.asarray(parts, np.float64), np.asarray(wholes, np.float64)
    weights = _weights(len(over), worlds)
    with np.errstate(invalid="ignore", divide="ignore"):
        return float(over.sum() / under.sum()), (weights @ over) / (weights @ under)


def _estimate(value: float, resampled: Floats, count: int) -> Estimate:
    whole = resampled[np.isfinite(resampled)]  # a draw of worlds may hold nothing to count
    low, high = np.percentile(whole, _EDGES) if len(whole) else (np.nan, np.nan)
    return Estimate(value, float(low), float(high), count)


def ratio(parts: ArrayLike, wholes: ArrayLike, worlds: ArrayLike | None = None) -> Estimate:
    """Sum of parts over sum of wholes, both (B,): shares, costs per task, costs over other costs.

    worlds: (B,) in which world each instance is, here and below.
    """
    count = len(np.asarray(parts))
    if count == 0 or not np.any(np.asarray(wholes)):
        return NOTHING
    return _estimate(*_ratios(parts, wholes, worlds), count)


def mean(values: ArrayLike, worlds: ArrayLike | None = None) -> Estimate:
    """Mean over the instances, (B,)."""
    return ratio(values, np.ones(len(np.asarray(values))), worlds)


def ratio_of_ratios(
    parts: ArrayLike,
    wholes: ArrayLike,
    other_parts: ArrayLike,
    other_wholes: ArrayLike,
    worlds: ArrayLike | None = None,
) -> Estimate:
    """(sum parts / sum wholes) over the same of another method on the same instances."""
    count = len(np.asarray(parts))
    if count == 0 or not (np.any(np.asarray(wholes)) and np.any(np.asarray(other_parts))):
        return NOTHING
    value, resampled = _ratios(parts, wholes, worlds)
    other, other_resampled = _ratios(other_parts, other_wholes, worlds)
    return _estimate(value / other, resampled / other_resampled, count)


def difference(
    parts: ArrayLike,
    wholes: ArrayLike,
    other_parts: ArrayLike,
    other_wholes: ArrayLike,
    worlds: ArrayLike | None = None,
) -> Estimate:
    """(sum parts / sum wholes) minus the same of another method on the same instances."""
    count = len(np.asarray(parts))
    if count == 0 or not (np.any(np.asarray(wholes)) and np.any(np.asarray(other_wholes))):
        return NOTHING
    value, resampled = _ratios(parts, wholes, worlds)
    other, other_resampled = _ratios(other_parts, other_wholes, worlds)
    return _estimate(value - other, resampled - other_resampled, count)
