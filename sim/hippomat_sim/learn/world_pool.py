"""Worlds with every travel time between their places: what an environment needs to price a task.

Travel time = shortest path / speed, in whole milliseconds. Decides on nothing; knows no agent and no task.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.quantise import quantise
from hippomat_core.errors import ConfigError
from hippomat_core.planning.field3d import STRAIGHT, UNREACHED, CellSpace, distance_field_3d, way_down
from hippomat_sim.learn.recent import Recent
from hippomat_sim.learn.settings import UAV, UGV, WorldSettings
from hippomat_sim.learn.worlds import CELL_M, World, checked, make_world

UNREACHABLE_MS = 65535
SPLITS = ("train", "test")  # pools of different worlds from the same settings
_KEPT_FIELDS = 128

Cell = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class WorldPool:
    """W worlds. A place is one of a class's V starts (0 .. V - 1) or a site (V .. V + S - 1).

    Cells are [ix, iy, iz] of 1 m, iz = 0 the ground. Classes: UGV = 0, UAV = 1.
    """

    settings: WorldSettings
    split: str
    travel_ms: NDArray[
        np.uint16
    ]  # (W, 2, V + S, S) [class, place, site], UNREACHABLE_MS where there is no way
    places_cell: NDArray[np.int16]  # (W, 2, V + S, 3)
    airborne: NDArray[np.bool_]  # (W, S): out of reach for UGVs
    c_max_s: float  # the longest finite travel time of the pool, rounded up to whole seconds
    code_of_ms: NDArray[np.uint8]  # (65536,) the code that a robot broadcasts for a travel time
    hash: str  # of the settings, the split and every array
    spaces: tuple[tuple[CellSpace, CellSpace], ...]  # (W, 2) where each class moves
    _fields: Recent[tuple[int, int, Cell], NDArray[np.int32]] = field(
        default_factory=lambda: Recent(_KEPT_FIELDS), repr=False
    )

    def cell_along(
        self, world: int, vehicle: int, place: int, site: int, elapsed_ms: int
    ) -> NDArray[np.int16]:
        """(3,) the cell in which a robot is, `elapsed_ms` after it left `place` for `site`. See cell_on_way."""
        return self.cell_on_way(world, vehicle, self.places_cell[world, vehicle, place], site, elapsed_ms)

    def cell_on_way(
        self, world: int, vehicle: int, cell: NDArray[np.int16], site: int, elapsed_ms: int
    ) -> NDArray[np.int16]:
        """(3,) of one shortest way from `cell` to `site`: the cell nearest in time; the site after arrival.

        ValueError where there is no way.
        """
        goal = _cell(self.places_cell[world, vehicle, self.settings.starts + site])
        to_site = self._field(world, vehicle, goal)
        way = way_down(self.spaces[world][vehicle], to_site, _cell(cell))
        if not way:
            raise ValueError(f"no way for class {vehicle} from {_cell(cell)} to site {site} of world {world}")
        left_ms = np.array([to_site[iz, iy, ix] for ix, iy, iz in way]) * ms_per_unit(self.settings, vehicle)
        nearest = int(np.argmin(np.abs(left_ms[0] - left_ms - elapsed_ms)))
        return np.array(way[nearest], np.int16)

    def row_from(self, world: int, vehicle: int, cell: NDArray[np.int16]) -> NDArray[np.uint16]:
        """(S,) travel times [ms] from any cell to every site."""
        sites = self.places_cell[world, vehicle, self.settings.starts :]
        return _times_ms(self.settings, vehicle, self._field(world, vehicle, _cell(cell)), sites)

    def _field(self, world: int, vehicle: int, cell: Cell) -> NDArray[np.int32]:
        space = self.spaces[world][vehicle]
        return self._fields.get((world, vehicle, cell), lambda: distance_field_3d(space, cell))


def make_pool(
    settings: WorldSettings,
    split: str = "train",
    progress: Callable[[int, int], None] | None = None,
    cache: bool = True,
) -> WorldPool:
    """The pool of these settings, from the disk if it was made before. progress(done, total) counts worlds.

    ConfigError for settings that cannot be, or that leave no room for the places.
    """
    if split not in SPLITS:
        raise ConfigError(f"split = {split!r}: must be one of {', '.join(SPLITS)}")
    checked(settings)
    worlds, travel = [], []
    for index in range(settings.worlds):
        worlds.append(make_world(settings, SPLITS.index(split), index))
        travel.append(_travel_ms(settings, worlds[-1]))
        if progress is not None:
            progress(index + 1, settings.worlds)
    return _pool(settings, split, worlds, np.stack(travel))


def ms_per_unit(settings: WorldSettings, vehicle: int) -> float:
    """Travel time per unit of a distance field (1 / STRAIGHT of a cell's side)."""
    speed_mps = settings.uav_speed_mps if vehicle == UAV else settings.ugv_speed_mps
    return 1000.0 * CELL_M / (speed_mps * STRAIGHT)


def _pool(
    settings: WorldSettings, split: str, worlds: list[World], travel_ms: NDArray[np.uint16]
) -> WorldPool:
    sites = np.stack([world.sites for world in worlds])
    starts = np.stack([world.starts for world in worlds])
    places = np.concatenate([starts, np.stack([sites, sites], axis=1)], axis=2)
    airborne = np.zeros(sites.shape[:2], np.bool_)
    airborne[:, settings.sites - settings.airborne_sites :] = True
    digest = hashlib.sha256(repr((settings, split)).encode())
    for array in (travel_ms, places):
        digest.update(np.ascontiguousarray(array).tobytes())
    c_max_s = float(math.ceil(travel_ms[travel_ms != UNREACHABLE_MS].max() / 1000.0))
    return WorldPool(
        settings, split, travel_ms, places, airborne, c_max_s, _codes(c_max_s), digest.hexdigest(),
        tuple(world.spaces for world in worlds),
    )  # fmt: skip


def _codes(c_max_s: float) -> NDArray[np.uint8]:
    times_s = np.arange(UNREACHABLE_MS + 1) / 1000.0
    times_s[UNREACHABLE_MS] = np.inf
    return quantise(times_s, c_max_s)


def _travel_ms(settings: WorldSettings, world: World) -> NDArray[np.uint16]:
    """(2, V + S, S) of one world."""
    places = np.concatenate([world.starts, np.stack([world.sites, world.sites])], axis=1)
    times = np.empty((2, places.shape[1], len(world.sites)), np.uint16)
    for vehicle in (UGV, UAV):
        for site, cell in enumerate(world.sites):
            to_site = distance_field_3d(world.spaces[vehicle], _cell(cell))
            times[vehicle, :, site] = _times_ms(settings, vehicle, to_site, places[vehicle])
    return times


def _times_ms(
    settings: WorldSettings, vehicle: int, units: NDArray[np.int32], cells: NDArray[np.int16]
) -> NDArray[np.uint16]:
    """(K,) travel times [ms] of the cells (K, 3) in a distance field of this class."""
    ix, iy, iz = cells.T
    on_map = iz < len(units)
    found = np.where(on_map, units[np.where(on_map, iz, 0), iy, ix], UNREACHED)
    reached = found != UNREACHED
    times = np.rint(np.where(reached, found, 0) * ms_per_unit(settings, vehicle))
    if times.max(initial=0.0) >= UNREACHABLE_MS:
        raise ConfigError(
            f"a way of {times.max() / 1000.0:.0f} s: a pool holds travel times below 65.535 s, "
            f"so take a smaller size_m than {settings.size_m}, fewer obstacles or a higher speed"
        )
    return np.where(reached, times, UNREACHABLE_MS).astype(np.uint16)


def _cell(cell: NDArray[np.int16]) -> Cell:
    ix, iy, iz = (int(value) for value in cell)
    return ix, iy, iz
