"""Time two callables in turn, A B A B ..., so that a drifting machine touches both alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Result:
    """Medians per call, in microseconds; ratio = the peer's time over ours, median of the pairs."""

    case: str
    ours_us: float
    peer: str
    peer_us: float
    ratio: float

    def as_dict(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in self.__slots__}


def compare(
    case: str, ours: Callable[[], object], peer: str, theirs: Callable[[], object], pairs: int = 15
) -> Result:
    """Both are warmed once; each pair runs both for about as long."""
    ours(), theirs()
    counts = _calls_for(ours), _calls_for(theirs)
    times = [(_per_call_us(ours, counts[0]), _per_call_us(theirs, counts[1])) for _ in range(pairs)]
    return Result(
        case,
        statistics.median(a for a, _ in times),
        peer,
        statistics.median(b for _, b in times),
        statistics.median(b / a for a, b in times),
    )


def _calls_for(call: Callable[[], object], seconds: float = 0.02) -> int:
    return max(1, round(seconds / max(_per_call_us(call, 1) / 1e6, 1e-7)))


def _per_call_us(call: Callable[[], object], calls: int) -> float:
    begun = time.perf_counter_ns()
    for _ in range(calls):
        call()
    return (time.perf_counter_ns() - begun) / calls / 1000
