"""exp and log in plain arithmetic: loops over them compile to vector code and give the same bits everywhere.

A libm does neither. Cody and Waite's reduction, then short polynomials; for the kernels of the edge network.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

_LOG2_E = 1.4426950408889634
_LN2_HIGH = 0.6931471803691238  # 33 bits: exact times a small integer
_LN2_LOW = 1.9082149292705877e-10
_MAGIC = 6755399441055744.0  # 1.5 x 2^52: adding it leaves the nearest integer in the lowest bits
_LOG2_E_32 = np.float32(_LOG2_E)
_LN2_HIGH_32 = np.float32(0.693359375)
_LN2_LOW_32 = np.float32(-2.12194440e-4)
_MAGIC_32 = np.float32(12582912.0)  # 1.5 x 2^23
_LEAST, _LEAST_32 = -300.0, np.float32(-80.0)  # below, the result is that of these: as good as nothing

_AS_FLOAT = {types.int64: types.float64, types.int32: types.float32}
_AS_INTEGER = {types.float64: types.int64, types.float32: types.int32}
_LLVM = {
    types.int64: ir.IntType(64),
    types.int32: ir.IntType(32),
    types.float64: ir.DoubleType(),
    types.float32: ir.FloatType(),
}


def _reinterpreted(value: Any, pairs: dict[Any, Any]) -> Any:
    kind = pairs[value]

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], _LLVM[kind])

    return kind(value), generate


def _as_integer(_context: Any, value: Any) -> Any:
    """The bits of a float as an integer of the same width."""
    return _reinterpreted(value, _AS_INTEGER)


def _as_float(_context: Any, value: Any) -> Any:
    """The float that has these bits."""
    return _reinterpreted(value, _AS_FLOAT)


_bits: Any = intrinsic(_as_integer)
_float: Any = intrinsic(_as_float)


@njit(cache=True, inline="always")
def exp_64(x: float) -> float:
    """Relative error below 1e-11 for -300 <= x <= 300; smaller x count as -300."""
    x = x if x > _LEAST else _LEAST
    shifted = x * _LOG2_E + _MAGIC
    n = shifted - _MAGIC
    r = (x - n * _LN2_HIGH) - n * _LN2_LOW
    p = 1.0 / 362880.0
    p = p * r + 1.0 / 40320.0
    p = p * r + 1.0 / 5040.0
    p = p * r + 1.0 / 720.0
    p = p * r + 1.0 / 120.0
    p = p * r + 1.0 / 24.0
    p = p * r + 1.0 / 6.0
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    result: float = p * _float((_bits(shifted) + 1023) << 52)
    return result


@njit(cache=True, inline="always")
def exp_32(x: np.float32) -> np.float32:
    """Relative error below 2e-7 for -80 <= x <= 80; smaller x count as -80. float32 throughout."""
    x = x if x > _LEAST_32 else _LEAST_32
    shifted = x * _LOG2_E_32 + _MAGIC_32
    n = shifted - _MAGIC_32
    r = (x - n * _LN2_HIGH_32) - n * _LN2_LOW_32
    p = np.float32(1.0 / 5040.0)
    p = p * r + np.float32(1.0 / 720.0)
    p = p * r + np.float32(1.0 / 120.0)
    p = p * r + np.float32(1.0 / 24.0)
    p = p * r + np.float32(1.0 / 6.0)
    p = p * r + np.float32(0.5)
    p = p * r + np.float32(1.0)
    p = p * r + np.float32(1.0)
    result: np.float32 = p * _float(np.int32((_bits(shifted) + 127) << 23))  # numba shifts in 64 bits
    return result


@njit(cache=True, inline="always")
def log_64(x: float) -> float:
    """Of a positive normal number, 2 atanh((m - 1) / (m + 1)) of its mantissa; absolute error below 1e-11."""
    bits = _bits(x)
    # The mantissa in sqrt(1/2) .. sqrt(2), and the exponent that goes with it.
    moved = bits - 0x3FE6A09E667F3BCD
    n = moved >> 52
    m = _float(bits - (n << 52))
    f = (m - 1.0) / (m + 1.0)
    g = f * f
    p = 1.0 / 13.0
    p = p * g + 1.0 / 11.0
    p = p * g + 1.0 / 9.0
    p = p * g + 1.0 / 7.0
    p = p * g + 1.0 / 5.0
    p = p * g + 1.0 / 3.0
    p = p * g + 1.0
    result: float = n * _LN2_HIGH + (n * _LN2_LOW + 2.0 * f * p)
    return result
