"""Random numbers inside compiled loops: one splitmix64 stream (Steele 2014) per copy of an environment.

A stream depends on its seed alone, so a copy draws the same whatever the other copies do.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.allocation.pure_hash import pure_hash

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S11, _S27, _S30, _S31, _S33 = (np.uint64(bits) for bits in (11, 27, 30, 31, 33))
_UNIT = 1.0 / (1 << 53)


def streams(count: int, *seed: int) -> NDArray[np.uint64]:
    """(count,) states: stream k of a seed is the same for any count."""
    return np.array([pure_hash(*seed, copy) for copy in range(count)], np.uint64)


@njit(nogil=True, inline="always")
def draw(states: NDArray[np.uint64], stream: int) -> np.uint64:
    """64 random bits."""
    states[stream] += _GOLDEN
    bits = states[stream]
    bits = (bits ^ (bits >> _S30)) * _FIRST
    bits = (bits ^ (bits >> _S27)) * _SECOND
    mixed: np.uint64 = bits ^ (bits >> _S31)
    return mixed


@njit(nogil=True, inline="always")
def draw_below(states: NDArray[np.uint64], stream: int, bound: int) -> int:
    """An integer in 0 .. bound - 1; bound below 2^16, where the bias is below 2^-15 of a value's share."""
    return int(((draw(states, stream) >> _S33) * np.uint64(bound)) >> _S31)


@njit(nogil=True, inline="always")
def draw_unit(states: NDArray[np.uint64], stream: int) -> float:
    """Uniform in [0, 1)."""
    return float(draw(states, stream) >> _S11) * _UNIT
