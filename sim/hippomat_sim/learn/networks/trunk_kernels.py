"""Log-softmax of the attention heads over rows and columns, its gradient and that of relu, compiled. float32.

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
_VALID = NOTHING / np.float32(2.0)  # every q above belongs to a valid edge


@njit(cache=True, nogil=True)
def shares_forward(q: Any, row_sums: Any, column_sums: Any, rows: Any, columns: Any) -> None:
    """q, rows, columns: (heads, N, M, B)  row_sums: (heads, N, B)  column_sums: (heads, M, B).

    Writes log sum exp of q along M and N, and the shares: held from below and brought to size.
    """
    heads, n, m, b = q.shape
    planes = heads, n * m, b
    q, rows, columns = q.reshape(planes), rows.reshape(planes), columns.reshape(planes)
    most, total = np.empty(b, np.float32), np.empty(b, np.float32)
    for h in range(heads):
        for i in range(n):
            _share(q[h], i * m, 1, m, row_sums[h, i], rows[h], most, total)
        for j in range(m):
            _share(q[h], j, m, n, column_sums[h, j], columns[h], most, total)


@njit(cache=True, nogil=True)
def _share(
    q: Any, first: int, stride: int, count: int, log_sum: Any, shares: Any, most: Any, total: Any
) -> None:
    """Of one row or column: so many edges of q and shares, (N M, B), from the first on."""
    b, end = len(log_sum), first + count * stride
    most[:] = q[first]
    for e in range(first + stride, end, stride):
        for s in range(b):
            most[s] = max(most[s], q[e, s])
    total[:] = np.float32(0.0)
    for e in range(first, end, stride):
        for s in range(b):
            total[s] += exp_32(q[e, s] - most[s])
    for s in range(b):
        log_sum[s] = most[s] + np.float32(log_64(np.float64(total[s])))
    for e in range(first, end, stride):
        for s in range(b):
            share = q[e, s] - log_sum[s]
            shares[e, s] = (share if q[e, s] > _VALID and share > _WEAKEST else _WEAKEST) * _SIZE


@njit(cache=True, nogil=True)
def shares_backward(q: Any, row_sums: Any, column_sums: Any, by_row: Any, by_column: Any, by_q: Any) -> None:
    """by_row, by_column: gradient by the shares, (heads, N, M, B); what they say of q is added to by_q.

    Of y = q - log sum exp(q): dq = dy - softmax(q) sum(dy), with dy = 0 where a share was held from below.
    """
    heads, n, m, b = q.shape
    planes = heads, n * m, b
    q, by_q = q.reshape(planes), by_q.reshape(planes)
    by_row, by_column = by_row.reshape(planes), by_column.reshape(planes)
    total = np.empty(b, np.float32)
    for h in range(heads):
        for i in range(n):
            _share_backward(q[h], i * m, 1, m, row_sums[h, i], by_row[h], by_q[h], total)
        for j in range(m):
            _share_backward(q[h], j, m, n, column_sums[h, j], by_column[h], by_q[h], total)


@njit(cache=True, nogil=True)
def _share_backward(
    q: Any, first: int, stride: int, count: int, log_sum: Any, by_share: Any, by_q: Any, total: Any
) -> None:
    """As _share; by_share is changed."""
    b, end = len(log_sum), first + count * stride
    total[:] = np.float32(0.0)
    for e in range(first, end, stride):
        for s in range(b):
            free = q[e, s] > _VALID and q[e, s] - log_sum[s] > _WEAKEST
            by_share[e, s] = by_share[e, s] * _SIZE if free else np.float32(0.0)
            total[s] += by_share[e, s]
    for e in range(first, end, stride):
        for s in range(b):
            share = exp_32(q[e, s] - log_sum[s])
            share = share if q[e, s] > _VALID else np.float32(0.0)  # subnormal products slow all that follows
            by_q[e, s] += by_share[e, s] - share * total[s]


@njit(cache=True, nogil=True)
def relu_backward(gradient: Any, result: Any) -> None:
    """Zero where relu gave nothing, in place. Both (planes, edges)."""
    for plane in range(gradient.shape[0]):
        for edge in range(gradient.shape[1]):
            kept = gradient[plane, edge]
            gradient[plane, edge] = kept if result[plane, edge] > np.float32(0.0) else np.float32(0.0)
