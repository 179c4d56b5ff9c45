"""By how much the clocks of simulated robots are wrong: every robot's host has its own, drawn from the seed.

A host's monotonic clock is ahead of the world's and drifts; its wall clock is off on top of that. The radios'
clocks have drifts of their own (devices/virtual_radio.py). The text is what hippomat_host/clock.py reads.
"""

from __future__ import annotations

import random
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

VARIABLE = "HIPPOMAT_CLOCK_ERROR"
YEAR_NS = 31_557_600 * 10**9
MAX_YEARS, MAX_PPM = 50.0, 500.0


@dataclass(frozen=True, slots=True)
class ClockError:
    """Of one host. drift_ppb: parts in 10^9 by which its clock is fast."""

    ahead_ns: int = 0  # monotonic, at the world's 0
    drift_ppb: int = 0
    wall_ahead_ns: int = 0

    @property
    def text(self) -> str:
        return f"{self.ahead_ns},{self.drift_ppb},{self.wall_ahead_ns}"

    def own_ns(self, world_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """The host's monotonic clock at these times of the world's clock; to the nanosecond."""
        whole, rest = np.divmod(world_ns, 10**9)  # the product of all would not fit into 64 bits
        gained_ns: NDArray[np.int64] = whole * self.drift_ppb + rest * self.drift_ppb // 10**9
        return world_ns + gained_ns + self.ahead_ns


RIGHT = ClockError()


def draw_clock_errors(robots: int, years: float, ppm: float, seed: int) -> tuple[ClockError, ...]:
    """Uniform: monotonic clocks ahead by up to `years`, wall clocks off by as much either way."""
    draw = random.Random(f"hippomat clocks {seed}")
    return tuple(
        ClockError(
            int(draw.random() * years * YEAR_NS),
            round(draw.uniform(-1, 1) * ppm * 1000),
            int(draw.uniform(-1, 1) * years * YEAR_NS),
        )
        for _ in range(robots)
    )
