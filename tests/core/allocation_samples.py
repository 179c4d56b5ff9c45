"""Allocation problems for tests: written by hand, or drawn by hypothesis."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hippomat_core.allocation.port import Problem

U = 255  # unreachable


def problem(costs: object, self_index: int = 0, **others: object) -> Problem:
    costs_q = np.asarray(costs, np.uint8)
    n, m = costs_q.shape
    fields: dict[str, object] = {
        "available": np.ones(n, np.bool_),
        "busy": np.zeros(n, np.bool_),
        "waiting": np.ones(m, np.bool_),
        "present": np.ones(n, np.bool_),
        "assigned": np.zeros(n, np.bool_),
        "ages_rounds": np.zeros(n, np.float32),
        "round": 0,
        "seed": 1,
    }
    return Problem(costs_q=costs_q, self_index=self_index, **{**fields, **others})  # type: ignore[arg-type]


def cost_matrices(most: int = 6) -> st.SearchStrategy[np.ndarray]:
    sizes = st.tuples(st.integers(1, most), st.integers(1, most))
    codes = st.one_of(st.integers(0, 12), st.just(U), st.integers(0, 255))  # few values: many ties
    return sizes.flatmap(lambda shape: arrays(np.uint8, shape, elements=codes))


@st.composite
def problems(draw: st.DrawFn, most: int = 6) -> Problem:
    """Any snapshot: some robots available, some busy, some neither; some slots not waiting."""
    costs = draw(cost_matrices(most))
    n, m = costs.shape
    part = draw(arrays(np.int8, n, elements=st.integers(0, 2)))
    return problem(
        costs,
        available=part == 0,
        busy=part == 1,
        waiting=draw(arrays(np.bool_, m)),
        seed=draw(st.integers(0, 9)),
        round=draw(st.integers(0, 9)),
    )
