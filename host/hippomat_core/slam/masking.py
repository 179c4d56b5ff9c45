"""Leave out of a scan what is no wall: returns from peers that say where they are.

For matching and mapping only; the scan guard sees everything.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.slam.pose2 import Pose, inverse
from hippomat_core.slam.poses import placed

MARGIN_M = 0.15  # their pose and ours are not exact, and theirs is a moment old


def masked(
    points: NDArray[np.float64], pose: Pose, peers_m: NDArray[np.float64], radius_m: float
) -> NDArray[np.float64]:
    """The returns (n, 2) [m], base frame, that are on no peer.

    pose: of the base in the map   peers_m: (k, 2) [m] in the map   radius_m: of a peer
    """
    if not len(peers_m) or not len(points):
        return points
    xy = placed(peers_m, inverse(pose))
    away_m = np.hypot(points[:, None, 0] - xy[None, :, 0], points[:, None, 1] - xy[None, :, 1])
    return points[(away_m > radius_m + MARGIN_M).all(axis=1)]
