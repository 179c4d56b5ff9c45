"""Travel costs as one byte: q = round(254 sqrt(c / c_max)), 255 = unreachable. Knows seconds, not paths.

The square root gives near tasks the fine steps: at c_max = 25 s a step is 0.01 s at 0.4 s and 0.2 s at 25 s.
A robot decides on exactly the codes it broadcasts.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from hippomat_core.wire.frames import UNREACHABLE

FULL_SCALE = 254


def quantise(costs_s: ArrayLike, c_max_s: float) -> NDArray[np.uint8]:
    """Codes of travel costs [s]; inf or NaN = unreachable, more than c_max_s saturates at 254."""
    if not c_max_s > 0.0:
        raise ValueError(f"c_max_s = {c_max_s!r} must be above 0; set [fleet] c_max_s or give a map")
    costs = np.asarray(costs_s, np.float64)
    return _codes(costs.ravel(), c_max_s).reshape(costs.shape)


@njit(cache=True, nogil=True)
def _codes(costs_s: NDArray[np.float64], c_max_s: float) -> NDArray[np.uint8]:
    codes = np.full(len(costs_s), UNREACHABLE, np.uint8)
    for k in range(len(costs_s)):
        if math.isfinite(costs_s[k]):
            share = min(max(costs_s[k] / c_max_s, 0.0), 1.0)
            codes[k] = np.uint8(np.rint(FULL_SCALE * math.sqrt(share)))
    return codes


def dequantise(codes: NDArray[np.uint8], c_max_s: float) -> NDArray[np.float64]:
    """Travel costs [s] of the codes' centres; inf where unreachable."""
    costs = c_max_s * np.square(codes.astype(np.float64) / FULL_SCALE)
    return np.where(codes == UNREACHABLE, np.inf, costs)


def saturated(costs_s: ArrayLike, c_max_s: float) -> NDArray[np.bool_]:
    """True where a reachable cost is above c_max_s: its code says less than the truth."""
    costs = np.asarray(costs_s, np.float64)
    return np.isfinite(costs) & (costs > c_max_s)
