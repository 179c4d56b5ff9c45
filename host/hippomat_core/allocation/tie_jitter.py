"""Less than half a step of cost for every agent and slot, so that equal codes do not make equal agents.

The same on every robot: a hash of the robot's row and the slot. Networks alone use it; requests and claims
settle ties by (cost, id).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import MAX_ROBOTS, MAX_TASK_SLOTS

AMPLITUDE = 0.4  # of a code step, to either side


def _table() -> NDArray[np.float32]:
    rows = np.arange(MAX_ROBOTS, dtype=np.uint64)[:, None]
    columns = np.arange(MAX_TASK_SLOTS, dtype=np.uint64)[None, :]
    mixed = (rows * np.uint64(MAX_TASK_SLOTS) + columns + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    share = ((mixed ^ (mixed >> np.uint64(31))) >> np.uint64(40)).astype(np.float64) / 2.0**24
    table = (AMPLITUDE * (2.0 * share - 1.0)).astype(np.float32)
    table.flags.writeable = False
    return table


_JITTER = _table()  # (64, 80)


def code_jitter(robots: int, tasks: int) -> NDArray[np.float32]:
    """(N, M) in steps of the cost code, within +-AMPLITUDE."""
    if robots > MAX_ROBOTS or tasks > MAX_TASK_SLOTS:
        raise ValueError(
            f"{robots} x {tasks} is more than {MAX_ROBOTS} robots and {MAX_TASK_SLOTS} task slots"
        )
    return _JITTER[:robots, :tasks]
