"""Where tasks may stand: sites on the free, reachable cells of the map, at least two diameters apart.

The same mask, seed and sizes give the same sites, shares and order on every robot. Knows no generations'
history and no claims. Positions in the fleet frame (x east, y north), centimetres.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.pure_hash import hash_many
from hippomat_core.errors import ConfigError, MapError

_ROUNDING_M = 0.015  # positions are rounded to a centimetre on both axes
_SHARE, _ORDER = 1, 2  # what a hash is for


def task_sites(
    free: NDArray[np.bool_], resolution_m: float, origin_x_m: float, origin_y_m: float, radius_m: float
) -> NDArray[np.int16]:
    """(S, 3) int16 centimetres: cell centres, taken row by row, no two nearer than four radii.

    free: (H, W) bool [iy, ix], True where a robot can stand and be reached.  origin: the lower left corner.
    """
    gap_m = 4.0 * radius_m + _ROUNDING_M
    reach = math.ceil(gap_m / resolution_m)
    offsets = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) * resolution_m < gap_m
    height, width = free.shape
    left = np.pad(free, reach)  # cells still to be taken, with a margin so that discs need no clipping
    chosen = []
    for iy in range(height):
        row = left[iy + reach]
        ix = 0
        while (step := int(np.argmax(row[ix + reach : width + reach]))) or row[ix + reach]:
            ix += step
            chosen.append((ix, iy))
            left[iy : iy + 2 * reach + 1, ix : ix + 2 * reach + 1] &= ~offsets
    cells = np.asarray(chosen, np.float64).reshape(-1, 2)
    centres_cm = 100.0 * ((cells + 0.5) * resolution_m + [origin_x_m, origin_y_m])
    if np.abs(centres_cm).max(initial=0.0) > np.iinfo(np.int16).max:
        raise MapError("map reaches beyond 327 m from its origin, too far for int16 centimetres: crop it")
    sites = np.zeros((len(cells), 3), np.int16)
    sites[:, :2] = np.rint(centres_cm)
    return sites


def check_sites(sites: NDArray[np.int16], slots: int) -> None:
    """ConfigError unless every slot can have two sites, so that its successive tasks differ in place."""
    if len(sites) < 2 * slots:
        raise ConfigError(
            f"the map has room for {len(sites)} task sites, {2 * slots} are needed for [fleet] task_slots = "
            f"{slots}: lower it to {len(sites) // 2} or less, or use a larger map"
        )


def slot_site(
    sites: NDArray[np.int16], seed: int, slots: int, slot: int, generation: int
) -> NDArray[np.int16]:
    """(3,) position of the task of (slot, generation), from the slot's own share of the sites.

    A slot goes round its share in a fresh order each time, so that a place comes back as late as it can.
    """
    share = np.argsort(hash_many(len(sites), _SHARE, seed), kind="stable")[slot::slots]
    cycle, step = divmod(generation, len(share))
    position: NDArray[np.int16] = sites[share[_cycle_order(seed, slot, cycle, len(share))[step]]]
    return position


def _cycle_order(seed: int, slot: int, cycle: int, size: int) -> list[int]:
    if size < 3:
        return list(range(size))

    def shuffled(which: int) -> list[int]:
        order: list[int] = np.argsort(hash_many(size, _ORDER, seed, slot, which), kind="stable").tolist()
        return order

    order = shuffled(cycle)
    if cycle > 0 and order[0] == shuffled(cycle - 1)[-1]:  # the swap below never moves a last place
        order[0], order[1] = order[1], order[0]
    return order
