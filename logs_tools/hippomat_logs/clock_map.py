"""One clock as a function of another: piecewise linear, out of many comparisons of which most are late.

Decides what a late comparison may spoil: nothing, as long as some in every few seconds are in time. Every
second gives its least late comparison. Below those of two minutes lies the line that leaves a fifth of them
under it (quantile regression, Koenker and Bassett 1978): the floor, but for the few that were stamped early.
The lines of longer runs are joined, for a crystal's rate follows its temperature.
Knows numbers, not logs. Times are int64 ns; what is fitted is measured from an origin, for a float64 has 53
bits and ten years have 59.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

BIN_NS = 1_000_000_000
WINDOW_BINS = 120
ANY_DRIFT = 400e-6  # between two clocks of which nothing is known: crystals are off by 200 ppm at most
FLOOR = 0.2  # of the seconds' least late comparisons lie under the line
FEW_BINS = 5  # make no line whose slope is worth more than ANY_DRIFT
LEAST_SPREAD_NS = 20_000.0  # a radio stamps microseconds, some of them late

Times = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ClockMap:
    """other = own + shift_ns + extra(own - origin_ns); extra is linear between its knots and beyond them."""

    origin_ns: int
    shift_ns: int
    knots_ns: Floats  # (k,) k >= 2, ascending, of own - origin_ns
    extras_ns: Floats  # (k,)

    def __call__(self, own_ns: Times) -> Times:
        since_ns = (own_ns - self.origin_ns).astype(np.float64)
        return own_ns + self.shift_ns + np.rint(self.extra_ns(since_ns)).astype(np.int64)

    def extra_ns(self, since_ns: Floats) -> Floats:
        return piecewise(self.knots_ns, self.extras_ns, since_ns)

    @property
    def inverse(self) -> ClockMap:
        return ClockMap(
            self.origin_ns + self.shift_ns, -self.shift_ns, self.knots_ns + self.extras_ns, -self.extras_ns
        )

    @property
    def drift(self) -> float:
        """By how much the other clock runs faster, over all knots."""
        return float((self.extras_ns[-1] - self.extras_ns[0]) / (self.knots_ns[-1] - self.knots_ns[0]))


def constant(shift_ns: int = 0) -> ClockMap:
    """Two clocks that differ by a number."""
    return ClockMap(0, shift_ns, np.array([0.0, 1.0]), np.zeros(2))


def piecewise(knots: Floats, values: Floats, at: Floats) -> Floats:
    """Linear between the knots (k,) k >= 2, and beyond them as at the ends. at: (n,) -> (n,)."""
    piece = np.clip(np.searchsorted(knots, at) - 1, 0, len(knots) - 2)
    slopes = np.diff(values) / np.diff(knots)
    return np.asarray(values[piece] + slopes[piece] * (at - knots[piece]))


def thinned(knots: Floats) -> Floats:
    """Sorted, no two nearer than a second: rounded values on them would make wild slopes. Keeps both ends."""
    knots = np.unique(knots)
    kept = [float(knots[0])]
    kept += [
        knot for knot in knots[1:-1].tolist() if knot - kept[-1] >= BIN_NS and knots[-1] - knot >= BIN_NS
    ]
    return np.array([*kept, max(float(knots[-1]), kept[-1] + BIN_NS)])


@dataclass(frozen=True, slots=True)
class FittedLine:
    """What comparisons say: a line per window, joined. Distances are from the comparisons' origin."""

    knots_ns: Floats
    extras_ns: Floats
    first_ns: float  # where the comparisons begin and end
    last_ns: float
    spread_ns: float  # of the seconds' least late comparisons about the line, where they are dense
    bins: int

    def __call__(self, since_ns: Floats) -> Floats:
        return piecewise(self.knots_ns, self.extras_ns, since_ns)

    def uncertainty_ns(self, since_ns: float) -> float:
        """Of the line there. Outside of the comparisons it grows by the uncertainty of its slope."""
        beyond_ns = max(self.first_ns - since_ns, since_ns - self.last_ns, 0.0)
        span_ns = max(self.last_ns - self.first_ns, 1.0)
        if self.bins < FEW_BINS:
            return self.spread_ns + ANY_DRIFT * (beyond_ns + span_ns)
        window_ns = min(span_ns, WINDOW_BINS * BIN_NS)
        return self.spread_ns * (1.0 + 2.0 * beyond_ns / window_ns)


def fit_least_late(since_ns: Floats, late_ns: Floats, slope: float | None = None) -> FittedLine:
    """The line of the comparisons that are least late, i.e. smallest. (n,) each, in any order, n >= 1.

    slope: of all lines, where it is known; None: each has its own.
    """
    at, least = least_of_bins(since_ns, late_ns)
    pieces = [
        (at[part], least[part]) for part in np.array_split(np.arange(len(at)), max(1, len(at) // WINDOW_BINS))
    ]
    lines = [floor_line(x, y) if slope is None else _level(x, y, slope) for x, y in pieces]
    first, last = float(at[0]), float(at[-1])
    if len(lines) == 1:
        knots = np.array([first, max(last, first + BIN_NS)])
        extras = lines[0](knots)
    else:
        middles = [float(times.mean()) for times, _ in pieces]
        knots = np.array([first, *middles, last])
        extras = np.array(
            [lines[0](first), *(f(x) for f, x in zip(lines, middles, strict=True)), lines[-1](last)]
        )
    off = np.concatenate([y - line(x) for (x, y), line in zip(pieces, lines, strict=True)])
    low, high = np.quantile(off, (FLOOR / 4, 2 * FLOOR))
    spread = max(float(high - low), LEAST_SPREAD_NS)
    return FittedLine(knots, extras, float(since_ns.min()), float(since_ns.max()), spread, len(at))


def common_slope(parts: Sequence[tuple[Floats, Floats]]) -> float | None:
    """Of comparisons in parts that are shifted against each other; None: they are too few to say."""
    bins = [least_of_bins(*part) for part in parts]
    bins = [one for one in bins if len(one[0]) > 1]
    if sum(len(at) - 1 for at, _ in bins) < FEW_BINS:
        return None
    which = np.concatenate([np.full(len(at), k) for k, (at, _) in enumerate(bins)])
    at = np.concatenate([at - at.mean() for at, _ in bins])
    values = np.concatenate([values - values.min() for _, values in bins])
    slope, _ = _floor(at / BIN_NS, values, np.eye(len(bins))[which])
    return slope / BIN_NS


def least_of_bins(since_ns: Floats, late_ns: Floats) -> tuple[Floats, Floats]:
    """The least late comparison of every second that has one, in order of time."""
    bins = np.floor_divide(since_ns - since_ns.min(), BIN_NS).astype(np.int64)
    order = np.lexsort((since_ns, late_ns, bins))
    first = np.unique(bins[order], return_index=True)[1]
    return since_ns[order][first], late_ns[order][first]


@dataclass(frozen=True, slots=True)
class Line:
    slope: float
    at: float
    value: float

    def __call__(self, x: Floats | float) -> Floats:
        return np.asarray(self.value + self.slope * (x - self.at))


def floor_line(at: Floats, values: Floats) -> Line:
    """(n,) each: the line with FLOOR of the values under it; level where they are few."""
    if len(at) < FEW_BINS:
        return _level(at, values, 0.0)
    middle = float(at.mean())
    slope, height = _floor((at - middle) / BIN_NS, values - values.min(), np.ones((len(at), 1)))
    return Line(slope / BIN_NS, middle, float(height[0] + values.min()))


def _level(at: Floats, values: Floats, slope: float) -> Line:
    middle = float(at.mean())
    return Line(slope, middle, float(np.quantile(values - slope * (at - middle), FLOOR)))


def _floor(x: Floats, values: Floats, groups: Floats) -> tuple[float, Floats]:
    """values (n,) = groups @ heights + slope * x + over - under, at the least weighted sum of over and under.

    groups: (n, g), ones and zeros. A linear program; its variables are positive, so slope and heights are
    differences of two.
    """
    scale, n, g = max(float(np.ptp(values)), 1.0), len(x), groups.shape[1]
    weights = np.concatenate([np.zeros(2 * g + 2), np.full(n, FLOOR), np.full(n, 1 - FLOOR)])
    terms = np.column_stack([x, -x, groups, -groups, np.eye(n), -np.eye(n)])
    found = linprog(weights, A_eq=terms, b_eq=values / scale).x * scale
    return float(found[0] - found[1]), found[2 : 2 + g] - found[2 + g : 2 + 2 * g]
