"""Pairs of runs that heard each other: which frames both know, and how their clocks stand to each other.

Decides what a link proves. Lateness is never negative, so the least late frames of each way bound the
difference of the clocks from one side; with both ways it lies between, with one it is guessed within AIR_NS.
Knows frames and clocks, not logs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from hippomat_logs.clock_map import FEW_BINS, ClockMap, FittedLine, Floats, Times, fit_least_late, thinned
from hippomat_logs.radio_traffic import Frames, Traffic

AIR_NS = 1_000_000.0  # from the sender's stamp to the receiver's, at most, of a frame that nothing held up
LEAST_PAIRS = 3  # a link of fewer frames is none


@dataclass(frozen=True, slots=True)
class Pairs:
    """Frames one way, on the logs' own clocks."""

    sent_ns: Times  # (n,) the sender's
    heard_ns: Times  # (n,) the receiver's
    heard_numbers: Times  # (n,) records of the receiver
    sent_numbers: Times  # (n,) of the sender


@dataclass(frozen=True, slots=True)
class Link:
    """Two runs, by their place among all; map: the first one's clock -> the second one's."""

    first: int
    second: int
    there: Pairs  # sent by the first
    back: Pairs
    map: ClockMap
    ways: tuple[FittedLine, ...]  # of one way or both
    half_ns: float  # half the width of what both ways leave open

    @property
    def pairs(self) -> int:
        return len(self.there.sent_ns) + len(self.back.sent_ns)

    def uncertainty_ns(self, run: int, span_ns: tuple[int, int]) -> float:
        """Of the map, anywhere in `span_ns` of the log times of `run`, the first or the second."""
        ends_ns = np.array(span_ns, np.int64)
        if run == self.second:
            ends_ns = self.map.inverse(ends_ns)
        since_ns = (ends_ns - self.map.origin_ns).tolist()
        return self.half_ns + max(way.uncertainty_ns(x) for way in self.ways for x in since_ns)

    def lateness_ns(self, first: ClockMap, second: ClockMap) -> Floats:
        """(pairs,) from sent to heard, in the common time that the two maps lead to."""
        there = second(self.there.heard_ns) - first(self.there.sent_ns)
        back = first(self.back.heard_ns) - second(self.back.sent_ns)
        return _floats(np.concatenate([there, back]))


def links_between(traffic: Sequence[Traffic]) -> list[Link]:
    """All links; a frame that two runs claim to have sent is nobody's."""
    sent = _unambiguous([one.sent for one in traffic])
    links = []
    for a, b in combinations(range(len(traffic)), 2):
        there, back = _matched(sent[a], traffic[b].heard), _matched(sent[b], traffic[a].heard)
        if len(there.sent_ns) + len(back.sent_ns) >= LEAST_PAIRS:
            links.append(_link(a, b, there, back))
    return links


def _unambiguous(sent: Sequence[Frames]) -> list[Frames]:
    keys, counts = np.unique(np.concatenate([one.keys for one in sent]), return_counts=True)
    twice = keys[counts > 1]
    if not len(twice):
        return list(sent)
    return [one.where(~np.isin(one.keys, twice)) for one in sent]


def _matched(sent: Frames, heard: Frames) -> Pairs:
    if not len(sent.keys) or not len(heard.keys):
        nothing = np.empty(0, np.int64)
        return Pairs(nothing, nothing, nothing, nothing)
    place = np.searchsorted(sent.keys, heard.keys).clip(max=len(sent.keys) - 1)
    both: NDArray[np.bool_] = sent.keys[place] == heard.keys
    place = place[both]
    return Pairs(sent.air_ns[place], heard.air_ns[both], heard.numbers[both], sent.numbers[place])


def _link(a: int, b: int, there: Pairs, back: Pairs) -> Link:
    """The lines of both ways on the first one's clock; their lateness turns the sign of the second."""
    one = there if len(there.sent_ns) else back
    at_ns = one.sent_ns if one is there else one.heard_ns
    origin_ns = int(at_ns[0])
    shift_ns = int((one.heard_ns if one is there else one.sent_ns)[0]) - origin_ns
    lines: list[tuple[float, FittedLine]] = []
    if len(there.sent_ns):
        late = there.heard_ns - there.sent_ns - shift_ns
        lines.append((1.0, fit_least_late(_floats(there.sent_ns - origin_ns), _floats(late))))
    if len(back.sent_ns):
        late = back.heard_ns - back.sent_ns + shift_ns
        lines.append((-1.0, fit_least_late(_floats(back.heard_ns - origin_ns), _floats(late))))
    if (
        len({line.bins >= FEW_BINS for _, line in lines}) == 2
    ):  # a way of a few frames says nothing of the drift
        lines = [one for one in lines if one[1].bins >= FEW_BINS]
    knots = thinned(np.concatenate([line.knots_ns for _, line in lines]))
    bounds = [sign * line(knots) for sign, line in lines]
    if len(lines) == 2:
        extras, half_ns = (bounds[0] + bounds[1]) / 2, float(np.abs(bounds[0] - bounds[1]).max()) / 2
    else:
        extras, half_ns = bounds[0] - lines[0][0] * AIR_NS / 2, AIR_NS / 2
    map_ = ClockMap(origin_ns, shift_ns, knots, extras)
    return Link(a, b, there, back, map_, tuple(line for _, line in lines), half_ns)


def _floats(values: Times) -> Floats:
    return values.astype(np.float64)
