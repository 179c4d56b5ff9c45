"""The occupancy grid as a value: which cells are occupied, where they lie. Knows no files, no robots.

Conventions are ROS's (nav_msgs/OccupancyGrid): -1 unknown, 0 free .. 100 occupied, row-major from the
lower left.
"""

from __future__ import annotations

import hashlib
import math
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import MapError

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
MAX_SIDE = 65_535  # intents name cells in 16 bits


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyGrid:
    """Map frame: x east, y north (REP 103). The origin is the lower left corner of cell (0, 0)."""

    cells: NDArray[np.int8]  # (H, W) [iy, ix]; -1 unknown, 0..100 occupancy in percent
    resolution_m: float
    origin_x_m: float
    origin_y_m: float

    def __post_init__(self) -> None:
        if self.cells.ndim != 2 or 0 in self.cells.shape or max(self.cells.shape) > MAX_SIDE:
            raise MapError(f"a map needs 1 .. {MAX_SIDE} cells a side, found shape {self.cells.shape}")
        if not (math.isfinite(self.resolution_m) and self.resolution_m > 0.0):
            raise MapError(
                f"the map's resolution is {self.resolution_m!r}; it must be a number of metres > 0"
            )
        if not (math.isfinite(self.origin_x_m) and math.isfinite(self.origin_y_m)):
            raise MapError(f"the map's origin ({self.origin_x_m!r}, {self.origin_y_m!r}) must be finite")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, OccupancyGrid) and self.hash() == other.hash()

    def __hash__(self) -> int:
        return int.from_bytes(self.hash()[:8], "little")

    @property
    def width(self) -> int:
        return int(self.cells.shape[1])

    @property
    def height(self) -> int:
        return int(self.cells.shape[0])

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """(ix, iy) of the cell that holds the point; may lie outside the grid, see holds()."""
        return (
            math.floor((x_m - self.origin_x_m) / self.resolution_m),
            math.floor((y_m - self.origin_y_m) / self.resolution_m),
        )

    def centre_of(self, ix: int, iy: int) -> tuple[float, float]:
        """(x, y) [m] of the middle of cell (ix, iy)."""
        return (
            self.origin_x_m + (ix + 0.5) * self.resolution_m,
            self.origin_y_m + (iy + 0.5) * self.resolution_m,
        )

    def cropped(self) -> OccupancyGrid:
        """The part that holds every known cell; itself where none is known."""
        iy, ix = np.nonzero(self.cells != UNKNOWN)
        if not len(ix):
            return self
        low_x, low_y = int(ix.min()), int(iy.min())
        cells = np.ascontiguousarray(self.cells[low_y : iy.max() + 1, low_x : ix.max() + 1])
        left_m = self.origin_x_m + low_x * self.resolution_m
        return OccupancyGrid(cells, self.resolution_m, left_m, self.origin_y_m + low_y * self.resolution_m)

    def holds(self, ix: int, iy: int) -> bool:
        """True where (ix, iy) is a cell of this grid."""
        return 0 <= ix < self.width and 0 <= iy < self.height

    def lies_as(self, other: OccupancyGrid) -> bool:
        """Whether the cells of both are the same squares of the map frame."""
        same_origin = (self.origin_x_m, self.origin_y_m) == (other.origin_x_m, other.origin_y_m)
        return (
            self.cells.shape == other.cells.shape and self.resolution_m == other.resolution_m and same_origin
        )

    def hash(self) -> bytes:
        """SHA-256 over shape, resolution, origin and cells: equal maps, equal hash, on every machine."""
        head = struct.pack(
            "<IIddd", self.width, self.height, self.resolution_m, self.origin_x_m, self.origin_y_m
        )
        return hashlib.sha256(head + np.ascontiguousarray(self.cells, np.int8).tobytes()).digest()
