"""The walls of a large map as bodies to bump into, near the robots only: Bullet's step costs by the body.

Decides which boxes exist now. A function of where the robots were, so equal runs have equal walls.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

AFFORDABLE = 400  # as many boxes as this are simply always there
REACH_M = 1.0  # between a robot's centre and a box, beyond which it may be missing
REFRESH_M = 0.4  # a robot moves this far before boxes are looked for again


class NearWalls:
    """`make` gives the body id of one box (x_min, y_min, x_max, y_max); `remove` takes it away again."""

    def __init__(
        self,
        boxes: NDArray[np.float64],
        make: Callable[[NDArray[np.float64]], int],
        remove: Callable[[int], None],
    ) -> None:
        self._boxes, self._make, self._remove = boxes, make, remove
        self._bodies: dict[int, int] = {}  # box -> body id
        self._looked_from: NDArray[np.float64] | None = None  # (N, 2) [m]
        self._always = len(boxes) <= AFFORDABLE
        if self._always:
            self._bodies = {k: make(box) for k, box in enumerate(boxes)}

    def follow(self, xy_m: NDArray[np.float64], radius_m: float) -> None:
        """Have every box near the robots (N, 2)."""
        if self._always or not len(xy_m):
            return
        before = self._looked_from
        if before is not None and float(np.abs(xy_m - before).max()) < REFRESH_M / np.sqrt(2.0):
            return
        self._looked_from = xy_m.copy()
        near = set(self._near(xy_m, radius_m + REACH_M + REFRESH_M))
        for k in sorted(self._bodies.keys() - near):
            self._remove(self._bodies.pop(k))
        for k in sorted(near - self._bodies.keys()):
            self._bodies[k] = self._make(self._boxes[k])

    def _near(self, xy_m: NDArray[np.float64], reach_m: float) -> list[int]:
        low, high = self._boxes[:, None, :2], self._boxes[:, None, 2:]
        away = np.maximum(np.maximum(low - xy_m, xy_m - high), 0.0)  # (B, N, 2)
        return [int(k) for k in np.flatnonzero((np.hypot(away[..., 0], away[..., 1]) < reach_m).any(axis=1))]
