"""One random world of the pool: boxes on the ground, task sites and start cells. Knows cells, not travel times.

Every number is a hash of (seed, split, world), so that a world is the same on every machine and version.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.pure_hash import hash_many
from hippomat_core.errors import ConfigError
from hippomat_core.planning.field3d import UNREACHED, CellSpace, cell_space, distance_field_3d
from hippomat_sim.learn.settings import UAV, UGV, WorldSettings

CELL_M = 1.0
_BOXES, _GROUND_PLACES, _AIR_PLACES = range(3)  # what a number is drawn for


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """Cells are [ix, iy, iz] of CELL_M; iz = 0 is the ground. Each class can reach all its cells from each."""

    free: NDArray[np.bool_]  # (Z, Y, X)
    spaces: tuple[CellSpace, CellSpace]  # where UGVs and where UAVs move
    sites: NDArray[np.int16]  # (S, 3), the airborne ones last
    starts: NDArray[np.int16]  # (2, V, 3) per vehicle class, none of them a site


def checked(settings: WorldSettings) -> WorldSettings:
    """The settings, or a ConfigError that names the value which cannot be."""
    s = settings
    smallest = {"obstacles": 0, "airborne_sites": 0, "sites": 1, "starts": 1, "worlds": 1}
    for name, least in smallest.items():
        if getattr(s, name) < least:
            raise ConfigError(f"world {name} = {getattr(s, name)}: must be at least {least}")
    if len(s.size_m) != 3 or min(s.size_m) < 1:
        raise ConfigError(f"world size_m = {s.size_m}: give three lengths of at least 1 m")
    if s.airborne_sites > s.sites:
        raise ConfigError(f"world airborne_sites = {s.airborne_sites}: at most sites = {s.sites}")
    if s.airborne_sites and s.size_m[2] < 2:
        raise ConfigError(
            f"world airborne_sites = {s.airborne_sites}: size_m = {s.size_m} has no air above it"
        )
    for name in ("ugv_speed_mps", "uav_speed_mps"):
        if not getattr(s, name) > 0.0:
            raise ConfigError(f"world {name} = {getattr(s, name)}: must be above 0")
    for name in ("obstacle_side_m", "obstacle_height_m"):
        low, high = getattr(s, name)
        if not 1 <= low <= high:
            raise ConfigError(f"world {name} = {(low, high)}: give 1 <= lowest <= highest")
    return s


def make_world(settings: WorldSettings, split: int, index: int) -> World:
    """World `index` of a pool. ConfigError where the obstacles leave too little room."""
    key = (settings.seed, split, index)
    free = _without_boxes(settings, key)
    ground = cell_space(_largest_part(free[:1]))
    air = cell_space(_part_of(free, _cells(ground.free)[0]))
    on_ground = _shuffled(_cells(ground.free), (*key, _GROUND_PLACES))
    in_air = _shuffled(_cells(air.free), (*key, _AIR_PLACES))
    airborne = settings.airborne_sites
    landed = settings.sites - airborne
    _check_room(settings, index, len(on_ground), int(np.count_nonzero(in_air[:, 2] > 0)))
    sites = np.concatenate([on_ground[:landed], in_air[in_air[:, 2] > 0][:airborne]])
    taken = {tuple(site) for site in sites.tolist()}
    left_in_air = in_air[[tuple(cell) not in taken for cell in in_air.tolist()]]
    starts = np.zeros((2, settings.starts, 3), np.int16)
    starts[UGV] = on_ground[landed : landed + settings.starts]
    starts[UAV] = left_in_air[: settings.starts]
    return World(free, (ground, air), sites, starts)


def _check_room(settings: WorldSettings, index: int, ground_cells: int, air_cells: int) -> None:
    landed = settings.sites - settings.airborne_sites
    lacking = ground_cells < landed + settings.starts or air_cells < settings.airborne_sites + settings.starts
    if lacking:
        raise ConfigError(
            f"world {index} of seed {settings.seed} has {ground_cells} free ground cells and {air_cells} in the air,"
            f" too few for {landed} + {settings.airborne_sites} sites and {settings.starts} starts per class:"
            f" enlarge size_m = {settings.size_m} or take fewer obstacles, sites or starts"
        )


def _without_boxes(settings: WorldSettings, key: tuple[int, ...]) -> NDArray[np.bool_]:
    """(Z, Y, X) free cells. A box keeps its drawn size where it fits, and is cut off at the walls elsewhere."""
    width, height, layers = settings.size_m
    free = np.ones((layers, height, width), np.bool_)
    draws = hash_many(5 * settings.obstacles, *key, _BOXES).reshape(-1, 5)
    for x, y, side_x, side_y, top in draws.tolist():
        dx, dy = _within(side_x, settings.obstacle_side_m), _within(side_y, settings.obstacle_side_m)
        # The centre is even over the world: the rim is as full as the middle.
        x0, y0 = x % width - dx // 2, y % height - dy // 2
        z1 = _within(top, settings.obstacle_height_m)
        free[:z1, max(y0, 0) : y0 + dy, max(x0, 0) : x0 + dx] = False
    return free


def _within(draw: int, bounds: tuple[int, int]) -> int:
    low, high = bounds
    return low + draw % (high - low + 1)


def _cells(free: NDArray[np.bool_]) -> NDArray[np.int16]:
    """(K, 3) [ix, iy, iz] of the free cells in their order in memory."""
    return np.argwhere(free)[:, ::-1].astype(np.int16)


def _shuffled(cells: NDArray[np.int16], key: tuple[int, ...]) -> NDArray[np.int16]:
    return cells[np.argsort(hash_many(len(cells), *key), kind="stable")]


def _part_of(free: NDArray[np.bool_], cell: NDArray[np.int16]) -> NDArray[np.bool_]:
    """The free cells that can be reached from `cell`."""
    ix, iy, iz = (int(value) for value in cell)
    return distance_field_3d(cell_space(free), (ix, iy, iz)) != UNREACHED


def _largest_part(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest set of free cells that reach one another, the first found of equal ones; all False if none."""
    largest, rest = np.zeros_like(free), free.copy()
    while np.count_nonzero(rest) > np.count_nonzero(largest):
        part = _part_of(free, _cells(rest)[0])
        rest &= ~part
        if np.count_nonzero(part) > np.count_nonzero(largest):
            largest = part
    return largest
