"""The poses that agree best with all links: Levenberg-Marquardt on a pose graph, by GTSAM.

GTSAM (Dellaert, Kaess 2017) is an extra and is loaded when first needed. Knows poses and links, no scans.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import ConfigError
from hippomat_core.slam.pose_graph import Links

ROBUST_K = 1.0  # a loop link that is off by more than this many standard deviations pulls less (Cauchy)
FIXED_SIGMA = 1e-4  # [m], [rad] the first pose stays where it is


def solved_poses(poses: NDArray[np.float64], steps: Links, loops: Links) -> NDArray[np.float64]:
    """(n, 3) the poses at the optimum near `poses`; pose 0 stays, wrong loop links are outvoted.

    Raises ConfigError where GTSAM is not installed.
    """
    gtsam = load_gtsam()
    graph, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k, pose in enumerate(poses):
        start.insert(k, gtsam.Pose2(*pose))
    fixed = gtsam.noiseModel.Isotropic.Sigma(3, FIXED_SIGMA)
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*poses[0]), fixed))
    _add(gtsam, graph, steps, None)
    _add(gtsam, graph, loops, gtsam.noiseModel.mEstimator.Cauchy.Create(ROBUST_K))
    found = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    return np.array([[at.x(), at.y(), at.theta()] for at in map(found.atPose2, range(len(poses)))])


def _add(gtsam: Any, graph: Any, links: Links, robust: Any) -> None:
    for k in range(len(links)):
        noise = gtsam.noiseModel.Gaussian.Information(links.information[k])
        if robust is not None:
            noise = gtsam.noiseModel.Robust.Create(robust, noise)
        first, second = int(links.first[k]), int(links.second[k])
        graph.add(gtsam.BetweenFactorPose2(first, second, gtsam.Pose2(*links.motion[k]), noise))


def load_gtsam() -> Any:
    """The module. Raises ConfigError where it is not installed."""
    try:
        import gtsam
    except ImportError as error:
        raise ConfigError(
            f"mapping needs GTSAM to close loops ({error}): pip install 'hippomat[slam]'"
        ) from None
    return gtsam
