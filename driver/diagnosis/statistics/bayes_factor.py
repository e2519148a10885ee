"""Evidence of causes: how much better the data are foreseen with them than without.

The prior scale of a cause is what is usual, not what is possible: its effect φ, k numbers in prior
scales, has Student's t distribution of scale one with ν = 4 degrees of freedom (Lange, Little and
Taylor, J. Am. Stat. Assoc. 84 (1989) 881), so that four scales are rare (1.6 %). Under a Gaussian
(0.006 %) they would cost 8 of log evidence, and the truth would lose to a rival that imitates it
with two scales of its own. A mixture of Gaussians needs no more than their closed form:

    p(φ) = ∫ N(φ; 0, I/λ) Γ(λ; ν/2, ν/2) dλ

    log ∫ p(φ) exp(gᵀφ − ½ φᵀAφ) dφ
        = log ∫ Γ(λ; ν/2, ν/2) exp(½ gᵀ(A + λI)⁻¹g − ½ log det(I + A/λ)) dλ

with g the score and A the information of φ, all other parameters projected out (Laplace). Several
causes have a λ each. Where an effect can only be above its null it has twice that density there and
none below, and each Gaussian its share above zero (of several such effects the product of theirs).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import log_ndtr, logsumexp

from driver.common.distributions import gamma_logpdf
from driver.identification.line_search import promised
from driver.identification.objective import Evaluation, Objective
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter

DEGREES = 4.0  # degrees of freedom of the prior
_STEP = 0.35
_LOG_PRECISIONS = np.arange(-14.0, 3.5, _STEP)  # log λ, for effects of up to a thousand scales
_WEIGHTS = (
    gamma_logpdf(np.exp(_LOG_PRECISIONS), DEGREES / 2, scale=2 / DEGREES)
    + _LOG_PRECISIONS
    + np.log(_STEP)
)


def projected(
    sensitivity: FloatArray, fitted: Evaluation
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sensitivities with the fitted parameters projected out, score g and information A.

    With r the whitened residual, J the fitted and C the other sensitivities, H = JJᵀ + prior:
    g = C r − C Jᵀ H⁻¹ (J r + prior·gap), A = C Cᵀ − C Jᵀ H⁻¹ J Cᵀ.

    Args:
        sensitivity: C, whitened, shape (k, n).
        fitted: evaluation of the fitted parameters.
    """
    J, H = fitted.jacobian, fitted.hessian
    coupling = np.linalg.solve(H, J @ sensitivity.T)
    left = sensitivity - coupling.T @ J
    g = sensitivity @ fitted.residual - coupling.T @ fitted.gradient
    A = sensitivity @ left.T
    return left, g, 0.5 * (A + A.T)


def log_mean_likelihood(
    g: FloatArray, A: FloatArray, sizes: Sequence[int], rising: Sequence[int] = ()
) -> float:
    """Log of the likelihood exp(gᵀφ − ½ φᵀAφ), averaged over the prior of φ.

    Args:
        g: score at the null, per prior scale, shape (k,).
        A: information, per prior scale, shape (k, k).
        sizes: how many of the k numbers belong to each cause, in their order.
        rising: those of the k numbers that can only be above zero.
    """
    nodes = np.indices((len(_LOG_PRECISIONS),) * len(sizes)).reshape(len(sizes), -1)
    log_precision = np.repeat(_LOG_PRECISIONS[nodes], sizes, axis=0).T
    inflated = A + np.exp(log_precision)[:, :, None] * np.eye(len(g))
    gained = np.linalg.solve(inflated, np.broadcast_to(g[:, None], (*log_precision.shape, 1)))
    volume = np.sum(log_precision, axis=1) - np.linalg.slogdet(inflated)[1]
    exponent = 0.5 * gained[..., 0] @ g + 0.5 * volume + np.sum(_WEIGHTS[nodes], axis=0)
    if rising:
        above = list(rising)
        sigma = np.sqrt(np.linalg.inv(inflated)[:, above, above])
        exponent += np.sum(np.log(2.0) + log_ndtr(gained[:, above, 0] / sigma), axis=1)
    return float(logsumexp(exponent))


def log_bayes_factor(
    before: Evaluation,
    after: Evaluation,
    objective: Objective,
    effects: Sequence[Sequence[str]],
    companions: Sequence[str],
    rising: Sequence[str] = (),
) -> float:
    """Log Bayes factor of a fit with causes against one without them.

    Parameters that both fits have are marginalised, and so are companions, under their Gaussian
    prior of one scale. The likelihood is the parabola about the end of the fit. Its slope there is
    what the wide prior holds back; what more it promises where a fit has not converged does not
    count.

    Args:
        before: the fit without them. It is taken to its optimum: one with a large excess ends
            before, and all that follows would seem to be gained by the causes.
        after: the fit with them, under the prior of the objective.
        objective: of the latter.
        effects: names of the parameters of each cause.
        companions: names of those that exist only with a cause.
        rising: names of the parameters of causes that can only be above their null.
    """
    names = [name for names_of_effect in effects for name in names_of_effect]
    rows = [after.free.index(name) for name in names]
    others = objective.restrict(after, [name for name in after.free if name not in names])
    effect = prior_scaled(after.jacobian[rows], names, objective.parameters)
    _, slope, A = projected(effect, others)
    amounts = amounts_of(names, after.values, objective)
    widths = np.array([objective.prior[n][1] / objective.parameters[n].width for n in names])
    axes = np.linalg.eigh(A)[1]
    held_back = axes.T @ (amounts / widths**2)
    pull = axes @ np.clip(axes.T @ slope, np.minimum(held_back, 0.0), np.maximum(held_back, 0.0))
    g = A @ amounts + pull
    cost_at_null = others.cost + float(amounts @ (g + pull))
    volume = np.linalg.slogdet(before.hessian)[1] - np.linalg.slogdet(others.hessian)[1]
    of_companions = sum(float(np.log(objective.prior[name][1])) for name in companions)
    above = [names.index(name) for name in rising]
    of_effects = log_mean_likelihood(
        g, A, [len(names_of_effect) for names_of_effect in effects], above
    )
    return (
        0.5 * (promised(objective, before) - cost_at_null)
        + 0.5 * float(volume)
        - of_companions
        + of_effects
    )


def amounts_of(
    names: Sequence[str], values: Mapping[str, float], objective: Objective
) -> FloatArray:
    """How many prior scales parameters are off their null, shape (k,).

    The null of a constant of the law (of n, say) is its value in the case.
    """
    known, nulls = objective.parameters, objective.model.null_values()
    return np.array(
        [known[name].theta(values[name], nulls[name]) / known[name].width for name in names]
    )


def prior_scaled(
    jacobian: FloatArray, names: Sequence[str], parameters: Mapping[str, Parameter]
) -> FloatArray:
    """∂/∂θ → derivative per prior scale, shape (k, n)."""
    widths = np.array([parameters[name].width for name in names])
    return np.asarray(jacobian * widths[:, None])
