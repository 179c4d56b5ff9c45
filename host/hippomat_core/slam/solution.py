"""What closing loops gives: all poses, all loop links, the map cast again. A value that can be recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.slam.pose_graph import Links
from hippomat_core.slam.ray_cast import Evidence


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """For the first n keyframes of the graph it was asked about."""

    epoch: int  # of the map with it
    poses: NDArray[np.float64]  # (n, 3) in the map frame
    loops: Links
    searched: int
    evidence: Evidence
