"""What the navigator remembers, sees and answers, as values. Decides nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import Config
from hippomat_core.control.follower import Drive, Motion
from hippomat_core.planning.astar import Path, path_length_m
from hippomat_core.planning.costmap import Costmap
from hippomat_core.planning.distance_field import DistanceField
from hippomat_core.planning.reservations import Cells, PeerMotion, Taken, taken_cells
from hippomat_core.replaced import quickly_made, replace

NEVER = -1
STANDING = Drive()
STANDING_MPS = 0.03  # slower than this counts as standing


@dataclass(frozen=True, slots=True, eq=False)
class Navigator:
    """Memory between calls; start with Navigator()."""

    stamp_ns: int = NEVER
    destination: tuple[float, float] | None = None
    path: Path | None = None
    cursor: int = 0  # path cell that we are at
    heard: bool = False  # the others know of us: since then we may commit
    together: bool = False  # the path is what we have committed ourselves to, not all the way
    aside: bool = False  # the path leads out of somebody's way, not to the destination
    aside_until_ns: int = NEVER
    arrived: bool = False
    drive: Drive = STANDING
    blocked_since_ns: int = NEVER
    tried: int = 0  # blockages when we last looked for another way
    in_way_since_ns: int = NEVER
    held_since_ns: int = NEVER
    retry_ns: int = NEVER  # no path: not before this
    marks: tuple[tuple[float, float, int], ...] = ()  # x, y, until_ns: the scan guard stopped us here

    def without_path(self) -> Navigator:
        """Where all plans are void."""
        return replace(
            self,
            path=None,
            cursor=0,
            aside=False,
            blocked_since_ns=NEVER,
            tried=0,
            in_way_since_ns=NEVER,
            held_since_ns=NEVER,
            retry_ns=NEVER,
        )

    def on_path(self, path: Path, cause: str, resolution_m: float) -> tuple[Navigator, NewPath]:
        """At the beginning of a new path."""
        nav = replace(self.without_path(), path=path, aside=cause == "aside")
        return nav, NewPath(path, path_length_m(path, resolution_m), cause)


@dataclass(frozen=True, slots=True, eq=False)
class NewPath:
    """A path just planned; empty cells = there is none."""

    cells: Cells  # (K, 2) [ix, iy]
    length_m: float
    cause: str  # new, blocked, aside, gone


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class NavOutcome:
    """What to command, tell and record."""

    v_mps: float
    wz_radps: float
    reason: str  # follow, rotate, hold, stop:off_map
    path: NewPath | None  # only when it changed
    intent: Cells  # (1 <= K <= 13, 2) cells to broadcast, first the one we are in
    arrived: bool  # within the goal tolerance of the destination
    blocked: bool
    blocked_by: int  # robot id, -1: nobody
    remaining_m: float  # along the path; inf where there is none, 0 without a destination


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The arguments of one call and what follows from them at once."""

    now_ns: int
    dt_s: float
    motion: Motion
    cell: tuple[int, int]  # the free cell that we count as being in
    peers: Sequence[PeerMotion]
    taken: Taken
    costmap: Costmap
    field: DistanceField | None
    config: Config
    marks: Sequence[tuple[float, float]] = ()  # x, y [m] where the scan guard stopped us lately

    @property
    def resolution_m(self) -> float:
        """Side of a cell."""
        return self.costmap.grid.resolution_m

    @property
    def stands(self) -> bool:
        """True where we do not drive (turning in place is standing)."""
        return abs(self.motion.v_mps) < STANDING_MPS

    def blockages(self, since_ns: int) -> int:
        """How many whole blockages have passed since then."""
        if since_ns == NEVER:
            return 0
        return int((self.now_ns - since_ns) / (self.config.planning.blockage_s * 1e9))

    def taken_mask(self, taken: Taken) -> NDArray[np.bool_]:
        """(H, W) cells that are taken."""
        return taken_cells(taken.xy, taken.radius_m, self.costmap.grid)


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """The path ahead and how much of it is ours."""

    points: NDArray[np.float64]  # (n, 2) [m]
    free_m: float
    owner: int  # who ends it, -1: nobody
    blocked: bool


NO_STRETCH = Stretch(np.zeros((0, 2)), 0.0, -1, False)
