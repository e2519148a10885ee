"""Scores of causes at a baseline: what each would explain, fitted parameters projected out.

With score g and information A of the candidate's parameters per prior scale, all fitted ones
projected out (`bayes_factor`):

    statistic gᵀA⁻¹g ~ χ²(k),    φ̂ = (A + I/w²)⁻¹ g, w = `FREED_WIDTH`,  in prior scales

Where the noise of the loads was estimated from ν degrees of freedom, the statistic of a cause
that shows by the share s of its effect in the loads has the tail of F(k, ν/s²) (Satterthwaite).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.common.distributions import chi2_sf, f_sf
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.statistics.bayes_factor import log_mean_likelihood, prior_scaled, projected
from driver.identification.objective import Evaluation
from driver.identification.priors import FREED_WIDTH
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter

NAMING_LEVEL = 0.005
"""Of the family of all causes: less than one model in a hundred that is right gets a cause."""
# This level over tens of causes is near 3.7 σ; most of one more σ for power.
SEEN_AT = 4.5
MORE_OF_A_PLACE = 0.7
"""The same of what lies somewhere: by three degrees of freedom that level is near 4.5 σ."""
WORTH = 1.0  # log evidence without which nothing is added: less is no evidence (Jeffreys)
PARALLEL = 0.95  # likeness beyond which causes cannot be told apart
_RANK = 1e-9
_OWN = 1e-4  # variance of a direction that several causes have together, over the largest
_FAINT = 1e-8  # a prior scale that moves the data by less than 1e-4 σ leaves no trace


@dataclass(frozen=True, eq=False)
class Score:
    """What a cause would explain, to first order.

    Attributes:
        cause: the cause.
        statistic: decrease of ‖r‖² [-].
        degrees: its degrees of freedom.
        p: probability under the null, for the whole family of causes.
        family: number of tries that p counts.
        log_evidence: natural log of the Bayes factor against the baseline.
        estimate: parameters in prior scales, shape (k,).
        sigma: their standard deviations in prior scales, shape (k,).
        visible: smallest magnitude that would have been seen, in prior scales, infinite where
            none would, shape (k,).
        components: what the data show along the directions over its standard deviation, whose
            squares sum up to the statistic (0 for a one-sided cause below its null), shape
            (degrees,).
        directions: unit projected sensitivities, shape (degrees, n); none of a noise.
        strengths: projected misfit of one prior scale along each of them [σ²], shape (degrees,).
    """

    cause: Cause
    statistic: float
    degrees: int
    p: float
    family: int
    log_evidence: float
    estimate: FloatArray
    sigma: FloatArray
    visible: FloatArray
    components: FloatArray
    directions: FloatArray
    strengths: FloatArray


def score(
    cause: Cause,
    sensitivity: FloatArray,
    baseline: Evaluation,
    family: int,
    load_degrees: float = np.inf,
    variance: float = 1.0,
    off: FloatArray | None = None,
) -> Score:
    """Score one cause.

    Args:
        cause: the cause.
        sensitivity: whitened, per prior scale, shape (k, n).
        baseline: evaluation at the optimum of the baseline.
        family: number of tries, of which a cause is one.
        load_degrees: degrees of freedom of the noise level of the loads.
        variance: of whitened numbers along the cause, 1 for noise alone.
        off: what the whitened prediction may be off besides, with either sign, shape (n,); it
            counts in what is visible, as a standard deviation.
    """
    left, of_noise, information = projected(sensitivity, baseline)
    g, A = of_noise / variance, information / variance
    eigenvalue, vector = np.linalg.eigh(A)
    floor = max(_RANK * float(np.sum(sensitivity**2)), _FAINT)
    kept = eigenvalue > floor
    components = vector[:, kept].T @ g / np.sqrt(eigenvalue[kept])
    statistic = float(np.sum(components**2))
    inflated = A + np.eye(len(g)) / FREED_WIDTH**2
    estimate: FloatArray = np.asarray(np.linalg.solve(inflated, g), dtype=np.float64)
    evidence = log_mean_likelihood(g, A, (len(g),), (0,) if cause.one_sided else ())
    degrees = int(kept.sum())
    basis = (vector[:, kept] / np.sqrt(eigenvalue[kept])).T @ left
    norms = np.linalg.norm(basis, axis=1, keepdims=True)
    directions = basis / np.where(norms > 0, norms, 1.0)
    p = significance(cause, components, left, baseline, family, load_degrees)
    if cause.one_sided and g[0] <= 0:
        statistic, p, estimate = 0.0, 1.0, np.zeros_like(estimate)
    uncertainty = np.diag(np.linalg.inv(inflated))
    seen = np.diag(A) > floor
    known = np.where(seen, np.diag(A), 1.0)
    hidden = 0.0 if off is None else (left @ off / variance) ** 2 / known
    level = SEEN_AT + (MORE_OF_A_PLACE if cause.places else 0.0)
    visible = np.where(seen, level * np.sqrt((1.0 + hidden) / known), np.inf)
    return Score(
        cause=cause,
        statistic=statistic,
        degrees=degrees,
        p=p,
        family=family,
        log_evidence=evidence,
        estimate=estimate,
        sigma=np.sqrt(uncertainty),
        visible=visible,
        components=components,
        directions=directions,
        strengths=eigenvalue[kept],
    )


def significance(
    cause: Cause,
    components: FloatArray,
    sensitivity: FloatArray,
    baseline: Evaluation,
    family: int,
    load_degrees: float,
) -> float:
    """Probability under the null of components as large, for the whole family of causes.

    Args:
        cause: the cause; what is one-sided and lies below its null is no finding.
        components: independent numbers of variance 1 under the null, shape (degrees,); that of what
            is one-sided has the sign of its effect.
        sensitivity: projected sensitivities of the cause on any scale, shape (k, n).
        baseline: evaluation at the optimum of the baseline.
        family: number of tries, of which a cause is one.
        load_degrees: degrees of freedom of the noise level of the loads.
    """
    if cause.one_sided and components.size and components[0] <= 0.0:
        return 1.0
    share = _in_loads(sensitivity, baseline)
    # Of what lies somewhere the data find place and width as well.
    degrees = components.size + (len(cause.companions) if cause.places else 0)
    p = _tail(float(components @ components), degrees, load_degrees, share)
    return min(1.0, family * (0.5 * p if cause.one_sided else p))


@dataclass(frozen=True)
class Together:
    """What all causes together would explain, to first order.

    Attributes:
        statistic: decrease of ‖r‖² over the variance of what is left [-].
        degrees: its degrees of freedom.
        p: probability under the null.
    """

    statistic: float
    degrees: int
    p: float


def score_together(
    effects: Sequence[FloatArray],
    baseline: Evaluation,
    load_degrees: float = np.inf,
    variance: float = 1.0,
) -> Together:
    """Score of all causes at once, each with a size of its own that no prior bounds.

    Of an effect that no cause of a library is like, several together often describe much more
    than any of them alone: that is the test of it which takes the fewest directions. The level of
    the noise is that of all that is left (F test).

    Args:
        effects: whitened sensitivities of the causes, shapes (k_c, n).
        baseline: evaluation at the optimum of the baseline.
        load_degrees: degrees of freedom of the noise level of the loads.
        variance: of whitened numbers along the causes, 1 for noise alone.
    """
    rows = np.concatenate([np.zeros((0, baseline.residual.size)), *effects])
    lengths = np.linalg.norm(rows, axis=1)
    rows = rows[lengths > np.sqrt(_FAINT)] / lengths[lengths > np.sqrt(_FAINT), None]
    if not len(rows):
        return Together(0.0, 0, 1.0)
    left, g, A = projected(rows, baseline)
    eigenvalue, vector = np.linalg.eigh(A)
    kept = eigenvalue > max(_OWN * eigenvalue[-1], _RANK)  # of rows of length one
    if not kept.any():
        return Together(0.0, 0, 1.0)
    along = vector[:, kept].T @ g
    degrees = int(kept.sum())
    others = baseline.residual.size - len(baseline.free) - degrees
    power = float(np.sum(along**2 / eigenvalue[kept]))
    rest = float(baseline.residual @ baseline.residual) - power
    statistic = power / (rest / others) / variance
    basis = vector[:, kept].T @ left / np.sqrt(eigenvalue[kept])[:, None]
    known = 1.0 / (_in_loads(basis, baseline) ** 2 / load_degrees + 1.0 / others)
    return Together(statistic, degrees, float(f_sf(statistic / degrees, degrees, known)))


def beside(fitted: Evaluation, shapes: FloatArray) -> Evaluation:
    """Return fit with shapes of the data, each of any size, beside its parameters, to first order.

    Args:
        fitted: the fit.
        shapes: whitened, shape (m, n); such as vanish are left out.
    """
    lengths = np.linalg.norm(shapes, axis=1)
    rows = shapes[lengths > 0] / lengths[lengths > 0, None]
    none = np.zeros(len(rows))
    return replace(
        fitted,
        free=(*fitted.free, *(f"shape {k}" for k in range(len(rows)))),
        jacobian=np.concatenate([fitted.jacobian, rows.reshape(-1, fitted.residual.size)]),
        prior_gap=np.concatenate([fitted.prior_gap, none]),
        prior_weight=np.concatenate([fitted.prior_weight, none]),
    )


def _in_loads(left: FloatArray, baseline: Evaluation) -> float:
    """Share of some directions that shows in the loads."""
    in_loads = float(np.sum(left[:, : baseline.n_load] ** 2))
    return in_loads / max(float(np.sum(left**2)), _FAINT)


def _tail(statistic: float, degrees: int, load_degrees: float, share: float) -> float:
    """Probability of a larger statistic, the noise of the loads known to some degrees."""
    if not degrees:
        return 1.0
    if np.isinf(load_degrees) or share == 0.0:
        return float(chi2_sf(statistic, degrees))
    return float(f_sf(statistic / degrees, degrees, load_degrees / share**2))


def subspace_similarity(first: Score, second: Score) -> float:
    """How much two causes do alike to the data, from 0 to 1; |cos| for a parameter each.

    A cause whose effects, in prior scales, are alike in all directions is expected to leave a
    projected misfit in proportion to Σ λ_i; another one can absorb the share
    Σ λ_i |Q d_i|² / Σ λ_i of it, Q the projector on its own directions. The likeness is the root
    of the smaller share of both ways: a cause of three parameters may absorb one of one parameter,
    and not the other way round.
    """
    if not first.directions.size or not second.directions.size:
        return 0.0
    return float(np.sqrt(min(_absorbed(first, second), _absorbed(second, first))))


def _absorbed(truth: Score, other: Score) -> float:
    """Share of the expected projected misfit of a cause that another one can absorb."""
    within = np.linalg.qr(other.directions.T)[0]
    share = np.sum((truth.directions @ within) ** 2, axis=1)
    return float(truth.strengths @ share / np.sum(truth.strengths))


def effects_of(
    causes: Sequence[Cause], augmented: Evaluation, parameters: Mapping[str, Parameter]
) -> list[FloatArray]:
    """Whitened sensitivities of each cause per prior scale, shapes (k_c, n).

    Args:
        causes: the causes.
        augmented: evaluation with the parameters of all of them free.
        parameters: declarations by name.
    """
    rows = [[augmented.free.index(name) for name in cause.parameters] for cause in causes]
    return [
        prior_scaled(augmented.jacobian[these], cause.parameters, parameters)
        for these, cause in zip(rows, causes, strict=True)
    ]
