"""Scores of causes at a baseline: what each would explain, fitted parameters projected out.

With r the whitened residual at the optimum, J the fitted and C the candidate's sensitivities per
prior scale, and H = JJᵀ + prior:

    g = C r − C Jᵀ H⁻¹ (J r + prior·gap),    A = C Cᵀ − C Jᵀ H⁻¹ J Cᵀ
    statistic gᵀA⁻¹g ~ χ²(k),    φ̂ = (A + I)⁻¹ g  in prior scales
    log Bayes factor = ½ gᵀ(A + I)⁻¹g − ½ log det(I + A)       (Laplace)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from driver.diagnosis.causes import Cause
from driver.identification.fit import Evaluation
from solver_adapters.parameter import Parameter

FloatArray = NDArray[np.float64]

# A one-σ-per-family threshold of 1 % over tens of causes is near 3.5 σ; one more σ for power.
SEEN_AT = 4.5
_RANK = 1e-9
_FAINT = 1e-8  # a prior scale that moves the data by less than 1e-4 σ leaves no trace


@dataclass(frozen=True, eq=False)
class Score:
    """What a cause would explain, to first order.

    Attributes:
        cause: the cause.
        statistic: decrease of ‖r‖² [-].
        degrees: its degrees of freedom.
        p: probability under the null, for the whole family of causes.
        log_evidence: natural log of the Bayes factor against the baseline.
        estimate: parameters in prior scales, shape (k,).
        sigma: their standard deviations in prior scales, shape (k,).
        visible: smallest magnitude that would have been seen, in prior scales, infinite where
            none would, shape (k,).
        directions: orthonormal projected sensitivities, shape (degrees, n); none of a noise.
    """

    cause: Cause
    statistic: float
    degrees: int
    p: float
    log_evidence: float
    estimate: FloatArray
    sigma: FloatArray
    visible: FloatArray
    directions: FloatArray


def score(
    cause: Cause,
    sensitivity: FloatArray,
    baseline: Evaluation,
    family: int,
) -> Score:
    """Score one cause.

    Args:
        cause: the cause.
        sensitivity: whitened, per prior scale, shape (k, n).
        baseline: evaluation at the optimum of the baseline.
        family: number of causes that are tried.
    """
    J, H = baseline.jacobian, baseline.hessian
    coupling = np.linalg.solve(H, J @ sensitivity.T)
    projected = sensitivity - coupling.T @ J
    g = sensitivity @ baseline.residual - coupling.T @ baseline.gradient
    A = sensitivity @ projected.T
    A = 0.5 * (A + A.T)
    eigenvalue, vector = np.linalg.eigh(A)
    floor = max(_RANK * float(np.sum(sensitivity**2)), _FAINT)
    kept = eigenvalue > floor
    along = vector[:, kept].T @ g
    statistic = float(np.sum(along**2 / eigenvalue[kept]))
    inflated = A + np.eye(len(g))
    estimate: FloatArray = np.asarray(np.linalg.solve(inflated, g), dtype=np.float64)
    evidence = 0.5 * float(g @ estimate) - 0.5 * float(np.linalg.slogdet(inflated)[1])
    degrees = int(kept.sum())
    p = float(chi2.sf(statistic, degrees)) if degrees else 1.0
    if cause.one_sided:
        p *= 0.5
        if g[0] <= 0:
            statistic, p, estimate = 0.0, 1.0, np.zeros_like(estimate)
            evidence = -0.5 * float(np.linalg.slogdet(inflated)[1])
    variance = np.diag(np.linalg.inv(inflated))
    seen = np.diag(A) > floor
    visible = np.where(seen, SEEN_AT / np.sqrt(np.where(seen, np.diag(A), 1.0)), np.inf)
    basis = (vector[:, kept] / np.sqrt(eigenvalue[kept])).T @ projected
    norms = np.linalg.norm(basis, axis=1, keepdims=True)
    return Score(
        cause=cause,
        statistic=statistic,
        degrees=degrees,
        p=min(1.0, p * family),
        log_evidence=evidence,
        estimate=estimate,
        sigma=np.sqrt(variance),
        visible=visible,
        directions=basis / np.where(norms > 0, norms, 1.0),
    )


def undetectable(found: Score) -> str | None:
    """Why a cause would not have been seen whatever its size, None if it would have been."""
    return None if np.isfinite(found.visible).any() else found.cause.unseen


def cosine(first: Score, second: Score) -> float:
    """Cosine of the smallest angle between what two causes do to the data."""
    if not first.directions.size or not second.directions.size:
        return 0.0
    one = np.linalg.qr(first.directions.T)[0]
    two = np.linalg.qr(second.directions.T)[0]
    return float(np.linalg.svd(one.T @ two, compute_uv=False)[0])


def prior_scaled(
    jacobian: FloatArray, names: Sequence[str], parameters: Mapping[str, Parameter]
) -> FloatArray:
    """∂/∂θ → derivative per prior scale: θ of a logarithm is measured in its scale."""
    scales = [parameters[n].scale if parameters[n].logarithmic else 1.0 for n in names]
    return np.asarray(jacobian * np.array(scales)[:, None])
