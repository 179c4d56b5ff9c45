"""One robot core with a skewed lidar and drifting wheels in a room of walls; scripted motion, exact time.

For tests of localization through step(): no fleet, no bytes, no physics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from fleet_world import map_event

from hippomat_core.config import Config, FleetConfig, LidarConfig, RobotConfig, SlamConfig
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import (
    BASE,
    LIDAR,
    BaseFeedback,
    Localized,
    PortOpened,
    ScanReceived,
    Started,
    Tick,
)
from hippomat_core.slam.pose2 import compose
from hippomat_core.step import State, initial_state, step

BASE_NS, TICK_NS, SWEEP_NS = 40_000_000, 50_000_000, 180_000_000
SAMPLES = 360
FINE_NS = 10_000_000
MM = 1000.0


def flat(width_m=6.0, height_m=5.0, resolution_m=0.05):
    """A room that looks different from every place: two inner walls and a pillar."""
    w, h = round(width_m / resolution_m), round(height_m / resolution_m)
    cells = np.zeros((h, w), np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    cells[: round(2.0 / resolution_m), round(3.6 / resolution_m)] = 100
    cells[round(3.3 / resolution_m), : round(1.6 / resolution_m)] = 100
    cells[60:66, 90:96] = 100
    return OccupancyGrid(cells, resolution_m, 0.0, 0.0)


def ranges(grid, poses, bearings_rad, reach_m=12.0):
    """(n,) [m] from poses (n, 3) along bearings (n,), base frame, to the first occupied cell; inf beyond."""
    step_m = grid.resolution_m / 5
    along = np.arange(0.1, reach_m, step_m)
    heading = poses[:, 2] + bearings_rad
    x = poses[:, 0, None] + along * np.cos(heading)[:, None]
    y = poses[:, 1, None] + along * np.sin(heading)[:, None]
    ix = np.floor((x - grid.origin_x_m) / grid.resolution_m).astype(int)
    iy = np.floor((y - grid.origin_y_m) / grid.resolution_m).astype(int)
    inside = (ix >= 0) & (iy >= 0) & (ix < grid.width) & (iy < grid.height)
    hit = inside & (grid.cells[iy.clip(0, grid.height - 1), ix.clip(0, grid.width - 1)] >= 65)
    return np.where(hit.any(axis=1), along[hit.argmax(axis=1)], np.inf)


@dataclass
class LidarWorld:
    """`grid` is what there is; `told` is the map that the robot was given."""

    grid: OccupancyGrid
    pose: tuple[float, float, float]
    start: tuple[float, float, float] | None
    seed: int = 0
    told: OccupancyGrid | None = None
    maps: bool = True  # the robot is given a map at all
    wheel_scale: tuple[float, float] = (1.02, 0.98)  # odometry over- and underestimates by this
    wheel_noise: float = 0.02
    things: list[tuple[float, float, float]] = field(default_factory=list)  # x, y, radius: people, boxes
    slam: SlamConfig = field(default_factory=SlamConfig)

    def __post_init__(self) -> None:
        start = self.start or (0.0, 0.0, 0.0)
        self.lidar = LidarConfig()
        robot = RobotConfig(0, *start, start_known=self.start is not None)
        config = Config(
            fleet=FleetConfig(size=1, task_slots=2, allocator="greedy"), robot=robot, slam=self.slam
        )
        self.state: State = initial_state(config)
        self.rng = np.random.default_rng(self.seed)
        self.odom = [0.0, 0.0, 0.0]
        self.now_ns = 0
        self.effects: list = []
        self.found: list[tuple[Localized, tuple[float, float, float]]] = []  # and the truth at its stamp
        self.truth = [(0, *self.pose)]
        self.feed(Started(0))
        if self.maps:
            self.feed(map_event(self.told or self.grid, 0))
        self.feed(PortOpened(0, BASE, "base"))
        self.feed(PortOpened(0, LIDAR, "lidar"))

    def feed(self, event) -> None:
        self.state, effects = step(self.state, event)
        self.effects += effects
        for effect in effects:
            if isinstance(effect, Localized):
                self.found.append((effect, self.truth_at(effect.stamp_ns)))

    def truth_at(self, stamp_ns):
        """(x, y, yaw) that the robot really had."""
        return tuple(self.truths(np.array([stamp_ns]))[0].tolist())

    def truths(self, stamps_ns):
        truth = np.array(self.truth[-400:])
        columns = [np.interp(stamps_ns, truth[:, 0], truth[:, k]) for k in (1, 2, 3)]
        return np.stack(columns, axis=1)

    def carry(self, pose) -> None:
        """Somebody lifts the robot and puts it down there."""
        self.pose = pose
        self.truth.append((self.now_ns + 1, *pose))

    def drive(self, seconds, v_mps=0.0, wz_radps=0.0):
        """Move like this for a while; the events that come of it are fed."""
        until_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < until_ns:
            self._move(v_mps, wz_radps)
            if self.now_ns % BASE_NS == 0:
                self.feed(self._feedback())
            if self.now_ns % SWEEP_NS == 0:
                self.feed(self._sweep())
            if self.now_ns % TICK_NS == 0:
                self.feed(Tick(self.now_ns))
        return self

    def _move(self, v_mps, wz_radps) -> None:
        dt_s = FINE_NS / 1e9
        turn = wz_radps * dt_s
        x, y, yaw = compose(
            self.pose, (v_mps * dt_s * math.cos(turn / 2), v_mps * dt_s * math.sin(turn / 2), turn)
        )
        last = self.truth[-1][3]
        self.now_ns += FINE_NS
        self.pose = (x, y, yaw)
        self.truth.append((self.now_ns, x, y, last + math.remainder(yaw - last, math.tau)))
        noise = 1.0 + self.wheel_noise * self.rng.standard_normal(2)
        way, turned = v_mps * dt_s * self.wheel_scale[0] * noise[0], turn * self.wheel_scale[1] * noise[1]
        heading = self.odom[2] + turned / 2
        self.odom = [
            self.odom[0] + way * math.cos(heading),
            self.odom[1] + way * math.sin(heading),
            self.odom[2] + turned,
        ]

    def _feedback(self):
        x, y = (round(MM * value) for value in self.odom[:2])
        yaw = round(MM * math.remainder(self.odom[2], math.tau))
        zeros, wheels = np.zeros(3, np.int16), np.zeros(4, np.int16)
        return BaseFeedback(self.now_ns, zeros, zeros, zeros, x, y, yaw, 0, 0, 0, wheels, 0)

    def _sweep(self):
        angle_rad = np.arange(SAMPLES) * math.tau / SAMPLES
        taken_ns = self.now_ns - SWEEP_NS + (np.arange(SAMPLES) + 1) * (SWEEP_NS / SAMPLES)
        poses = self.truths(taken_ns)
        bearing_rad = self.lidar.yaw_rad - angle_rad  # the device turns clockwise
        range_m = np.minimum(ranges(self.grid, poses, bearing_rad), self._to_things(poses, bearing_rad))
        range_m += 0.005 * self.rng.standard_normal(SAMPLES)
        distance = np.where(np.isfinite(range_m), np.rint(range_m * 4000), 0).astype(np.uint16)
        angle_q6 = np.floor(np.degrees(angle_rad) * 64).astype(np.uint16)
        return ScanReceived(self.now_ns, np.full(SAMPLES, 15, np.uint8), angle_q6, distance)

    def _to_things(self, poses, bearing_rad):
        """(n,) [m] to the nearest round thing."""
        nearest = np.full(len(poses), np.inf)
        heading = poses[:, 2] + bearing_rad
        for x, y, radius_m in self.things:
            ahead = (x - poses[:, 0]) * np.cos(heading) + (y - poses[:, 1]) * np.sin(heading)
            beside = -(x - poses[:, 0]) * np.sin(heading) + (y - poses[:, 1]) * np.cos(heading)
            met = (ahead > 0) & (np.abs(beside) < radius_m)
            depth = np.sqrt(np.maximum(radius_m**2 - beside**2, 0.0))
            nearest = np.where(met, np.minimum(nearest, ahead - depth), nearest)
        return nearest

    # ---- what is asked of it ----

    @property
    def error_m(self) -> float:
        """How far the pose it believes is from the true one, now."""
        x, y, _ = self.state.pose
        return math.hypot(x - self.pose[0], y - self.pose[1])

    @property
    def localized(self) -> bool:
        return self.state.place is not None and self.state.place.localized
