"""A lidar's sweep by degrees, as ROS has it. Decides which return stands for a degree.

Compiled, because a sweep comes ten times a second beside a control loop: by NumPy it takes twenty times as
long.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

SCAN_BINS = 360
_Q2_PER_M = np.float32(4000.0)


@njit(cache=True, nogil=True)
def nearest_by_degree(
    angle_q6: NDArray[np.uint16],
    distance_q2: NDArray[np.uint16],
    quality: NDArray[np.uint8],
    range_m: NDArray[np.float32],
    intensity: NDArray[np.float32],
) -> None:
    """Fill range_m and intensity, (360,) each, from the (n,) each of a sweep: the nearest return and the
    quality of the last one, inf and 0 where there is none. A lidar counts clockwise, ROS counter-clockwise.

    angle_q6: degrees * 64; distance_q2: millimetres * 4, 0 for no return.
    """
    range_m[:] = np.inf
    intensity[:] = 0.0
    for k in range(min(len(angle_q6), len(distance_q2), len(quality))):  # no loop of numba's looks at bounds
        if distance_q2[k] != 0:
            degree = (SCAN_BINS - ((np.int64(angle_q6[k]) + 32) >> 6)) % SCAN_BINS
            range_m[degree] = min(range_m[degree], np.float32(distance_q2[k]) / _Q2_PER_M)
            intensity[degree] = quality[k]
