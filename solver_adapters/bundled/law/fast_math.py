"""exp and log that LLVM can vectorise: libm calls would keep the loop over slip systems scalar.

Both are accurate to 3 units in the last place for finite arguments of normal size (log: x > 0).
"""

import numpy as np

from solver_adapters.kernels import kernel, ordered_kernel

_LN2_HIGH = 0.6931471803691238
_LN2_LOW = 1.9082149292705877e-10
_SQRT_HALF_BITS = 0x3FE6A09E667F3BCD


@ordered_kernel
def fast_exp(x: float) -> float:
    """exp(x) by reduction to |r| ≤ ln(2)/2 and the Taylor polynomial of degree 12."""
    k = np.int64(x * 1.4426950408889634 + 2048.5) - 2048
    r = x - k * _LN2_HIGH - k * _LN2_LOW
    p = 1.0 / 479001600.0
    p = p * r + 1.0 / 39916800.0
    p = p * r + 1.0 / 3628800.0
    p = p * r + 1.0 / 362880.0
    p = p * r + 1.0 / 40320.0
    p = p * r + 1.0 / 5040.0
    p = p * r + 1.0 / 720.0
    p = p * r + 1.0 / 120.0
    p = p * r + 1.0 / 24.0
    p = p * r + 1.0 / 6.0
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    return p * np.int64((k + 1023) << 52).view(np.float64)


@ordered_kernel
def fast_log(x: float) -> float:
    """log(x) from the exponent bits and the artanh series of the mantissa."""
    bits = np.float64(x).view(np.int64)
    exponent = (bits - _SQRT_HALF_BITS) >> 52
    mantissa = np.int64(bits - (exponent << 52)).view(np.float64)
    s = (mantissa - 1.0) / (mantissa + 1.0)
    z = s * s
    p = 2.0 / 21.0
    p = p * z + 2.0 / 19.0
    p = p * z + 2.0 / 17.0
    p = p * z + 2.0 / 15.0
    p = p * z + 2.0 / 13.0
    p = p * z + 2.0 / 11.0
    p = p * z + 2.0 / 9.0
    p = p * z + 2.0 / 7.0
    p = p * z + 2.0 / 5.0
    p = p * z + 2.0 / 3.0
    p = p * z + 2.0
    return exponent * 0.6931471805599453 + s * p


@kernel
def decay(x: float) -> float:
    """e^(−x) for x ≥ 0; where it is too small for a number of normal size it stays at e^(−600)."""
    value: float = fast_exp(-min(x, 600.0))
    return value
