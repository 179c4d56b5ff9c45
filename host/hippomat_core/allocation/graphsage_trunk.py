"""The edge network's hops: from features to the three numbers of every edge. float32, products by NumPy.

Edges are the long axis: a plane of an embedding is one row over all edges, so loops over it are vector code.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hippomat_core.allocation.graphsage_settings import SHARE_SIZE, WEAKEST_SHARE, GraphSageSettings
from hippomat_core.allocation.vector_math import exp_32, log_64

_WEAKEST = np.float32(WEAKEST_SHARE)
_SIZE = np.float32(SHARE_SIZE)
_LEAST = np.float32(-1e9)

Array = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class TrunkWeights:
    """One matrix per layer, (out, in + 1), the bias in its last column; hops: (query, mix, out) each."""

    edge_in: Array
    edge_out: Array
    hops: tuple[tuple[Array, Array, Array], ...]
    out: Array


def run_trunk(
    weights: TrunkWeights, settings: GraphSageSettings, features: Array, valid: NDArray[np.bool_]
) -> Array:
    """(3, n, m): score, price and weight of the price. features: (FEATURES, n m)  valid: (n, m)."""
    width, heads, edges = settings.width, settings.heads, valid.size
    # Planes of a hop's input: queries, row shares, column shares, embedding, ones for the bias.
    wide = np.ones((3 * heads + width + 1, edges), np.float32)
    query, rows, columns = wide[: 3 * heads].reshape(3, heads, edges)
    embedding, e = wide[3 * heads :], wide[3 * heads : -1]
    hidden = np.ones((settings.hidden + 1, edges), np.float32)
    e[:] = _perceptron(weights.edge_in, weights.edge_out, np.vstack([features, hidden[-1:]]), hidden)
    for query_weight, mix, out in weights.hops:
        np.matmul(query_weight, embedding, out=query)
        _shares(query, valid, rows, columns)
        e += _perceptron(mix, out, wide, hidden)
    learned: Array = weights.out @ embedding
    return learned.reshape(-1, *valid.shape)


def _perceptron(first: Array, second: Array, x: Array, hidden: Array) -> Array:
    """second relu(first x). hidden: scratch whose last plane is ones."""
    inner = hidden[:-1]
    np.matmul(first, x, out=inner)
    np.maximum(inner, np.float32(0.0), out=inner)
    result: Array = second @ hidden
    return result


@njit(cache=True)
def _shares(q, valid, rows, columns):  # type: ignore[no-untyped-def]
    """log-softmax of every head's q over each row and each column, held from below and brought to size."""
    n, m = valid.shape
    for head in range(len(q)):
        for i in range(n):
            for j in range(m):
                e = i * m + j
                q_ij = q[head, e] if valid[i, j] else _LEAST
                rows[head, e] = q_ij
                columns[head, e] = q_ij
        _log_softmax_columns(columns[head], n, m)
        _log_softmax_rows(rows[head], n, m)
        for e in range(n * m):
            row, column = rows[head, e], columns[head, e]
            rows[head, e] = (row if row > _WEAKEST else _WEAKEST) * _SIZE
            columns[head, e] = (column if column > _WEAKEST else _WEAKEST) * _SIZE


@njit(cache=True)
def _log_softmax_columns(plane, n, m):  # type: ignore[no-untyped-def]
    most, total = np.full(m, _LEAST), np.zeros(m, np.float32)
    for i in range(n):
        for j in range(m):
            most[j] = plane[i * m + j] if plane[i * m + j] > most[j] else most[j]
    for i in range(n):
        for j in range(m):
            total[j] += exp_32(plane[i * m + j] - most[j])
    for j in range(m):
        most[j] += np.float32(log_64(np.float64(total[j])))
    for i in range(n):
        for j in range(m):
            plane[i * m + j] -= most[j]


@njit(cache=True)
def _log_softmax_rows(plane, n, m):  # type: ignore[no-untyped-def]
    share = np.empty(m, np.float32)
    for i in range(n):
        most, total = _LEAST, np.float32(0.0)
        for j in range(m):
            most = plane[i * m + j] if plane[i * m + j] > most else most
        for j in range(m):
            share[j] = exp_32(plane[i * m + j] - most)
        for j in range(m):
            total += share[j]
        most += np.float32(log_64(np.float64(total)))
        for j in range(m):
            plane[i * m + j] -= most
