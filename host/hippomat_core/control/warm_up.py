"""Two made-up control steps before the first real one: what numba compiles must not stall a moving robot."""

from __future__ import annotations

import numpy as np

from hippomat_core.allocation.quantise import quantise
from hippomat_core.config import Config
from hippomat_core.control.follower import Motion
from hippomat_core.control.guard import (
    HOLE_Q6,
    TURN_Q6,
    carried_along,
    guard,
    hidden_points,
    is_whole,
    returns,
    scan_points,
)
from hippomat_core.control.nav_state import Navigator
from hippomat_core.control.navigator import navigate
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import ScanReceived
from hippomat_core.planning.costmap import inflate
from hippomat_core.planning.reservations import PeerMotion, decode_intent, encode_intent


def warm_up(config: Config) -> None:
    """A path across an empty room, another robot in it, and something seen beside the path."""
    costmap = inflate(OccupancyGrid(np.zeros((40, 40), np.int8), 0.05, 0.0, 0.0), 0.17)
    here, goal, nav = Motion(0.9, 1.0, 0.0), (1.6, 1.0), Navigator()
    told = np.frombuffer(bytes(3), np.uint8)  # as frames give it: read-only
    other = PeerMotion(1, 0.5, 1.5, 0.1, 0.1, decode_intent(10, 30, told), None)
    for tick in range(2):  # the first one plans
        nav, outcome = navigate(nav, tick * 50_000_000, here, goal, [other], costmap, None, config)
    encode_intent(outcome.intent)
    quantise(np.zeros(1), 1.0)
    angle_q6 = np.arange(0, TURN_Q6, HOLE_Q6, np.uint16)
    scan = ScanReceived(
        0, np.zeros(len(angle_q6), np.uint8), angle_q6, np.full(len(angle_q6), 1700, np.uint16)
    )
    is_whole(scan)
    returns(scan, config.lidar)
    points = scan_points(scan, config.lidar)
    seen = np.concatenate([hidden_points(points, config.lidar), points])
    seen = carried_along(seen, (0.0, 0.0, 0.0), (0.0, 0.0, 0.1))
    peers = np.array([[0.5, 0.0, config.robot.radius_m]])
    for v_mps, wz_radps in ((0.1, 0.1), (0.0, 0.5)):  # along an arc, and in place
        guard(seen, v_mps, wz_radps, peers, config)
