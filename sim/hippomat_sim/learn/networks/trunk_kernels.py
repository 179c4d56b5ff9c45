"""Log-softmax of the attention heads over rows and columns, and its gradient, compiled. float32.

Snapshots are the innermost axis: a loop over them is vector code, however small the fleet is. What the heads
mean is said in graphsage.py; torch's own operations give the same there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from hippomat_core.allocation.graphsage_settings import SHARE_SIZE, WEAKEST_SHARE
from hippomat_core.allocation.vector_math import exp_32, log_64

_WEAKEST = np.float32(WEAKEST_SHARE)
_SIZE = np.float32(SHARE_SIZE)
NOTHING = np.float32(-1e9)  # q of an edge that is not valid
_VALID = np.float32(-5e8)  # every q above belongs to a valid edge


@njit(cache=True, nogil=True)
def shares_forward(q: Any, row_sums: Any, column_sums: Any, rows: Any, columns: Any) -> None:
    """q, rows, columns: (heads, N, M, B)  row_sums: (heads, N, B)  column_sums: (heads, M, B).

    Writes log sum exp of q along M and N, and the shares: held from below and brought to size.
    """
    heads, n, m, b = q.shape
    most = np.empty(b, np.float32)
    total = np.empty(b, np.float32)
    for h in range(heads):
        for i in range(n):
            most[:] = q[h, i, 0]
            for j in range(1, m):
                for s in range(b):
                    most[s] = max(most[s], q[h, i, j, s])
            total[:] = np.float32(0.0)
            for j in range(m):
                for s in range(b):
                    total[s] += exp_32(q[h, i, j, s] - most[s])
            for s in range(b):
                row_sums[h, i, s] = most[s] + np.float32(log_64(np.float64(total[s])))
            for j in range(m):
                for s in range(b):
                    rows[h, i, j, s] = _share(q[h, i, j, s], row_sums[h, i, s])
        for j in range(m):
            most[:] = q[h, 0, j]
            for i in range(1, n):
                for s in range(b):
                    most[s] = max(most[s], q[h, i, j, s])
            total[:] = np.float32(0.0)
            for i in range(n):
                for s in range(b):
                    total[s] += exp_32(q[h, i, j, s] - most[s])
            for s in range(b):
                column_sums[h, j, s] = most[s] + np.float32(log_64(np.float64(total[s])))
            for i in range(n):
                for s in range(b):
                    columns[h, i, j, s] = _share(q[h, i, j, s], column_sums[h, j, s])


@njit(cache=True, nogil=True, inline="always")
def _share(q: Any, log_sum: Any) -> Any:
    share = q - log_sum
    return (share if q > _VALID and share > _WEAKEST else _WEAKEST) * _SIZE


@njit(cache=True, nogil=True, inline="always")
def _softmax(q: Any, log_sum: Any) -> Any:
    share = exp_32(q - log_sum)
    return share if q > _VALID else np.float32(0.0)  # subnormal products would slow all that follows


@njit(cache=True, nogil=True)
def shares_backward(q: Any, row_sums: Any, column_sums: Any, by_row: Any, by_column: Any, by_q: Any) -> None:
    """by_row, by_column: gradient by the shares, (heads, N, M, B); what they say of q is added to by_q.

    Of y = q - log sum exp(q): dq = dy - softmax(q) sum(dy), with dy = 0 where a share was held from below.
    """
    heads, n, m, b = q.shape
    total = np.empty(b, np.float32)
    for h in range(heads):
        for i in range(n):
            total[:] = np.float32(0.0)
            for j in range(m):
                for s in range(b):
                    free = q[h, i, j, s] > _VALID and q[h, i, j, s] - row_sums[h, i, s] > _WEAKEST
                    by_row[h, i, j, s] = by_row[h, i, j, s] * _SIZE if free else np.float32(0.0)
                    total[s] += by_row[h, i, j, s]
            for j in range(m):
                for s in range(b):
                    share = _softmax(q[h, i, j, s], row_sums[h, i, s])
                    by_q[h, i, j, s] += by_row[h, i, j, s] - share * total[s]
        for j in range(m):
            total[:] = np.float32(0.0)
            for i in range(n):
                for s in range(b):
                    free = q[h, i, j, s] > _VALID and q[h, i, j, s] - column_sums[h, j, s] > _WEAKEST
                    by_column[h, i, j, s] = by_column[h, i, j, s] * _SIZE if free else np.float32(0.0)
                    total[s] += by_column[h, i, j, s]
            for i in range(n):
                for s in range(b):
                    share = _softmax(q[h, i, j, s], column_sums[h, j, s])
                    by_q[h, i, j, s] += by_column[h, i, j, s] - share * total[s]
