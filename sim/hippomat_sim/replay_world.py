"""One recorded robot's world again, for replay level L3: its map, its body, its commands. Knows no logs.

Offered to hippomat_logs.level3 through the entry-point group hippomat.replay_worlds, and with it whole fleets
for level L4 (closed_loop.py). The base's answer to a command is the simulated base's own (Body); delays of a
real one show up as error, which is what L3 measures.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hippomat_core.config import Config
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import MapReceived
from hippomat_sim.closed_loop import run_closed_loop
from hippomat_sim.world import SUBSTEP_S, Body, World

Pose = tuple[float, float, float]  # x [m], y [m], yaw [rad], map frame
Command = tuple[float, float, float]  # time [s], v [m/s], wz [rad/s]


class PyBulletReplayWorld:
    """Built as PyBulletReplayWorld(config, map_received); closed at the end of the run."""

    closed_loop = staticmethod(run_closed_loop)

    def __init__(self, config: Config, map_received: MapReceived | None) -> None:
        body = Body(radius_m=config.robot.radius_m)
        self._world = World(_grid(map_received), [(0.0, 0.0, 0.0)], body)

    def drive(self, start: Pose, commands: Sequence[Command], sample_times_s: Sequence[float]) -> list[Pose]:
        """Poses at sample_times_s (ascending) of the robot that stands at `start` at time 0.

        commands: ascending, each holds until the next; the last one not after 0 is its motion at 0.
        """
        earlier = [command for command in commands if command[0] <= 0.0]
        later = [command for command in commands if command[0] > 0.0]
        _, v_mps, wz_radps = earlier[-1] if earlier else (0.0, 0.0, 0.0)
        self._world.place(0, start, v_mps, wz_radps)
        times_s, poses = [0.0], [self._pose()]
        last_s = max(sample_times_s, default=0.0)
        while times_s[-1] < last_s:
            while later and later[0][0] < times_s[-1] + SUBSTEP_S / 2:
                _, v_mps, wz_radps = later.pop(0)
                self._world.command(0, v_mps, wz_radps)
            self._world.step(1)
            times_s.append(len(times_s) * SUBSTEP_S)
            poses.append(self._pose())
        return _interpolated(times_s, poses, sample_times_s)

    def close(self) -> None:
        """Free the physics."""
        self._world.close()

    def _pose(self) -> Pose:
        x, y, yaw = self._world.poses[0].tolist()
        return x, y, yaw


def _interpolated(times_s: list[float], poses: list[Pose], sample_times_s: Sequence[float]) -> list[Pose]:
    track = np.array(poses)
    track[:, 2] = np.unwrap(track[:, 2])
    columns = [np.interp(sample_times_s, times_s, track[:, k]) for k in range(3)]
    return [(float(x), float(y), float(yaw)) for x, y, yaw in zip(*columns, strict=True)]


def _grid(received: MapReceived | None) -> OccupancyGrid:
    if received is None:  # a run without a map: open space
        return OccupancyGrid(np.zeros((1, 1), np.int8), 1.0, 0.0, 0.0)
    cells = np.asarray(received.cells, np.int8).reshape(received.height, received.width)
    return OccupancyGrid(cells, received.resolution_m, received.origin_x_m, received.origin_y_m)
