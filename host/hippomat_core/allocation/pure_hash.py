"""Numbers that look random and are the same on every robot: a hash of integers (splitmix64, Steele 2014).

No generator with a state: the same arguments give the same number, on every machine and version.
"""

import numpy as np
from numpy.typing import NDArray

_MASK = (1 << 64) - 1


def _mixed(value: int) -> int:
    value = ((value ^ (value >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    value = ((value ^ (value >> 27)) * 0x94D049BB133111EB) & _MASK
    return value ^ (value >> 31)


def pure_hash(*values: int) -> int:
    """64 well mixed bits of a sequence of integers."""
    state = len(values)
    for value in values:
        state = _mixed((state + 0x9E3779B97F4A7C15 + (value & _MASK)) & _MASK)
    return state


def hash_many(count: int, *values: int) -> NDArray[np.uint64]:
    """(count,) hashes: pure_hash-like numbers of (values, 0), (values, 1) .. (values, count - 1)."""
    state = np.arange(count, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(pure_hash(*values))
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))


def hash_below(bound: int, *values: int) -> int:
    """An integer in 0 .. bound - 1, evenly spread over hashes (error below 2^-48 for bounds below 2^16)."""
    return pure_hash(*values) * bound >> 64
