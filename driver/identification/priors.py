"""What is known before the fit: a Gaussian prior, the paper's λ*, or nothing.

The paper solves (M + λ*I) δq = b + λ*(q₀ − q) with q = log(p/p₀), the Hessian M and the right-hand
side b of a functional that is "normalised to one" (equations 2.16, 2.17 and 4.1):

    χ² = χ̄² + λ*‖q − q₀‖²,    χ̄² = [Σ_t Σ_Ω ρ²/(2γ_f²) + ‖F_m − F_c‖²/γ_F²] / (N_t (1 + N_f)).

The cost of a fit here is ‖r‖² + ‖(θ − θ₀)/width‖² with images weighed by γ_f⁻². Multiplied by
2 N_t (1 + N_f) the paper's functional is that cost (its loads weigh twice as much, and the noise
of the reference is known better here), with the width (2 N_t (1 + N_f) λ*)^(−1/2) for every q:
λ* is a Gaussian prior that is alike for all parameters, and that grows with the data.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt

from driver.case.inference import Identification
from driver.parameters.boundary import LAMBDAS
from solver_adapters.parameter import Parameter

LAMBDA_PRIOR = 0.2  # standard deviation about the start: the paper found 0.81, 1.02, 0.98, 1.02
FREED_WIDTH = 3.0
"""Prior scales of the Gaussian under which a parameter beside the law is freed.

The scale says what is usual. What this draws an effect of a few scales towards its null by is a
fraction of its σ, and `extended.toml` finds again what a diagnosis has named.
"""

Prior = dict[str, tuple[float, float]]


def tikhonov_width(lambda_star: float, n_images: int, n_pixels: int) -> float:
    """Return the standard deviation of log(p/p₀) to which λ* amounts."""
    return 1.0 / sqrt(2.0 * n_images * (1 + n_pixels) * lambda_star)


def widths(table: Identification, parameters: Mapping[str, Parameter]) -> dict[str, float]:
    """Stated widths in θ of apex amplitudes and constants of the law."""
    of_amplitudes = {name: LAMBDA_PRIOR / parameters[name].scale for name in LAMBDAS}
    return of_amplitudes | {name: table.width(name) for name in table.parameters}


def prior_of(
    table: Identification,
    start: Mapping[str, float],
    parameters: Mapping[str, Parameter],
    n_images: int,
    n_pixels: int,
) -> Prior:
    """Mean (value) and standard deviation (in θ) of apex amplitudes and constants of the law.

    Where a parameter has no logarithm, λ* holds λ − λ₀ of an amplitude (itself a ratio, and about
    1), and the departure of any other in units of its scale.

    Args:
        table: the choice of the case.
        start: every parameter at the start, the means.
        parameters: declarations by name.
        n_images: images that are fitted.
        n_pixels: pixels of each.
    """
    if table.prior == "none":
        return {}
    known_widths = widths(table, parameters)
    if table.lambda_star is not None:
        alike = tikhonov_width(table.lambda_star, n_images, n_pixels)
        known_widths = {
            name: alike / parameters[name].scale if name in LAMBDAS else alike
            for name in known_widths
        }
    return {name: (start[name], width) for name, width in known_widths.items()}
