"""ROS's tree of frames (REP 105): the newest transform of every child, and the way from a frame to its root.

Knows translations and unit quaternions (x, y, z, w), no time. Source: tf2, whose conventions these are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.messages import TransformReceived

DEEPEST = 32  # frames from a leaf to the root; more is a loop

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Pose2 = tuple[float, float, float]  # x [m], y [m], yaw [rad]


@dataclass(frozen=True, slots=True)
class Rigid:
    """A frame's pose in another one."""

    move: Vector  # [m]
    turn: Quaternion

    def within(self, outer: Rigid) -> Rigid:
        """The same frame in the frame that `outer` is given in."""
        x, y, z = outer.rotated(self.move)
        return Rigid(
            (outer.move[0] + x, outer.move[1] + y, outer.move[2] + z), _product(outer.turn, self.turn)
        )

    def rotated(self, v: Vector) -> Vector:
        qx, qy, qz, qw = self.turn
        tx, ty, tz = 2 * (qy * v[2] - qz * v[1]), 2 * (qz * v[0] - qx * v[2]), 2 * (qx * v[1] - qy * v[0])
        return (
            v[0] + qw * tx + qy * tz - qz * ty,
            v[1] + qw * ty + qz * tx - qx * tz,
            v[2] + qw * tz + qx * ty - qy * tx,
        )

    def flat(self) -> Pose2:
        """As a pose in the plane."""
        qx, qy, qz, qw = self.turn
        yaw_rad = math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
        return self.move[0], self.move[1], yaw_rad

    def flattened(self, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) points of this frame's x-y plane, seen from above in the outer frame. A lidar may hang."""
        ex, ey = self.rotated((1.0, 0.0, 0.0)), self.rotated((0.0, 1.0, 0.0))
        x, y = xy_m[:, 0], xy_m[:, 1]
        return np.stack([self.move[0] + ex[0] * x + ey[0] * y, self.move[1] + ex[1] * x + ey[1] * y], axis=1)


HERE = Rigid((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Edge:
    """The newest transform of one child."""

    parent: str
    rigid: Rigid
    fixed: bool
    stamp_ns: int  # when it came in
    taken_ns: int  # when it was stamped, on our clock


@dataclass(frozen=True, slots=True, eq=False)
class Transforms:
    """Every child's edge; never written to after it is stored."""

    edges: dict[str, Edge]

    def with_transform(self, event: TransformReceived, taken_ns: int) -> Transforms:
        """Its quaternion may be a little off unit length; one that is no rotation at all is left out."""
        length = math.sqrt(event.qx**2 + event.qy**2 + event.qz**2 + event.qw**2)
        if not 0.5 < length < 2.0 or not all(map(math.isfinite, (event.x_m, event.y_m, event.z_m))):
            return self
        turn = (event.qx / length, event.qy / length, event.qz / length, event.qw / length)
        rigid = Rigid((event.x_m, event.y_m, event.z_m), turn)
        edge = Edge(event.parent, rigid, event.fixed, event.stamp_ns, taken_ns)
        return Transforms({**self.edges, event.child: edge})

    def way(self, frame: str, root: str) -> tuple[Edge, ...] | None:
        """Edges from `frame` up to `root`; None where they do not connect."""
        edges: list[Edge] = []
        while frame != root:
            edge = self.edges.get(frame)
            if edge is None or len(edges) == DEEPEST:
                return None
            edges.append(edge)
            frame = edge.parent
        return tuple(edges)

    def between(self, frame: str, base: str) -> Rigid | None:
        """`frame` in the frame `base`, where one is above the other."""
        way = self.way(frame, base)
        return None if way is None else along(way)

    def top(self, frame: str) -> str:
        """The highest frame that `frame` is known in."""
        for _ in range(DEEPEST):
            if frame not in self.edges:
                break
            frame = self.edges[frame].parent
        return frame


def along(way: tuple[Edge, ...]) -> Rigid:
    """The first edge's child in the last edge's parent."""
    rigid = HERE
    for edge in way:
        rigid = rigid.within(edge.rigid)
    return rigid


def _product(p: Quaternion, q: Quaternion) -> Quaternion:
    return (
        p[3] * q[0] + p[0] * q[3] + p[1] * q[2] - p[2] * q[1],
        p[3] * q[1] - p[0] * q[2] + p[1] * q[3] + p[2] * q[0],
        p[3] * q[2] + p[0] * q[1] - p[1] * q[0] + p[2] * q[3],
        p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2],
    )
