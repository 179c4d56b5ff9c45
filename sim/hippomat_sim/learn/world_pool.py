"""Worlds with every travel time between their places: what an environment needs to price a task.

Travel time = shortest path / speed, in whole milliseconds. Decides on nothing; knows no agent and no task.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.quantise import quantise
from hippomat_core.errors import ConfigError
from hippomat_core.planning.field3d import CellSpace, cell_space, distance_field_3d, way_down
from hippomat_sim.learn import world_cache
from hippomat_sim.learn.recent import Recent
from hippomat_sim.learn.settings import UGV, WorldSettings
from hippomat_sim.learn.travel_times import (
    UNREACHABLE_MS,
    Cell,
    Progress,
    as_cell,
    ms_per_unit,
    times_ms,
    travel_times,
)
from hippomat_sim.learn.worlds import checked, make_world

SPLITS = ("train", "test")  # pools of different worlds from the same settings
FORMAT = 1  # of the pool: raise it whenever the same settings give other worlds or times
KEPT_FIELDS = 128  # about 300 kB each at 50 x 50 x 30
KEPT_SPACES = 32


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
    places_cell: NDArray[np.int16]  # (W, 2, V + S, 3), the last S the same for both classes
    free: NDArray[np.bool_]  # (W, Z, Y, X) where UAVs can be
    ground: NDArray[np.bool_]  # (W, Y, X) where UGVs can be
    airborne: NDArray[np.bool_]  # (W, S): sites out of reach for UGVs, the last of each world
    c_max_s: float  # the longest finite travel time of the pool, rounded up to whole seconds
    code_of_ms: NDArray[np.uint8]  # (65536,) the code that a robot broadcasts for a travel time
    hash: str  # SHA-256 of settings, split and contents
    _spaces: Recent[tuple[int, int], CellSpace] = field(
        default_factory=lambda: Recent(KEPT_SPACES), repr=False
    )
    _fields: Recent[tuple[int, int, Cell], NDArray[np.int32]] = field(
        default_factory=lambda: Recent(KEPT_FIELDS), repr=False
    )

    def cell_along(
        self, world: int, vehicle: int, place: int, site: int, elapsed_ms: int
    ) -> NDArray[np.int16]:
        """(3,) the cell where a robot is `elapsed_ms` after it left `place` for `site`. See cell_on_way."""
        return self.cell_on_way(world, vehicle, self.places_cell[world, vehicle, place], site, elapsed_ms)

    def cell_on_way(
        self, world: int, vehicle: int, cell: NDArray[np.int16], site: int, elapsed_ms: int
    ) -> NDArray[np.int16]:
        """(3,) of one shortest way from `cell` to `site`, the cell nearest in time; the site after arrival.

        What is left differs from travel time - elapsed by at most half a step. ValueError without a way.
        """
        goal = as_cell(self.places_cell[world, vehicle, self.settings.starts + site])
        to_site = self._field(world, vehicle, goal)
        way = way_down(self._space(world, vehicle), to_site, as_cell(cell))
        if len(way) == 0:
            raise ValueError(
                f"no way for class {vehicle} from {as_cell(cell)} to site {site} of world {world}"
            )
        left_units = to_site[way[:, 2], way[:, 1], way[:, 0]]
        gone_ms = (left_units[0] - left_units) * ms_per_unit(self.settings, vehicle)
        return cast("NDArray[np.int16]", way[np.argmin(np.abs(gone_ms - elapsed_ms))].astype(np.int16))

    def row_from(self, world: int, vehicle: int, cell: NDArray[np.int16]) -> NDArray[np.uint16]:
        """(S,) travel times [ms] from any cell to every site, UNREACHABLE_MS where there is no way."""
        sites = self.places_cell[world, vehicle, self.settings.starts :]
        return times_ms(self.settings, vehicle, self._field(world, vehicle, as_cell(cell)), sites)

    def _space(self, world: int, vehicle: int) -> CellSpace:
        return self._spaces.get(
            (world, vehicle),
            lambda: cell_space(self.ground[world][None] if vehicle == UGV else self.free[world]),
        )

    def _field(self, world: int, vehicle: int, cell: Cell) -> NDArray[np.int32]:
        return self._fields.get(
            (world, vehicle, cell), lambda: distance_field_3d(self._space(world, vehicle), cell)
        )


def make_pool(
    settings: WorldSettings,
    split: str = "train",
    progress: Progress | None = None,
    cache: bool | Path = True,
) -> WorldPool:
    """The pool of these settings, from the disk if it was made before.

    progress(done, total) counts distance fields. cache: False, or a directory other than the user's own.
    ConfigError for settings that cannot be, that leave no room, or with ways of more than 65 s.
    """
    if split not in SPLITS:
        raise ConfigError(f"world split = {split!r}: must be one of {', '.join(SPLITS)}")
    checked(settings)
    directory = cache if isinstance(cache, Path) else world_cache.user_directory()
    key = _key(settings, split)
    arrays = world_cache.load(directory, key) if cache else None
    if arrays is None:
        arrays = _prepare(settings, split, progress)
        if cache:
            world_cache.store(directory, key, arrays)
    return _pool(settings, split, key, arrays)


def _key(settings: WorldSettings, split: str) -> str:
    """Of everything that a pool is made from."""
    said = json.dumps([FORMAT, split, asdict(settings)], sort_keys=True)
    return hashlib.sha256(said.encode()).hexdigest()[:20]


def _prepare(
    settings: WorldSettings, split: str, progress: Progress | None
) -> dict[str, NDArray[np.generic]]:
    worlds = [make_world(settings, SPLITS.index(split), index) for index in range(settings.worlds)]
    return {
        "travel_ms": travel_times(settings, worlds, progress),
        "sites": np.stack([world.sites for world in worlds]),
        "starts": np.stack([world.starts for world in worlds]),
        "ground": np.stack([world.spaces[0].free[0] for world in worlds]),
        "free": np.stack([world.spaces[1].free for world in worlds]),
    }


def _pool(settings: WorldSettings, split: str, key: str, arrays: dict[str, NDArray[np.generic]]) -> WorldPool:
    digest = hashlib.sha256(key.encode())
    for name in sorted(arrays):
        digest.update(arrays[name].tobytes())
    travel_ms = cast("NDArray[np.uint16]", arrays["travel_ms"])
    longest_ms = int(travel_ms[travel_ms != UNREACHABLE_MS].max())
    c_max_s = float(max(1, math.ceil(longest_ms / 1000)))
    sites, starts = cast("NDArray[np.int16]", arrays["sites"]), cast("NDArray[np.int16]", arrays["starts"])
    airborne = np.zeros(sites.shape[:2], np.bool_)
    airborne[:, settings.sites - settings.airborne_sites :] = True
    return WorldPool(
        settings=settings,
        split=split,
        travel_ms=travel_ms,
        places_cell=np.concatenate([starts, np.stack([sites, sites], axis=1)], axis=2),
        free=cast("NDArray[np.bool_]", arrays["free"]),
        ground=cast("NDArray[np.bool_]", arrays["ground"]),
        airborne=airborne,
        c_max_s=c_max_s,
        code_of_ms=_codes(c_max_s),
        hash=digest.hexdigest(),
    )


def _codes(c_max_s: float) -> NDArray[np.uint8]:
    times_s = np.arange(UNREACHABLE_MS + 1) / 1000.0
    times_s[UNREACHABLE_MS] = np.inf
    return quantise(times_s, c_max_s)
