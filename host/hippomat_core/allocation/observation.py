"""The paper's observation x_i in R^(1+2M), from the quantised snapshot (HIPPO-MAT, graph network section).

x_i = [status, c_i1 .. c_iM, s_1 .. s_M]: status -1 idle, +1 assigned; costs in [-1, 1] (0 s .. c_max,
unreachable = 1); task flags +1 waiting, -1 otherwise. Training and the robots use this one function.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.quantise import FULL_SCALE
from hippomat_core.wire.frames import UNREACHABLE


def _normalised_costs() -> NDArray[np.float32]:
    codes = np.arange(256, dtype=np.float64)
    table = 2.0 * np.square(codes / FULL_SCALE) - 1.0
    table[UNREACHABLE] = 1.0
    normalised = table.astype(np.float32)
    normalised.flags.writeable = False
    return normalised


NORMALISED_COST = _normalised_costs()  # (256,) code -> [-1, 1]


def observations(
    costs_q: NDArray[np.uint8],
    assigned: NDArray[np.bool_],
    waiting: NDArray[np.bool_],
    present: NDArray[np.bool_] | None = None,
) -> NDArray[np.float32]:
    """x of every robot. costs_q: (N, M)  assigned: (N,)  waiting: (M,)  returns: (N, 1 + 2M) float32.

    Rows that are not present are all zero, so that they add nothing to a neighbourhood sum.
    """
    robots, tasks = costs_q.shape
    x = np.empty((robots, 1 + 2 * tasks), np.float32)
    x[:, 0] = np.where(assigned, 1.0, -1.0)
    x[:, 1 : 1 + tasks] = NORMALISED_COST[costs_q]
    x[:, 1 + tasks :] = np.where(waiting, 1.0, -1.0)
    if present is not None:
        x[~present] = 0.0
    return x
