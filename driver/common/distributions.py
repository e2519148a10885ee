"""Tails and quantiles of distributions, from scipy.special.

Those of scipy.stats are the same numbers to the last bit; its import takes a quarter of the start
of a process that fits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import special

# A number, or an array; so is what is returned.
Numbers = Any


def normal_sf(z: Numbers) -> Numbers:
    """Return the probability of more than z in the standard normal distribution."""
    return special.ndtr(-z)


def normal_ppf(p: Numbers) -> Numbers:
    """Return what the standard normal distribution stays below with probability p."""
    return special.ndtri(p)


def normal_isf(p: Numbers) -> Numbers:
    """Return what the standard normal distribution exceeds with probability p."""
    return -special.ndtri(p)


def t_sf(t: Numbers, degrees: Numbers) -> Numbers:
    """Return the probability of more than t in Student's distribution."""
    return special.stdtr(degrees, -t)


def t_isf(p: Numbers, degrees: Numbers) -> Numbers:
    """Return what Student's distribution exceeds with probability p."""
    return -special.stdtrit(degrees, p)


def chi2_sf(x: Numbers, degrees: Numbers) -> Numbers:
    """Return the probability of more than x in the χ² distribution."""
    return special.chdtrc(degrees, np.maximum(x, 0.0))


def chi2_isf(p: Numbers, degrees: Numbers) -> Numbers:
    """Return what the χ² distribution exceeds with probability p."""
    return special.chdtri(degrees, p)


def f_sf(x: Numbers, degrees: Numbers, below: Numbers) -> Numbers:
    """Return the probability of more than x in the F distribution.

    Args:
        x: the ratio.
        degrees: of freedom of its numerator.
        below: of freedom of its denominator.
    """
    return special.fdtrc(degrees, below, np.maximum(x, 0.0))


def gamma_logpdf(x: Numbers, shape: float, scale: float) -> Numbers:
    """Return the logarithm of the density of the gamma distribution at x > 0."""
    y = x / scale
    return special.xlogy(shape - 1.0, y) - y - special.gammaln(shape) - np.log(scale)
