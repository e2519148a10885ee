"""How much roughness the images themselves grant a motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from driver.dic.system import System

FloatArray = NDArray[np.float64]

ROUNDS = 30
ENOUGH = 0.01  # relative change of the estimate
_LEAST_MODES = 1e-6  # where the images decide none, so that the quotient stays finite


def estimated_roughness(
    system: System, p: FloatArray, rank: int, variance: float, least: float
) -> tuple[float, FloatArray]:
    """The roughness that makes the images most probable, and the motion that goes with it.

    MacKay's fixed point of the evidence (Neural Computation 4, 1992, 415): with
    γ = rank R − tr(A⁻¹P) the modes that the images decide, roughness² = pᵀRp/γ, over all images
    together. The images need not be looked at again: about its own solution p₀ the correlation is
    linear, (M + P) p = (M + P₀) p₀.

    Args:
        system: weighed with its one penalty, P₀ = weight · R; it is left with the last one tried.
        p: nodal values of every image at that weight [µm], shape (T, n).
        rank: of R.
        variance: of the noise of ρ [µm²].
        least: roughness at which the motion is as good as without any [µm].

    Returns:
        roughness [µm]; nodal values (T, n) [µm].
    """
    part, (weight,) = system.parts[0], system.weights
    target = (system.hessian @ p.T) + weight * (part @ p.T)
    found = float(np.sqrt(variance / weight))
    for _ in range(ROUNDS):
        decided = max(rank - system.weights[0] * system.traces()[0], _LEAST_MODES)
        energy = max(float(np.mean(np.einsum("ti,ti->t", p, (part @ p.T).T))), 0.0)
        before, found = found, max(float(np.sqrt(energy / decided)), least)
        system.weigh([variance / found**2])
        p = system.solve(np.ascontiguousarray(target)).T
        if abs(found - before) <= ENOUGH * before:
            break
    return found, np.ascontiguousarray(p)
