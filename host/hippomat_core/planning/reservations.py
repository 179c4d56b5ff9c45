"""What the peers have taken: discs where they are, and the cells they broadcast as their intent.

Two rules. Everyone keeps out of where a peer is or may be by the time it reacts (its disc, and the part of
its intent it can no longer stop before). Whoever has the lower priority also keeps out of the rest of the
intent, unless it is through before the peer can be there. Priority: robots with a destination before those
without, then the smaller id. Knows peers as they were last heard and how long ago; no radio, no own path.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import Config
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.taken_kernels import TOLERANCE_M, discs_from, intent_cells, intent_steps, stretch
from hippomat_core.replaced import quickly_made, replace
from hippomat_core.wire.frames import MAX_INTENT_STEPS, NO_SLOT, StateFrame

Cells = NDArray[np.int32]  # (K, 2) [ix, iy]
Positions = NDArray[np.float64]  # (n, 2) [m], map frame

FRESH_S = 0.3  # up to this age a peer's intent says where it may be; beyond, its disc grows
MAX_GROWTH_M = 0.25
FORGET_GROWTH_S = 10.0  # a peer silent for so long stands where it was last heard, or is far away
COMMITTED_M = 0.02  # a standing peer may just have started
COLUMNS = 6  # of a disc while discs are collected: x, y, radius, from_s, robot, intended


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class PeerMotion:
    """A peer as last heard; map frame."""

    robot: int
    x_m: float
    y_m: float
    speed_mps: float
    age_s: float  # since it was heard, on our monotonic clock
    intent: Cells  # the cells it means to drive next, first the one it is in
    destination: tuple[float, float] | None  # of its claim
    told_round: int = -1  # what it decided in rounds up to this one, the frame tells
    claim_round: int = 0  # in which it claimed what it drives to, in 16 bits
    promises: bool = True  # it is of our fleet: its intent is all that it has committed itself to


def peer_motion(robot: int, frame: StateFrame, age_s: float, sent_round: int = -1) -> PeerMotion:
    """A peer's STATE, sent in sent_round and heard age_s ago, as motion.

    A STATE is composed at the end of the round before, and then tells what was decided up to that end.
    """
    claim = frame.claim
    return PeerMotion(
        robot=robot,
        x_m=frame.x_cm / 100.0,
        y_m=frame.y_cm / 100.0,
        speed_mps=frame.speed_2cmps / 50.0,
        age_s=age_s,
        intent=decode_intent(frame.intent_ix, frame.intent_iy, frame.intent_steps),
        destination=None if claim.slot == NO_SLOT else (claim.x_cm / 100.0, claim.y_cm / 100.0),
        told_round=sent_round - 2,
        claim_round=claim.round,
    )


def body_only(peer: PeerMotion, grid: OccupancyGrid) -> PeerMotion:
    """Of another map's robot: an obstacle where it says it is; its cells and goal mean nothing here."""
    cell = np.array([grid.cell_of(peer.x_m, peer.y_m)], np.int32)
    return replace(peer, intent=cell, destination=None, promises=False)


def encode_intent(cells: Cells) -> tuple[int, int, NDArray[np.uint8]]:
    """First cell (ix, iy) and at most 12 moves for STATE; the rest of the cells is not sent.

    A move is (dx+1) + 3 (dy+1) + 9 (dz+1); ground robots have dz = 0.
    """
    ix, iy = cells[0].tolist()
    return ix, iy, intent_steps(cells[: MAX_INTENT_STEPS + 1])


def decode_intent(ix: int, iy: int, steps: NDArray[np.uint8]) -> Cells:
    """The cells (K, 2) of an intent, first one included; height is left out. Not to be written to."""
    cells = intent_cells(ix, iy, steps)
    cells.flags.writeable = False
    return cells


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """Discs that others have taken, seen from where we are. T discs in all."""

    xy: Positions  # (T, 2)
    radius_m: NDArray[np.float64]  # (T,) our centre stays out; shrunk to our distance where we are inside
    from_s: NDArray[np.float64]  # (T,) the earliest time at which the peer may be there; 0: now
    robot: NDArray[np.int32]  # (T,) whose
    intended: NDArray[np.bool_]  # (T,) taken only because a peer with priority means to go there
    inside: NDArray[np.bool_]  # (T,) we are inside

    def only(self, kept: NDArray[np.bool_]) -> Taken:
        """The discs where kept is True."""
        return Taken(
            self.xy[kept],
            self.radius_m[kept],
            self.from_s[kept],
            self.robot[kept],
            self.intended[kept],
            self.inside[kept],
        )

    def physical(self) -> Taken:
        """Without the intents: only where peers are or may be before they could react."""
        return self.only(~self.intended)


def keep_out_m(config: Config) -> float:
    """Distance kept between two robots' centres."""
    return 2.0 * config.robot.radius_m + config.planning.peer_margin_m


def has_priority(peer: PeerMotion, own_id: int, own_wants: bool) -> bool:
    """True where the peer goes first."""
    return (peer.destination is None, peer.robot) < (not own_wants, own_id)


def reserve(
    peers: Sequence[PeerMotion],
    grid: OccupancyGrid,
    own_xy: tuple[float, float],
    own_wants: bool,
    config: Config,
    marks: Sequence[tuple[float, float]] = (),
) -> Taken:
    """All that is taken now. marks: (x, y) of unknown obstacles that the scan guard stopped us for."""
    out_m = keep_out_m(config)
    discs: list[float] = []  # COLUMNS to each: one flat list is an array much sooner than one of rows
    for peer in peers:
        _take_peer(discs, peer, grid, has_priority(peer, config.robot.id, own_wants), config, out_m)
    for x, y in marks:
        discs += (x, y, out_m / 2, 0.0, -1.0, 0.0)
    return Taken(*discs_from(np.array(discs, np.float64).reshape(-1, COLUMNS), *own_xy))


def committed(
    peers: Sequence[PeerMotion],
    reach_m: Sequence[float],
    grid: OccupancyGrid,
    from_xy: tuple[float, float],
    config: Config,
) -> Taken:
    """All that peers have committed themselves to, for ever, seen from from_xy.

    reach_m: for each peer, how much longer its commitment may be than what was heard
    """
    out_m = keep_out_m(config)
    rows = []
    for peer, more_m in zip(peers, reach_m, strict=True):
        rows.append((peer.x_m, peer.y_m, 0.0, peer.robot))
        places = [grid.centre_of(ix, iy) for ix, iy in peer.intent.tolist()]
        rows += [(x, y, 0.0, peer.robot) for x, y in places[:-1]]
        rows += [(x, y, more_m, peer.robot) for x, y in places[-1:]]
    table = np.array(rows, np.float64).reshape(-1, 4)
    distance_m = np.hypot(table[:, 0] - from_xy[0], table[:, 1] - from_xy[1])
    # Who is too near already may move away; but not within reach of what was not heard.
    inside = (distance_m < out_m) & (table[:, 2] == 0.0)
    radius_m = np.where(inside, np.maximum(distance_m - TOLERANCE_M, 0.0), out_m + table[:, 2])
    now, never = np.zeros(len(table)), np.zeros(len(table), np.bool_)
    return Taken(
        np.ascontiguousarray(table[:, :2]), radius_m, now, table[:, 3].astype(np.int32), never, inside
    )


def _take_peer(
    discs: list[float], peer: PeerMotion, grid: OccupancyGrid, priority: bool, config: Config, out_m: float
) -> None:
    """Its discs: where it is, where it may be before it reacts, and what it intends if it has priority."""
    limits = config.limits
    age_s, robot = peer.age_s, float(peer.robot)
    growth_m = 0.0
    if FRESH_S < age_s < FORGET_GROWTH_S:
        growth_m = min(limits.speed_mps * (age_s - FRESH_S), MAX_GROWTH_M)
    speed = min(limits.speed_mps, peer.speed_mps + limits.accel_mps2 * age_s)
    committed_m = speed * min(age_s, FRESH_S) + speed * speed / (2.0 * limits.accel_mps2) + COMMITTED_M
    x, y = peer.x_m, peer.y_m
    discs += (x, y, out_m + growth_m, 0.0, robot, 0.0)
    keeps_intent = priority and age_s <= config.planning.peer_stale_s
    origin_x, origin_y, side_m = grid.origin_x_m, grid.origin_y_m, grid.resolution_m
    along_m = 0.0
    for ix, iy in peer.intent.tolist():
        last_x, last_y = x, y
        # What grid.centre_of says, without a call: this is asked for at every tick.
        x, y = origin_x + (ix + 0.5) * side_m, origin_y + (iy + 0.5) * side_m
        along_m += math.hypot(x - last_x, y - last_y)
        if along_m <= committed_m:
            discs += (x, y, out_m + growth_m, 0.0, robot, 0.0)
        elif keeps_intent:
            discs += (x, y, out_m, max(along_m / limits.speed_mps - age_s, 0.0), robot, 1.0)
        else:
            break


def free_stretch(
    taken: Taken, points: Positions, at_s: NDArray[np.float64], slack_s: float
) -> tuple[int, int]:
    """How many of the path's next points are ours, and whose disc ends the stretch (-1: nobody's).

    points: (n, 2) in driving order   at_s: (n,) when we would be there
    Crossing an intent is allowed where the crossing is over slack_s before its owner can be there; otherwise
    the stretch ends before the crossing begins, so that nobody waits in the middle of another's way.
    """
    return stretch(points, at_s, slack_s, taken.xy, taken.radius_m, taken.from_s, taken.robot)


def taken_cells(xy: Positions, radius_m: NDArray[np.float64], grid: OccupancyGrid) -> NDArray[np.bool_]:
    """(H, W): cells whose centre lies inside one of the discs."""
    mask = np.zeros(grid.cells.shape, bool)
    # Disc centres and radii in cells, counted from the centre of cell (0, 0).
    middle_x = ((xy[:, 0] - grid.origin_x_m) / grid.resolution_m - 0.5).tolist()
    middle_y = ((xy[:, 1] - grid.origin_y_m) / grid.resolution_m - 0.5).tolist()
    radii = (radius_m / grid.resolution_m).tolist()
    for cx, cy, r in zip(middle_x, middle_y, radii, strict=True):
        x0, x1 = max(math.ceil(cx - r), 0), min(math.floor(cx + r) + 1, grid.width)
        y0, y1 = max(math.ceil(cy - r), 0), min(math.floor(cy + r) + 1, grid.height)
        if x0 < x1 and y0 < y1:
            dx2 = (np.arange(x0, x1) - cx) ** 2
            dy2 = (np.arange(y0, y1) - cy) ** 2
            mask[y0:y1, x0:x1] |= dx2 + dy2[:, None] < r * r
    return mask
