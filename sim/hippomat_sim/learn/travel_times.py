"""Travel times [ms] between the cells of a world: shortest path / speed. Keeps nothing."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import ConfigError
from hippomat_core.planning.field3d import distance_field_3d
from hippomat_core.planning.graph import STRAIGHT, UNREACHED
from hippomat_sim.learn.settings import UAV, UGV, WorldSettings
from hippomat_sim.learn.worlds import CELL_M, World

UNREACHABLE_MS = 65535

Cell = tuple[int, int, int]
Progress = Callable[[int, int], None]  # (done, total)


def travel_times(
    settings: WorldSettings, worlds: Sequence[World], progress: Progress | None
) -> NDArray[np.uint16]:
    """(W, 2, V + S, S) [class, place, site]. progress(done, total) counts distance fields."""
    sites = settings.sites
    times = np.empty((len(worlds), 2, settings.starts + sites, sites), np.uint16)
    done, total = 0, 2 * len(worlds) * sites
    # Threads help: fields are filled without the interpreter's lock.
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        for (index, world), vehicle in product(enumerate(worlds), (UGV, UAV)):
            columns = threads.map(partial(_column, settings, world, vehicle), world.sites)
            for site, column in enumerate(columns):
                times[index, vehicle, :, site] = column
                done += 1
                if progress is not None:
                    progress(done, total)
    return times


def _column(
    settings: WorldSettings, world: World, vehicle: int, site: NDArray[np.int16]
) -> NDArray[np.uint16]:
    """(V + S,) from every place of the class to one site."""
    places = np.concatenate([world.starts[vehicle], world.sites])
    return times_ms(settings, vehicle, distance_field_3d(world.spaces[vehicle], as_cell(site)), places)


def times_ms(
    settings: WorldSettings, vehicle: int, units: NDArray[np.int32], cells: NDArray[np.int16]
) -> NDArray[np.uint16]:
    """(K,) travel times [ms] from cells (K, 3) to the goal of a distance field of this class's space.

    UNREACHABLE_MS where there is no way. ConfigError where a way is longer than a pool can hold.
    """
    ix, iy, iz = cells.T
    inside = iz < len(units)  # the ground has one layer, and an airborne site lies above it
    found = np.where(inside, units[np.where(inside, iz, 0), iy, ix], UNREACHED)
    reached = found != UNREACHED
    times = np.rint(np.where(reached, found, 0) * ms_per_unit(settings, vehicle))
    longest = float(times.max(initial=0.0))
    if longest >= UNREACHABLE_MS:
        raise ConfigError(
            f"world size_m = {settings.size_m}: a way of {longest / 1000.0:.0f} s, a pool holds up to 65 s: "
            f"take a smaller world, fewer obstacles or more than {_speed_mps(settings, vehicle):g} m/s"
        )
    return np.where(reached, times, UNREACHABLE_MS).astype(np.uint16)


def ms_per_unit(settings: WorldSettings, vehicle: int) -> float:
    """Travel time per unit of a distance field (1 / STRAIGHT of a cell's side)."""
    return 1000.0 * CELL_M / (_speed_mps(settings, vehicle) * STRAIGHT)


def as_cell(cell: NDArray[np.int16]) -> Cell:
    """[ix, iy, iz] as plain integers."""
    ix, iy, iz = cell.tolist()
    return ix, iy, iz


def _speed_mps(settings: WorldSettings, vehicle: int) -> float:
    return settings.uav_speed_mps if vehicle == UAV else settings.ugv_speed_mps
