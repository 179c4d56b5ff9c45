"""r_i of the paper (section "Independent Training"), compiled: what one agent is paid for one step.

    assigned at cost c            -c, and +low_cost_bonus where c <= low_cost
    another one got the task      -conflict
    idle without a valid reason   -idle: no (possible) request although a task was open and reachable
    request while not done        -busy_request

Costs in units of c_max, as the agents know them: by their code. R(t) is the sum over the agents.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from hippomat_core.allocation.quantise import FULL_SCALE
from hippomat_sim.learn.settings import RewardSettings

WON, LOST, IDLE, EXCUSED, BUSY, BUSY_ASKED = range(6)  # what became of an agent in a step


class Prices(NamedTuple):
    """RewardSettings as compiled code reads them."""

    conflict: float
    idle: float
    low_cost_bonus: float
    low_cost: float
    busy_request: float


def prices(settings: RewardSettings) -> Prices:
    return Prices(*(float(getattr(settings, name)) for name in Prices._fields))


@njit(nogil=True, inline="always")
def reward(price: Prices, fate: int, code: int) -> np.float32:
    """code: of the cost of the task won, 0 .. 254."""
    if fate == WON:
        share = code / FULL_SCALE
        cost = share * share
        return np.float32(price.low_cost_bonus - cost if cost <= price.low_cost else -cost)
    if fate == LOST:
        return np.float32(-price.conflict)
    if fate == IDLE:
        return np.float32(-price.idle)
    if fate == BUSY_ASKED:
        return np.float32(-price.busy_request)
    return np.float32(0.0)
