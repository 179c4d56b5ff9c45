"""Many numbers in little memory: all of them up to a bound, then every second, every fourth ...

Count, sum and extremes are of all numbers; quantiles are of those kept. Nothing is drawn at random: the same
log gives the same figures.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

CAPACITY = 1 << 16  # of 20 values a second: all of the first 54 minutes


class Samples:
    """Numbers as they come; 4 bytes for each that is kept."""

    def __init__(self, values: Iterable[float] = (), capacity: int = CAPACITY) -> None:
        self._kept = array("f")
        self._capacity = capacity
        self._stride = 1
        self.count = 0
        self.total = 0.0
        self.low, self.high = math.inf, -math.inf
        self.extend(values)

    def add(self, value: float) -> None:
        if self.count % self._stride == 0:
            self._kept.append(value)
            if len(self._kept) == self._capacity:
                self._kept = self._kept[::2]
                self._stride *= 2
        self.count += 1
        self.total += value
        self.low, self.high = min(self.low, value), max(self.high, value)

    def extend(self, values: Iterable[float]) -> None:
        for value in values:
            self.add(value)

    @property
    def kept(self) -> NDArray[np.float32]:
        """(n,) in the order they came; a copy."""
        return np.array(self._kept, np.float32)

    @property
    def mean(self) -> float:
        """nan where there are none."""
        return self.total / self.count if self.count else math.nan

    def quantile(self, share: float) -> float:
        """nan where there are none."""
        return float(np.quantile(self.kept, share)) if self.count else math.nan


def together(several: Sequence[Samples]) -> NDArray[np.float64]:
    """The kept numbers of all, each thinned alike, so that no long run is under-represented."""
    stride = max((one._stride for one in several), default=1)
    parts = [one.kept[:: stride // one._stride] for one in several]
    return np.concatenate(parts).astype(np.float64) if parts else np.empty(0)


def quantiles(values: ArrayLike | Samples) -> tuple[float, float, float]:
    """(median, mean, 95th percentile); nan where there are no values."""
    array_ = np.asarray(values.kept if isinstance(values, Samples) else values, np.float64)
    if not array_.size:
        return math.nan, math.nan, math.nan
    return float(np.median(array_)), float(array_.mean()), float(np.percentile(array_, 95))


def mean(values: Iterable[float]) -> float:
    """Of those that are numbers; nan where none is."""
    known = [value for value in values if not math.isnan(value)]
    return sum(known) / len(known) if known else math.nan
