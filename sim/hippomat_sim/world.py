"""The physical world: walls, round robots with two driven wheels, what touches what, and what a ray meets.

A pure function of the commands: equal commands, equal trajectory. Knows no ports, no clock and no protocol;
PyBullet (DIRECT) supplies collision and ray casting. A robot keeps its last commanded velocity for ever, as a
real base may; walls and other robots hold it back, and its wheels then slip.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType, TracebackType

import numpy as np
from numpy.typing import NDArray

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_sim.near_walls import NearWalls
from hippomat_sim.walls import wall_boxes

SUBSTEP_S = 0.005
WALL = -1  # the other side of a contact with the map
TOUCHING_M = 2e-4  # Bullet keeps resting bodies within some hundredths of a millimetre
NEW_EPISODE_S = 0.5  # a pair apart for this long starts a new contact when it touches again
BODY_HEIGHT_M = 0.2
WALL_HEIGHT_M = 0.5
_RAY, _ROBOT, _MESH, _BOX = 1, 4, 2, 8  # collision groups; Bullet's rays are in group 1
_BOXES_PER_MESH = 2000
_MASS_KG = 3.0
# Stiff about x and y: a robot on its wheels does not tip, and an untipped cylinder keeps its radius.
_INERTIA = (10.0, 10.0, 0.02)


@dataclass(frozen=True, slots=True)
class Body:
    """What a robot is in the world. Accelerations are the motors' own, above what the follower asks."""

    radius_m: float = 0.12
    height_m: float = BODY_HEIGHT_M
    accel_mps2: float = 2.0
    turn_accel_radps2: float = 20.0


@dataclass(frozen=True, slots=True)
class Contact:
    """One contact episode between a robot and another one (or WALL)."""

    start_s: float
    robot: int
    other: int


class World:
    """N robots on a map. Map frame: x east, y north, yaw counter-clockwise. Poses (N, 3) [m, m, rad]."""

    def __init__(
        self, grid: OccupancyGrid, poses: NDArray[np.float64] | list[tuple[float, float, float]], body: Body
    ) -> None:
        pybullet = _import_pybullet()
        self._bullet = pybullet
        self._client = int(pybullet.connect(pybullet.DIRECT))
        self.poses = np.array(poses, dtype=np.float64).reshape(-1, 3)
        self.previous_poses = self.poses.copy()  # before the last step
        self.wheels = np.zeros((len(self.poses), 2))  # v [m/s], wz [rad/s] that the wheels turn for
        self.commands = np.zeros((len(self.poses), 2))
        self.time_s = 0.0
        self.contacts: list[Contact] = []
        self._body = body
        self._last_touch_s: dict[tuple[int, int], float] = {}
        pybullet.setTimeStep(SUBSTEP_S, physicsClientId=self._client)
        # Bodies that are squeezed into each other come apart within a substep or two, not ten.
        pybullet.setPhysicsEngineParameter(contactSlop=0.0, contactERP=0.9, physicsClientId=self._client)
        boxes = wall_boxes(grid)
        extent = boxes[:, 2:].max(axis=0) - boxes[:, :2].min(axis=0) if len(boxes) else np.full(2, np.inf)
        self.extent_m = float(np.hypot(*extent)) + 1.0  # no ray needs to be longer: Bullet's cost by length
        self._walls = NearWalls(boxes, self._add_box, self._remove)
        if len(boxes):
            self._add_sides(boxes)
        self._ids = [self._add_robot(*pose) for pose in self.poses]
        self._robot_of = {body_id: robot for robot, body_id in enumerate(self._ids)}

    def __enter__(self) -> World:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the physics; the arrays stay readable."""
        if self._client >= 0:
            self._bullet.disconnect(self._client)
            self._client = -1

    def command(self, robot: int, v_mps: float, wz_radps: float) -> None:
        """Set the velocity that the wheels of `robot` now go for, and hold for ever."""
        self.commands[robot] = v_mps, wz_radps

    def place(self, robot: int, pose: tuple[float, float, float], v_mps: float, wz_radps: float) -> None:
        """Put a robot somewhere, already moving."""
        self.poses[robot] = self.previous_poses[robot] = pose
        self.wheels[robot] = self.commands[robot] = v_mps, wz_radps
        self._put(robot)

    def step(self, substeps: int = 2) -> None:
        """Advance by substeps x SUBSTEP_S."""
        self.previous_poses = self.poses.copy()
        self._walls.follow(self.poses[:, :2], self._body.radius_m)
        for _ in range(substeps):
            self._substep()

    def hit_distances(self, starts: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance from start to the first thing on the way to end [m], inf where there is none.

        starts, ends: (R, 3). A ray that starts inside a robot does not see that robot.
        """
        if not len(starts):
            return np.empty(0)
        hits = self._bullet.rayTestBatch(starts, ends, physicsClientId=self._client)
        fraction = np.fromiter((hit[2] for hit in hits), dtype=np.float64, count=len(hits))
        met = np.fromiter((hit[0] for hit in hits), dtype=np.int64, count=len(hits)) >= 0
        return np.where(met, fraction * np.linalg.norm(ends - starts, axis=1), np.inf)

    def _substep(self) -> None:
        limit = np.array([self._body.accel_mps2, self._body.turn_accel_radps2]) * SUBSTEP_S
        self.wheels += np.clip(self.commands - self.wheels, -limit, limit)
        # Halfway heading makes the arc exact to second order.
        heading = self.poses[:, 2] + self.wheels[:, 1] * (SUBSTEP_S / 2)
        vx, vy = self.wheels[:, 0] * np.cos(heading), self.wheels[:, 0] * np.sin(heading)
        for robot, body_id in enumerate(self._ids):
            self._bullet.resetBaseVelocity(
                body_id,
                (vx[robot], vy[robot], 0.0),
                (0.0, 0.0, self.wheels[robot, 1]),
                physicsClientId=self._client,
            )
        self._bullet.stepSimulation(physicsClientId=self._client)
        self.time_s += SUBSTEP_S
        for robot, body_id in enumerate(self._ids):
            (x, y, _), (_, _, qz, qw) = self._bullet.getBasePositionAndOrientation(
                body_id, physicsClientId=self._client
            )
            self.poses[robot] = x, y, 2.0 * math.atan2(qz, qw)
        self._note_contacts()

    def _note_contacts(self) -> None:
        touching: set[tuple[int, int]] = set()
        leaning: set[int] = set()
        for point in self._bullet.getContactPoints(physicsClientId=self._client):
            a, b = self._robot_of.get(point[1], WALL), self._robot_of.get(point[2], WALL)
            leaning |= {a, b} - {WALL}
            if point[8] <= TOUCHING_M:
                touching.add((max(a, b), WALL) if WALL in (a, b) else (min(a, b), max(a, b)))
        for robot in sorted(leaning):
            self._put(robot)
        for pair in sorted(touching):
            if self.time_s - self._last_touch_s.get(pair, -math.inf) > NEW_EPISODE_S:
                self.contacts.append(Contact(self.time_s, *pair))
            self._last_touch_s[pair] = self.time_s

    def _put(self, robot: int) -> None:
        """Stand the body upright at its pose."""
        x, y, yaw = self.poses[robot]
        self._bullet.resetBasePositionAndOrientation(
            self._ids[robot],
            (x, y, self._body.height_m / 2),
            (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)),
            physicsClientId=self._client,
        )

    def _add_box(self, box: NDArray[np.float64]) -> int:
        """Something to bump into."""
        bullet, client = self._bullet, self._client
        x0, y0, x1, y1 = box.tolist()
        half = [(x1 - x0) / 2, (y1 - y0) / 2, WALL_HEIGHT_M / 2]
        shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half, physicsClientId=client)
        centre = [(x0 + x1) / 2, (y0 + y1) / 2, WALL_HEIGHT_M / 2]
        body = int(bullet.createMultiBody(0, shape, basePosition=centre, physicsClientId=client))
        self._filter(body, _BOX, _ROBOT)
        return body

    def _remove(self, body_id: int) -> None:
        self._bullet.removeBody(body_id, physicsClientId=self._client)

    def _add_sides(self, boxes: NDArray[np.float64]) -> None:
        """Meshes of all sides for the rays: Bullet casts those twice as fast as boxes."""
        bullet, client = self._bullet, self._client
        for some in np.array_split(boxes, math.ceil(len(boxes) / _BOXES_PER_MESH)):
            vertices, triangles = _sides(some)
            shape = bullet.createCollisionShape(
                bullet.GEOM_MESH,
                vertices=vertices,
                indices=triangles,
                flags=bullet.GEOM_FORCE_CONCAVE_TRIMESH,
                physicsClientId=client,
            )
            self._filter(bullet.createMultiBody(0, shape, physicsClientId=client), _MESH, _RAY)

    def _filter(self, body_id: int, group: int, meets: int) -> None:
        self._bullet.setCollisionFilterGroupMask(body_id, -1, group, meets, physicsClientId=self._client)

    def _add_robot(self, x_m: float, y_m: float, yaw_rad: float) -> int:
        bullet, client = self._bullet, self._client
        shape = bullet.createCollisionShape(
            bullet.GEOM_CYLINDER,
            radius=self._body.radius_m,
            height=self._body.height_m,
            physicsClientId=client,
        )
        body_id = bullet.createMultiBody(
            _MASS_KG,
            shape,
            basePosition=[x_m, y_m, self._body.height_m / 2],
            baseOrientation=[0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)],
            physicsClientId=client,
        )
        no_friction = ("lateralFriction", "rollingFriction", "spinningFriction", "restitution")
        no_damping = ("linearDamping", "angularDamping")
        settings = dict.fromkeys(no_friction + no_damping, 0.0)
        bullet.changeDynamics(body_id, -1, **settings, physicsClientId=client)
        bullet.changeDynamics(body_id, -1, localInertiaDiagonal=_INERTIA, physicsClientId=client)
        self._filter(body_id, _ROBOT, _ROBOT | _BOX | _RAY)
        return int(body_id)


def _sides(boxes: NDArray[np.float64]) -> tuple[list[list[float]], list[int]]:
    """Vertices (8 per box) and triangles (8 per box, three indices each) of the upright sides."""
    corners = boxes[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 4, 2)
    low = np.concatenate([corners, np.zeros((len(boxes), 4, 1))], axis=2)
    up = np.array([0.0, 0.0, WALL_HEIGHT_M])
    vertices = np.concatenate([low, low + up], axis=1)  # (B, 8, 3)
    here, following = np.arange(4), (np.arange(4) + 1) % 4
    lower = np.stack([here, following, following + 4], axis=1)
    upper = np.stack([here, following + 4, here + 4], axis=1)
    one_box = np.concatenate([lower, upper]).ravel()
    triangles = (8 * np.arange(len(boxes))[:, None] + one_box).ravel()
    return vertices.reshape(-1, 3).tolist(), triangles.tolist()


def _import_pybullet() -> ModuleType:
    """pybullet; its C code prints its build date on the first import, which is kept off our output."""
    if "pybullet" not in sys.modules:
        with _quiet_stderr():
            importlib.import_module("pybullet")
    return sys.modules["pybullet"]


@contextlib.contextmanager
def _quiet_stderr() -> Iterator[None]:
    sys.stderr.flush()
    keep, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(keep, 2)
        os.close(keep)
        os.close(null)
