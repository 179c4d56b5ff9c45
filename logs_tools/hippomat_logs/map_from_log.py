"""The lidar sweeps and wheel odometry in a run's log, as the mapper wants them.

Decides which sweeps count and what of them is no wall: peers that said where they were. Knows records, no
map. The offline twin of hippomat_core/localization.py, for one robot's own log.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.config import Config
from hippomat_core.control.guard import is_whole
from hippomat_core.errors import LogError
from hippomat_core.slam.masking import masked
from hippomat_core.slam.odometry import Odometry, moved
from hippomat_core.slam.offline import Sweep
from hippomat_core.slam.pose2 import Pose
from hippomat_core.slam.steady_clock import SteadyClock
from hippomat_core.slam.sweep import SAMPLE_NS, deskewed
from hippomat_core.wire.frames import FLAG_LOCALIZED
from hippomat_logs.reader import Run

TAKEN = (m.PortOpened, m.BaseFeedback, m.ScanReceived, m.StateHeard, m.SendState, m.PoseEstimated)


@dataclass(slots=True)
class SweepCount:
    """What became of the sweeps so far."""

    taken: int = 0
    broken: int = 0  # with holes where samples were lost
    last_ns: int = 0  # stamp of the newest one


@dataclass(slots=True)
class _Memory:
    """What of earlier records matters for the next sweep."""

    odometry: Odometry
    samples: SteadyClock = field(default_factory=lambda: SteadyClock(SAMPLE_NS))
    pose: Pose | None = None  # in the map of the run, where it had one
    digest: int | None = None  # the fleet digest that we sent
    peers: dict[int, m.StateHeard] = field(default_factory=dict)


def sweeps_of(run: Run, count: SweepCount | None = None) -> Iterator[Sweep]:
    """Deskewed sweeps in the base frame with their odometry poses, whose frame begins at the start pose.

    Raises LogError where the log has no lidar sweeps. Without any frame of the base the poses are None.
    """
    count = count if count is not None else SweepCount()
    config = run.config
    with_odometry = any(True for _ in run.records_in_order((m.BaseFeedback,)))
    start = config.robot
    memory = _Memory(Odometry(start.start_x_m, start.start_y_m, start.start_yaw_rad))
    for record in run.records_in_order(TAKEN):
        message = record.message
        if not isinstance(message, m.ScanReceived):
            _remember(memory, message)
            continue
        memory.samples = memory.samples.after(message.stamp_ns, max(len(message.angle_q6), 1))
        if not is_whole(message):
            count.broken += 1
            continue
        points, odom, _ = deskewed(message, memory.samples, memory.odometry, config.lidar)
        if memory.pose is not None:
            peers_m = _peers_m(memory, message.stamp_ns, config)
            points = masked(points, memory.pose, peers_m, config.robot.radius_m)
        if len(points):
            count.taken, count.last_ns = count.taken + 1, message.stamp_ns
            yield points, np.array(odom) if with_odometry else None, message.stamp_ns
    if not count.taken:
        raise LogError(
            f"{run.name}: no whole lidar sweep was recorded ({count.broken} broken ones): a map needs the "
            "log of a robot with a serial lidar"
        )


def _remember(memory: _Memory, message: object) -> None:
    if isinstance(message, m.BaseFeedback):
        memory.odometry = moved(memory.odometry, message)
    elif isinstance(message, m.PortOpened) and message.port == m.BASE:  # its counters may have begun anew
        memory.odometry = replace(memory.odometry, last=None)
    elif isinstance(message, m.PoseEstimated):
        memory.pose = (message.x_m, message.y_m, message.yaw_rad)
    elif isinstance(message, m.SendState):
        memory.digest = message.frame.fleet_digest
    elif isinstance(message, m.StateHeard):
        memory.peers[message.header.sender] = message


def _peers_m(memory: _Memory, now_ns: int, config: Config) -> NDArray[np.float64]:
    """(k, 2) [m]: where peers with our map said that they were, not long ago."""
    fresh_ns = config.planning.peer_stale_s * 1e9
    at = [
        (heard.frame.x_cm / 100, heard.frame.y_cm / 100)
        for heard in memory.peers.values()
        if heard.frame.fleet_digest == memory.digest
        and heard.frame.flags & FLAG_LOCALIZED
        and now_ns - heard.stamp_ns <= fresh_ns
    ]
    return np.array(at).reshape(-1, 2)
