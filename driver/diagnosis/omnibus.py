"""Tests of a residual against no particular alternative: is anything left?

A model error is slow in time, noise is not. Each signal is therefore compared with itself: the
power of its slow modes against that of its fast ones (F test), so that no error in the assumed
noise level can raise a false alarm. The load is also tested for serial correlation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, f

from driver.identification.data import Data
from driver.identification.fit import Evaluation

FloatArray = NDArray[np.float64]

LAGS = 10
SLOW_SHARE = 8  # the slowest eighth of the modes against the fastest half
FAMILY_LEVEL = 0.01


@dataclass(frozen=True)
class Omnibus:
    """Probabilities of residuals as structured as these, were the model right.

    Attributes:
        load_slow: slow against fast modes of the load.
        load_serial: Ljung–Box test of the load.
        image_slow: slow against fast modes of the images.
    """

    load_slow: float
    load_serial: float
    image_slow: float

    @property
    def accepted(self) -> bool:
        """Whether nothing is left at a family-wise level of 1 %."""
        return 3 * min(self.load_slow, self.load_serial, self.image_slow) > FAMILY_LEVEL


def omnibus(fitted: Evaluation, data: Data) -> Omnibus:
    """Test a fitted residual; degrees of freedom taken by the fit are counted."""
    hat = np.asarray(np.linalg.solve(fitted.hessian, fitted.jacobian), dtype=np.float64)
    loads = fitted.residual[: fitted.n_load]
    images = data.image_part(fitted.residual)
    J_load = fitted.jacobian[:, : fitted.n_load]
    hat_load = hat[:, : fitted.n_load]
    k = len(fitted.free)
    shape = (k, *images.shape)
    J_image = fitted.jacobian[:, fitted.n_load :].reshape(shape)
    hat_image = hat[:, fitted.n_load :].reshape(shape)
    return Omnibus(
        load_slow=_slow_against_fast(loads[:, None], J_load[..., None], hat_load[..., None]),
        load_serial=_ljung_box(loads, k),
        image_slow=_slow_against_fast(images, J_image, hat_image),
    )


def _modes(T: int, orders: NDArray[np.int64]) -> FloatArray:
    """Orthonormal cosines of the given orders, shape (n_orders, T)."""
    modes = np.sqrt(2 / T) * np.cos(np.pi * np.outer(orders, np.arange(T) + 0.5) / T)
    modes[orders == 0] /= np.sqrt(2)
    return np.asarray(modes)


def _slow_against_fast(signal: FloatArray, J: FloatArray, hat: FloatArray) -> float:
    T = len(signal)
    powers, degrees = [], []
    for orders in (np.arange(T // SLOW_SHARE), np.arange(T // 2, T)):
        modes = _modes(T, orders)
        in_modes = modes @ signal
        taken = np.einsum("kmz,kmz->", modes @ hat, modes @ J)
        powers.append(float(np.sum(in_modes**2)))
        degrees.append(max(float(in_modes.size - taken), 1.0))
    ratio = (powers[0] / degrees[0]) / (powers[1] / degrees[1])
    return float(f.sf(ratio, degrees[0], degrees[1]))


def _ljung_box(loads: FloatArray, fitted: int) -> float:
    """Serial correlation of the load residual over ten lags.

    The smooth parameters (elongation knots, law) leave short lags almost untouched: the
    degrees of freedom are those of the lags.
    """
    T = loads.size
    if T <= LAGS + fitted // 2:
        return 1.0
    z = loads - loads.mean()
    variance = float(z @ z)
    total = sum(float(z[lag:] @ z[:-lag]) ** 2 / (T - lag) for lag in range(1, LAGS + 1))
    return float(chi2.sf(T * (T + 2) * total / variance**2, LAGS))
