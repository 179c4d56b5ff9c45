"""exp and log of the compiled kernels beside NumPy's."""

from __future__ import annotations

import numpy as np
from numba import njit

from hippomat_core.allocation.vector_math import exp_32, exp_64, log_64


@njit
def _each(x, y):
    exp_wide, exp_narrow, log = np.empty(len(x)), np.empty(len(x), np.float32), np.empty(len(y))
    for i in range(len(x)):
        exp_wide[i], exp_narrow[i], log[i] = exp_64(x[i]), exp_32(np.float32(x[i])), log_64(y[i])
    return exp_wide, exp_narrow, log


def test_exp_and_log_are_numpys_within_their_stated_errors():
    x = np.linspace(-80.0, 80.0, 40_001)
    y = np.concatenate([np.exp(np.linspace(-200, 200, 40_000)), [1.0]])
    exp_wide, exp_narrow, log = _each(x, y)
    np.testing.assert_allclose(exp_wide, np.exp(x), rtol=1e-11)
    narrow = x.astype(np.float32).astype(np.float64)
    np.testing.assert_allclose(exp_narrow, np.exp(narrow), rtol=2e-7)
    np.testing.assert_allclose(log, np.log(y), atol=1e-11, rtol=1e-13)


def test_what_is_far_below_zero_is_as_good_as_nothing():
    exp_wide, exp_narrow, _ = _each(np.array([-1e12, -np.inf]), np.ones(2))
    assert (exp_wide < 1e-100).all()
    assert (exp_narrow < 1e-30).all()
