"""The reservation table: (tick, place) -> robot, never two robots for one entry. Knows no goals.

A robot that moves holds both cells at every tick between its departure and its arrival, and the place halfway
from its departure on; whoever follows enters a cell no earlier than in the last tick of the leaver's move.
An open hash table, so that its size follows from the robots and the window, not from the map.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

NOBODY = -1
Keys = NDArray[np.int64]  # (2^k,), 0 where empty
Owners = NDArray[np.int32]  # (2^k,)


def table_size(robots: int, ticks: int) -> int:
    """A power of two that stays less than half full: four cells and one place halfway a robot and tick."""
    return 1 << (10 * robots * (ticks + 2)).bit_length()


@njit(cache=True, nogil=True, inline="always")
def _entry(keys: Keys, key: int) -> int:
    mask = len(keys) - 1
    # Fibonacci hashing; the product wraps around, its upper bits are well mixed.
    at = int((key * 0x1E3779B97F4A7C15 >> 29) & mask)
    while keys[at] != 0 and keys[at] != key:
        at = (at + 1) & mask
    return at


@njit(cache=True, nogil=True, inline="always")
def holder(keys: Keys, owners: Owners, span: int, tick: int, place: int) -> int:
    """Who holds a place at a tick, NOBODY if it is free. span: number of places."""
    key = int(tick) * span + place + 1
    at = _entry(keys, key)
    return owners[at] if keys[at] == key else NOBODY


@njit(cache=True, nogil=True, inline="always")
def hold(keys: Keys, owners: Owners, span: int, tick: int, place: int, robot: int) -> bool:
    """Enter a robot. False, and nothing changes, where another one holds the place at that tick."""
    key = int(tick) * span + place + 1
    at = _entry(keys, key)
    if keys[at] == key and owners[at] != NOBODY:
        return bool(owners[at] == robot)
    keys[at] = key
    owners[at] = robot
    return True


@njit(cache=True, nogil=True, inline="always")
def release(keys: Keys, owners: Owners, span: int, tick: int, place: int, robot: int) -> None:
    """Undo hold(). The entry stays in the chain of those that were stored after it, held by nobody."""
    key = int(tick) * span + place + 1
    at = _entry(keys, key)
    if keys[at] == key and owners[at] == robot:
        owners[at] = NOBODY
