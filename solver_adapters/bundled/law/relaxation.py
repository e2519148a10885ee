"""Overstress that relaxes by its own slip: mean rate of a step from its ratio end to start.

Where dv/dt ∝ −(v/K)ⁿ, the mean rate of a step that goes from v⁰ to v = v⁰ e^(−r) is
ρ (v⁰/K)ⁿ with

    ρ = a (1 − e^(−r))/(e^(a r) − 1) = e^(−a r) P(r)/P(a r),    r ≥ 0
    P(u) = (1 − e^(−u))/u,    a = n − 1

(the harmonic mean of (v/K)ⁿ over v). At r = 0 the slope −d ln ρ/dr is n/2, far away it is a.
"""

from solver_adapters.bundled.law.fast_math import fast_log
from solver_adapters.kernels import kernel

# Below this argument the functions are taken from their series.
_SMALL = 0.1


@kernel
def mean_decay(u: float, e: float) -> tuple[float, float]:
    """Numerator and denominator of P(u) for e = e^(−u).

    Fractions are divided once, when all are known: a division costs as much as ten products.
    """
    series = 1.0 - u / 8.0 * (1.0 - u / 9.0)
    series = 1.0 - u / 6.0 * (1.0 - u / 7.0 * series)
    series = 1.0 - u / 2.0 * (1.0 - u / 3.0 * (1.0 - u / 4.0 * (1.0 - u / 5.0 * series)))
    small = u < _SMALL
    return (series if small else 1.0 - e), (1.0 if small else u)


@kernel
def decay_slope(u: float, e: float) -> tuple[float, float]:
    """Numerator and denominator of −P′(u)/P(u) = 1/u − e/(1 − e) for e = e^(−u)."""
    q = u * u
    series = 0.5 - u * (1 / 12.0 - q * (1 / 720.0 - q * (1 / 30240.0 - q / 1209600.0)))
    small, left = u < _SMALL, 1.0 - e
    return (series if small else left - u * e), (1.0 if small else u * left)


@kernel
def rate_ratio(r: float, e: float, e_a: float, n: float) -> float:
    """ρ for e = e^(−r), e_a = e^(−a r)."""
    (above, below), (above_a, below_a) = mean_decay(r, e), mean_decay((n - 1.0) * r, e_a)
    ratio: float = e_a * (above * below_a) / (below * above_a)
    return ratio


@kernel
def rate_slope(r: float, e: float, e_a: float, n: float) -> float:
    """−∂ ln ρ/∂r."""
    a = n - 1.0
    (above, below), (above_a, below_a) = decay_slope(r, e), decay_slope(a * r, e_a)
    slope: float = a - (a * above_a * below - above * below_a) / (below * below_a)
    return slope


@kernel
def rate_change(r: float, e_a: float, n: float) -> float:
    """−∂ ln ρ/∂n at fixed r."""
    above, below = decay_slope((n - 1.0) * r, e_a)
    change: float = r * (1.0 - above / below)
    return change


@kernel
def near_fall(log_ratio: float, n: float) -> float:
    """Return an r whose ln ρ is near `log_ratio` ≤ 0.

    ln ρ is concave for n > 2 and lies below its tangents −n r/2 and ln a − a r, convex and above
    them for n < 2: the better of the two.
    """
    a = n - 1.0
    near, far = -2.0 * log_ratio / n, (fast_log(a) - log_ratio) / a
    r: float = max(min(near, far) if n > 2.0 else max(near, far), 0.0)
    return r
