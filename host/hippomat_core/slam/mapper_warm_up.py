"""Map a made-up room once, so that numba compiles before a scan waits for it. Closes no loop."""

from __future__ import annotations

import math

import numpy as np

from hippomat_core.slam.mapper import Mapper, empty_mapper

BEAMS = 90
TURN_RAD = math.radians(12.0)


def warm_up_mapper() -> Mapper:
    """Takes seconds to a minute where nothing was compiled yet; the mapper has a second keyframe."""
    bearing_rad = np.arange(BEAMS) * math.tau / BEAMS
    mapper = empty_mapper()
    for turned_rad in (0.0, TURN_RAD):
        heading = bearing_rad + turned_rad
        range_m = 2.0 / np.maximum(np.abs(np.cos(heading)), 0.7 * np.abs(np.sin(heading)))
        points = range_m[:, None] * np.stack([np.cos(bearing_rad), np.sin(bearing_rad)], axis=1)
        mapper, _ = mapper.with_scan(points, np.array([0.0, 0.0, turned_rad]), 0)
    return mapper
