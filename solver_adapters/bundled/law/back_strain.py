"""Back strain over a step of one sense of slip, of the exponential scheme and of backward Euler.

With dx = S dp − d x dp a step of slip Δp takes x to S (S x⁰ · left + gained).
"""

from solver_adapters.bundled.law.fast_math import decay
from solver_adapters.kernels import kernel


@kernel
def share_left(u: float, exponential: bool) -> float:
    """Share of the recalled back strain that a step leaves: e^(−u) or 1/(1 + u), u = d Δp."""
    return decay(u) if exponential else 1.0 / (1.0 + u)


@kernel
def gained(left: float, slip: float, d: float, exponential: bool) -> float:
    """Back strain that the slip of a step adds."""
    if exponential:
        u = d * slip
        # (1 − e^(−u))/d without cancellation
        small = 1.0 - u * (0.5 - u * (1.0 / 6.0 - u * (1.0 / 24.0 - u / 120.0)))
        return slip * small if u < 1e-3 else (1.0 - left) / max(d, 1e-300)
    return slip * left


@kernel
def growth(left: float, start: float, d: float, exponential: bool) -> float:
    """∂/∂Δp of start·left + gained, the back strain at the end of a step."""
    return (1.0 - d * start) * (left if exponential else left * left)


@kernel
def recall_slope(left: float, slip: float, d: float, start: float, exponential: bool) -> float:
    """∂/∂d of start·left + gained, the back strain at the end of a step."""
    if exponential:
        u = d * slip
        # (u e^(−u) − 1 + e^(−u))/u² without cancellation
        small = -0.5 + u * (1 / 3.0 - u * (0.125 - u * (1 / 30.0 - u * (1 / 144.0 - u / 840.0))))
        v = max(u, 1e-2)
        share = small if u < 1e-2 else ((1.0 + v) * left - 1.0) / (v * v)
        return slip * (slip * share - start * left)
    return -(start + slip) * left * slip * left
