"""One random world of the pool: boxes on the ground, task sites, start cells. Knows cells, not travel times.

Every number is a hash of (seed, split, world), so that a world is the same on every machine and version.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.pure_hash import hash_many
from hippomat_core.errors import ConfigError
from hippomat_core.planning.field3d import CellSpace, cell_space, distance_field_3d
from hippomat_core.planning.graph import UNREACHED
from hippomat_sim.learn.settings import UAV, UGV, WorldSettings

CELL_M = 1.0
_BOXES, _GROUND_PLACES, _AIR_PLACES = range(3)  # what a number is drawn for


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """Cells are [ix, iy, iz] of CELL_M, iz = 0 the ground. A class reaches every free cell of its space."""

    spaces: tuple[CellSpace, CellSpace]  # UGV: one layer, UAV: all of them
    sites: NDArray[np.int16]  # (S, 3), the airborne ones last
    starts: NDArray[np.int16]  # (2, V, 3) per class, none of them a site


def checked(settings: WorldSettings) -> WorldSettings:
    """The settings, or a ConfigError that names the value which cannot be."""
    least = {"obstacles": 0, "airborne_sites": 0, "sites": 1, "starts": 1, "worlds": 1}
    for name, bound in least.items():
        if getattr(settings, name) < bound:
            raise ConfigError(f"world {name} = {getattr(settings, name)}: must be at least {bound}")
    for name in ("ugv_speed_mps", "uav_speed_mps"):
        speed_mps = getattr(settings, name)
        if not (speed_mps > 0.0 and math.isfinite(speed_mps)):
            raise ConfigError(f"world {name} = {speed_mps}: must be above 0 and finite")
    for name in ("obstacle_side_m", "obstacle_height_m"):
        bounds = getattr(settings, name)
        if len(bounds) != 2 or not 1 <= bounds[0] <= bounds[1]:
            raise ConfigError(f"world {name} = {bounds}: give two lengths, 1 <= lowest <= highest")
    size_m, airborne = settings.size_m, settings.airborne_sites
    if len(size_m) != 3 or min(size_m) < 1:
        raise ConfigError(f"world size_m = {size_m}: give three lengths of at least 1 m")
    if airborne > settings.sites:
        raise ConfigError(f"world airborne_sites = {airborne}: at most sites = {settings.sites}")
    if airborne and size_m[2] < 2:
        raise ConfigError(
            f"world airborne_sites = {airborne}: size_m = {size_m} has no layer above the ground"
        )
    return settings


def make_world(settings: WorldSettings, split: int, index: int) -> World:
    """World `index` of a pool. ConfigError where the obstacles leave too little room."""
    key = (settings.seed, split, index)
    ground, air = _spaces(_without_boxes(settings, key))
    on_ground = _shuffled(_cells(ground.free), (*key, _GROUND_PLACES))
    in_air = _shuffled(_cells(air.free), (*key, _AIR_PLACES))
    above = in_air[in_air[:, 2] > 0]
    _check_room(settings, index, len(on_ground), len(above))
    landed = settings.sites - settings.airborne_sites
    sites = np.concatenate([on_ground[:landed], above[: settings.airborne_sites]])
    starts = np.empty((2, settings.starts, 3), np.int16)
    starts[UGV] = on_ground[landed : landed + settings.starts]
    starts[UAV] = _others(in_air, sites)[: settings.starts]
    return World((ground, air), sites, starts)


def _check_room(settings: WorldSettings, index: int, ground_cells: int, air_cells: int) -> None:
    airborne, starts = settings.airborne_sites, settings.starts
    landed = settings.sites - airborne
    lacks_ground = ground_cells < landed + starts
    lacks_air = air_cells < airborne or ground_cells + air_cells < settings.sites + starts
    if lacks_ground or lacks_air:
        raise ConfigError(
            f"world {index} of seed {settings.seed} has {ground_cells} connected free cells on the ground, "
            f"{air_cells} above: no room for {landed} + {airborne} sites and {starts} starts per class; "
            f"enlarge size_m = {settings.size_m}, or take fewer obstacles, sites or starts"
        )


def _without_boxes(settings: WorldSettings, key: tuple[int, ...]) -> NDArray[np.bool_]:
    """(Z, Y, X) free cells. Boxes may overlap; what sticks out of the world is cut off."""
    width, height, layers = settings.size_m
    free = np.ones((layers, height, width), np.bool_)
    draws = hash_many(5 * settings.obstacles, *key, _BOXES).reshape(-1, 5)
    for x, y, side_x, side_y, top in draws.tolist():
        dx, dy = _within(side_x, settings.obstacle_side_m), _within(side_y, settings.obstacle_side_m)
        # Centres, not corners, are even over the world: all four rims are alike.
        x0, y0 = x % width - dx // 2, y % height - dy // 2
        dz = _within(top, settings.obstacle_height_m)
        free[:dz, max(y0, 0) : max(y0 + dy, 0), max(x0, 0) : max(x0 + dx, 0)] = False
    return free


def _within(draw: int, bounds: tuple[int, int]) -> int:
    low, high = bounds
    return low + draw % (high - low + 1)


def _spaces(free: NDArray[np.bool_]) -> tuple[CellSpace, CellSpace]:
    """Where UGVs move: the largest connected part of the ground; and UAVs: all that is connected with it."""
    ground = _largest_part(free[:1])
    air = np.zeros_like(free)
    if ground.any():
        air = _part_of(free, _cells(ground)[0])
    return cell_space(ground), cell_space(air)


def _cells(free: NDArray[np.bool_]) -> NDArray[np.int16]:
    """(K, 3) [ix, iy, iz] of the free cells, in their order in memory."""
    return np.argwhere(free)[:, ::-1].astype(np.int16)


def _shuffled(cells: NDArray[np.int16], key: tuple[int, ...]) -> NDArray[np.int16]:
    return cells[np.argsort(hash_many(len(cells), *key), kind="stable")]


def _others(cells: NDArray[np.int16], taken: NDArray[np.int16]) -> NDArray[np.int16]:
    """The cells (K, 3) that are not among `taken`, in their order."""
    names = {tuple(cell) for cell in taken.tolist()}
    return cells[[tuple(cell) not in names for cell in cells.tolist()]]


def _part_of(free: NDArray[np.bool_], cell: NDArray[np.int16]) -> NDArray[np.bool_]:
    """The free cells from which `cell` can be reached."""
    ix, iy, iz = cell.tolist()
    reached: NDArray[np.bool_] = distance_field_3d(cell_space(free), (ix, iy, iz)) != UNREACHED
    return reached


def _largest_part(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest set of free cells that reach one another, the first of equals; all False if none is."""
    largest, rest = np.zeros_like(free), free.copy()
    while np.count_nonzero(rest) > np.count_nonzero(largest):
        part = _part_of(free, _cells(rest)[0])
        rest &= ~part
        if np.count_nonzero(part) > np.count_nonzero(largest):
            largest = part
    return largest
