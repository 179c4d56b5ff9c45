"""A kinematic world of round robots for the motion tests: unicycles, odometry errors, a late and lossy radio.

Not a physics engine: a contact is counted, not simulated. Every robot runs the core's navigator and scan
guard on what it has heard; the lidar sees walls and robots. Seeded; equal seed, equal run.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from hippomat_core.config import Config, FleetConfig, PlanningConfig, RobotConfig
from hippomat_core.control.follower import Motion
from hippomat_core.control.guard import carried_along, guard
from hippomat_core.control.navigator import Navigator, navigate
from hippomat_core.control.together import Together
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.motion.lattice import lattice_of
from hippomat_core.planning.costmap import Costmap, inflate, reachable
from hippomat_core.planning.distance_field import distance_at, distance_field
from hippomat_core.planning.reservations import PeerMotion

TICK_S = 0.05
ROUND_TICKS = 2
SCAN_TICKS = 3
RAYS = 180
FACE_M = 0.12


@dataclass
class Radio:
    loss: float = 0.2
    delay_s: tuple[float, float] = (0.02, 0.15)


@dataclass
class Body:
    """One robot: the truth, what it believes, and its navigator."""

    config: Config
    x: float
    y: float
    yaw: float
    v: float = 0.0
    wz: float = 0.0
    error: np.ndarray = field(default_factory=lambda: np.zeros(3))
    nav: Navigator = field(default_factory=Navigator)
    goal: tuple[float, float] | None = None
    to_goal: np.ndarray | None = None
    dwelt: int = 0
    held: bool = False
    heard: dict[int, tuple[float, PeerMotion]] = field(default_factory=dict)
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    scan_pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    intent: np.ndarray | None = None
    still: int = 0
    longest_still: int = 0
    ideal_s: float = 0.0
    done: int = 0
    claim_round: int = 0
    driven: float = 0.0

    def believed(self) -> tuple[float, float, float]:
        return self.x + self.error[0], self.y + self.error[1], self.yaw + self.error[2]


class World:
    """Robots with random goals on a map; dwell at each, then the next."""

    def __init__(
        self,
        grid: OccupancyGrid,
        count: int,
        seed: int,
        radio: Radio | None = None,
        odometry_m: float = 0.02,
        inflation_m: float = 0.17,
        idle: int = 0,
        planner: str = "replan",
    ) -> None:
        self.rng = np.random.default_rng(seed)
        self.grid, self.radio, self.odometry_m = grid, radio or Radio(), odometry_m
        self.costmap: Costmap = inflate(grid, inflation_m)
        self.clearance = _clearance_lattice(grid)
        self.sites = self._sites()
        self.tick = 0
        self.mail: dict[int, list[tuple[int, PeerMotion, int]]] = defaultdict(list)
        self.contacts: list[str] = []
        self.closest = math.inf
        self.closest_wall = math.inf
        self.touching: set[tuple[int, int]] = set()
        self.idle = set(range(count - idle, count))
        self.robots: list[Body] = []
        self.trace: list[list[tuple]] = []
        fleet, planning = FleetConfig(size=count), PlanningConfig(planner=planner)
        self.lattice = None if planner == "replan" else lattice_of(self.costmap, 0.35)
        for k in range(count):
            x, y = self._free_site()
            config = Config(fleet=fleet, robot=RobotConfig(id=k), planning=planning)
            self.robots.append(Body(config, x, y, self.rng.uniform(-3, 3)))

    def _sites(self) -> np.ndarray:
        iy, ix = np.nonzero(self.costmap.free)
        for k in self.rng.permutation(len(ix)):
            mask = reachable(self.costmap, *self.grid.centre_of(int(ix[k]), int(iy[k])))
            if mask.sum() * 2 > len(ix):
                iy, ix = np.nonzero(mask)
                break
        return np.stack([ix, iy], axis=1)

    def _free_site(self) -> tuple[float, float]:
        """A site two diameters away from everybody and everybody's goal, as the tasks are."""
        for _ in range(2000):
            x, y = self.grid.centre_of(*(int(c) for c in self.sites[self.rng.integers(len(self.sites))]))
            others = [(r.x, r.y) for r in self.robots] + [r.goal for r in self.robots if r.goal]
            if all(math.hypot(x - a, y - b) > 0.48 for a, b in others):
                return x, y
        raise AssertionError("no room")

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.step()

    def step(self) -> None:
        now_s = self.tick * TICK_S
        for k, robot in enumerate(self.robots):
            self._deliver(k, now_s)
            if (self.tick + k) % SCAN_TICKS == 0:
                robot.points, robot.scan_pose = self._scan(k), (robot.x, robot.y, robot.yaw)
        commands = [self._decide(k, now_s) for k in range(len(self.robots))]
        for robot, (v, wz) in zip(self.robots, commands, strict=True):
            self._move(robot, v, wz)
        self._judge()
        self.trace.append([(r.x, r.y, r.yaw, r.goal, r.intent) for r in self.robots])
        self.tick += 1

    def _deliver(self, k: int, now_s: float) -> None:
        rest = []
        for due, peer, sent in self.mail[k]:
            if due > self.tick:
                rest.append((due, peer, sent))
            elif self.robots[k].heard.get(peer.robot, (0.0, peer))[0] <= sent * TICK_S:
                # The radio's delay is not known to the receiver: age counts from reception.
                self.robots[k].heard[peer.robot] = (now_s, peer)
        self.mail[k] = rest

    def _decide(self, k: int, now_s: float) -> tuple[float, float]:
        robot = self.robots[k]
        if robot.goal is None and k not in self.idle:
            robot.goal, robot.claim_round = self._free_site(), self.tick // ROUND_TICKS
            cell = self.grid.cell_of(*robot.goal)
            robot.to_goal = distance_field(self.costmap, cell)
            robot.ideal_s += distance_at(self.costmap, robot.to_goal, robot.x, robot.y) / 0.2 + 1.0
        peers = [replace(p, age_s=now_s - at) for at, p in robot.heard.values()]
        x, y, yaw = robot.believed()
        motion = Motion(x, y, yaw, robot.v, robot.wz)
        robot.nav, out = navigate(
            robot.nav,
            self.tick * 50_000_000,
            motion,
            robot.goal,
            peers,
            self.costmap,
            robot.to_goal,
            robot.config,
            robot.held,
            None
            if self.lattice is None
            else Together(self.lattice, self.tick // ROUND_TICKS, robot.claim_round, True),
        )
        robot.intent, robot.out = out.intent, out
        if self.tick % ROUND_TICKS == k % ROUND_TICKS:
            self._broadcast(k, motion)
        robot.dwelt = robot.dwelt + 1 if out.arrived else 0
        if robot.dwelt * TICK_S > robot.config.fleet.dwell_s:
            robot.goal, robot.to_goal, robot.dwelt, robot.done = None, None, 0, robot.done + 1
        points = carried_along(robot.points, robot.scan_pose, (robot.x, robot.y, robot.yaw))
        discs = np.array([(p.x_m, p.y_m, FACE_M) for p in peers]).reshape(-1, 3)
        discs[:, :2] = carried_along(discs[:, :2], (0.0, 0.0, 0.0), (x, y, yaw))
        safe = guard(points, out.v_mps, out.wz_radps, discs, robot.config)
        robot.held = safe.limited
        self._progress(robot, out)
        return safe.v_mps, safe.wz_radps

    def _progress(self, robot: Body, out) -> None:
        stuck = robot.goal is not None and not out.arrived and abs(robot.v) < 0.01
        robot.still = robot.still + 1 if stuck else 0
        robot.longest_still = max(robot.longest_still, robot.still)

    def _broadcast(self, k: int, motion: Motion) -> None:
        robot = self.robots[k]
        speed = min(round(abs(robot.v) * 50), 255) / 50
        x, y = round(motion.x_m, 2), round(motion.y_m, 2)
        told = self.tick // ROUND_TICKS - 1
        peer = PeerMotion(k, x, y, speed, 0.0, robot.intent[:13].copy(), robot.goal, told, robot.claim_round)
        for other in range(len(self.robots)):
            if other != k and self.rng.random() >= self.radio.loss:
                delay = self.rng.uniform(*self.radio.delay_s)
                self.mail[other].append((self.tick + math.ceil(delay / TICK_S), peer, self.tick))

    def _scan(self, k: int) -> np.ndarray:
        """Returns in the base frame: sphere tracing against walls, exact discs for robots."""
        robot = self.robots[k]
        angle = np.linspace(0, 2 * math.pi, RAYS, endpoint=False)
        ux, uy = np.cos(angle + robot.yaw), np.sin(angle + robot.yaw)
        far = np.full(RAYS, 0.0)
        for _ in range(12):
            far += np.maximum(self._wall_distance(robot.x + far * ux, robot.y + far * uy), 0.0)
            far = np.minimum(far, 1.5)
        for other, body in enumerate(self.robots):
            if other == k:
                continue
            dx, dy = body.x - robot.x, body.y - robot.y
            along = dx * ux + dy * uy
            across2 = dx * dx + dy * dy - along * along
            hit = (along > 0) & (across2 < FACE_M**2)
            depth = along - np.sqrt(np.maximum(FACE_M**2 - across2, 0.0))
            far = np.where(hit, np.minimum(far, depth), far)
        seen = (far < 1.4) & (far >= 0.15)
        far = far + self.rng.normal(0, 0.005, RAYS)
        return np.stack([far * np.cos(angle), far * np.sin(angle)], axis=1)[seen]

    def _wall_distance(self, x, y):
        height, width = self.clearance.shape
        scale = 4 / self.grid.resolution_m
        ix = np.clip(((np.asarray(x) - self.grid.origin_x_m) * scale).astype(int), 0, width - 1)
        iy = np.clip(((np.asarray(y) - self.grid.origin_y_m) * scale).astype(int), 0, height - 1)
        return self.clearance[iy, ix]

    def _move(self, robot: Body, v: float, wz: float) -> None:
        limits = robot.config.limits
        dv, dw = 1.0 * TICK_S, limits.turn_accel_radps2 * TICK_S  # the motors brake harder than the follower
        robot.v += max(-dv, min(dv, v - robot.v))
        robot.wz += max(-dw, min(dw, wz - robot.wz))
        robot.yaw += robot.wz * TICK_S
        robot.x += robot.v * math.cos(robot.yaw) * TICK_S
        robot.y += robot.v * math.sin(robot.yaw) * TICK_S
        robot.driven += abs(robot.v) * TICK_S
        robot.error += self.rng.normal(0, self.odometry_m / 10, 3) * (abs(robot.v) > 0.01)
        size = math.hypot(robot.error[0], robot.error[1])
        if size > self.odometry_m:
            robot.error[:2] *= self.odometry_m / size
        robot.error[2] = max(-0.03, min(0.03, robot.error[2]))

    def _judge(self) -> None:
        for a, first in enumerate(self.robots):
            wall = float(self._wall_distance(first.x, first.y)) - FACE_M
            self.closest_wall = min(self.closest_wall, wall)
            self._touch((a, -1), wall < 0)
            for b in range(a + 1, len(self.robots)):
                second = self.robots[b]
                gap = math.hypot(first.x - second.x, first.y - second.y) - 2 * FACE_M
                self.closest = min(self.closest, gap)
                self._touch((a, b), gap < 0)

    def _touch(self, pair: tuple[int, int], touching: bool) -> None:
        if touching and pair not in self.touching:
            self.contacts.append(f"{pair} at {self.tick * TICK_S:.2f} s")
        (self.touching.add if touching else self.touching.discard)(pair)

    def throughput(self) -> float:
        """Share of the conflict-free time: ideal seconds of what was driven over the time spent."""
        busy = [r for k, r in enumerate(self.robots) if k not in self.idle]
        ideal = sum(r.ideal_s for r in busy)
        for r in busy:
            if r.goal is not None and r.to_goal is not None:
                ideal -= distance_at(self.costmap, r.to_goal, r.x, r.y) / 0.2
        return ideal / (len(busy) * self.tick * TICK_S)

    def stuck_s(self) -> float:
        return max(r.longest_still for r in self.robots) * TICK_S


def _clearance_lattice(grid: OccupancyGrid) -> np.ndarray:
    """Distance to the nearest occupied edge on a lattice four times finer than the grid [m]."""
    fine = np.kron((grid.cells >= 65).astype(np.uint8), np.ones((4, 4), np.uint8))
    return cv2.distanceTransform(1 - fine, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * (grid.resolution_m / 4) - (
        grid.resolution_m / 8
    )
