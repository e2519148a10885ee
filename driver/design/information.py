"""What data would say of parameters, to first order: how well each is known, and what limits it.

With J the whitened sensitivities (k parameters, n numbers) and P the prior precisions, the
covariance is C = (J Jᵀ + P)⁻¹, the inverse of Fisher's information (Cramér–Rao, Laplace). It is
also C = C (J_images J_imagesᵀ + J_loads J_loadsᵀ + P) C: each term is the part of the variance
that the noise of images or of loads, or what the prior leaves open, is to blame for. The part of
a noise is the power by which the variance goes with that of the noise: if all of it is that of
the loads, half their noise halves σ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from driver.identification.data import Data
from driver.identification.objective import Evaluation
from driver.results.design import Knowledge
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter

SOURCES = ("images", "loads", "simulation", "prior")
"""What variance comes from: noise of images and of loads, error of the simulation, prior."""

LOOSE = 1e3  # prior of a parameter without one, in its θ: nobody would be so wrong
_UNSEEN = 0.9  # of its prior width that is left, beyond which data say nothing of a parameter


def groups_of(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Parameters that are known together or not at all, by what they are called."""
    families = {
        "elongation_": "the knots", "tilt_": "the knots", "lambda_": "the apex amplitudes",
        "origin_": "the position in the images",
    }  # fmt: skip
    groups: dict[str, tuple[str, ...]] = {}
    for name in names:
        family = next((f for start, f in families.items() if _belongs(name, start)), name)
        groups[family] = (*groups.get(family, ()), name)
    return groups


def _belongs(name: str, start: str) -> bool:
    # tilt_drift is an instrument's, tilt_3 is a knot.
    rest = name.removeprefix(start)
    return rest != name and (start not in ("tilt_", "elongation_") or rest.isdigit())


def knowledge(
    here: Evaluation, data: Data, parameters: Mapping[str, Parameter]
) -> tuple[Knowledge, ...]:
    """Return what data would say of each free parameter.

    Args:
        here: the expected evaluation; parameters without a prior have one of `LOOSE`.
        data: what it was whitened with.
        parameters: declarations by name.
    """
    covariance: FloatArray = np.asarray(np.linalg.inv(here.hessian), dtype=np.float64)
    parts = _parts(here, data, covariance)
    alone = 1.0 / np.sqrt(np.maximum(np.sum(here.jacobian**2, axis=1), 1e-30))
    return tuple(
        _one(here, parameters[name], i, covariance, parts[i], float(alone[i]))
        for i, name in enumerate(here.free)
    )


def _parts(here: Evaluation, data: Data, covariance: FloatArray) -> FloatArray:
    """Shares of the variance of each parameter by source, shape (k, 4)."""
    rows = covariance @ here.jacobian
    noise = data.noise_part(rows) ** 2
    images, loads = noise[:, here.n_load :].sum(axis=1), noise[:, : here.n_load].sum(axis=1)
    simulation = np.sum(rows**2, axis=1) - images - loads
    prior = covariance**2 @ here.prior_weight
    variances = np.column_stack([images, loads, simulation, prior])
    return np.asarray(variances / np.diag(covariance)[:, None])


def _one(
    here: Evaluation,
    parameter: Parameter,
    i: int,
    covariance: FloatArray,
    parts: FloatArray,
    alone: float,
) -> Knowledge:
    theta = float(np.sqrt(covariance[i, i]))
    prior = float(here.prior_weight[i] ** -0.5)
    partner, factor = _partner(here, i, covariance)
    unknown = theta > _UNSEEN * prior
    value = here.values[parameter.name]
    loose = prior >= LOOSE
    return Knowledge(
        name=parameter.name,
        value=value,
        unit=parameter.unit,
        relative=parameter.logarithmic,
        sigma=np.inf if loose and unknown else theta * abs(parameter.slope(value)),
        theta=np.inf if loose and unknown else theta,
        prior=np.inf if loose else prior,
        alone=alone,
        parts=dict(zip(SOURCES, parts.tolist(), strict=True)),
        partner=partner,
        factor=factor,
        limit=_limit(unknown, alone > prior, parts, partner, factor),
    )


def _partner(here: Evaluation, i: int, covariance: FloatArray) -> tuple[str, float]:
    """Who of the others would help a parameter most, were it known, and the factor on σ."""
    best, least = "", 1.0
    for group, members in groups_of(here.free).items():
        if here.free[i] in members:
            continue
        rows = [here.free.index(name) for name in members]
        across = covariance[i, rows]
        explained = across @ np.linalg.solve(covariance[np.ix_(rows, rows)], across)
        factor = float(np.sqrt(max(1.0 - explained / covariance[i, i], 0.0)))
        if factor < least:
            best, least = group, factor
    return best, least


_NAMES = ("the noise of the images", "the noise of the loads", "the simulation's error", "priors")
_CORRELATED = 0.7  # factor on σ below which a correlation is worth a word
_MAIN = 0.25  # share of the variance from which a source is worth a word


def _limit(unknown: bool, insensitive: bool, parts: FloatArray, partner: str, factor: float) -> str:
    if unknown and insensitive:
        return "not seen: the data do not depend on it, the prior alone holds it"
    order = np.argsort(-parts)
    main = [f"{_NAMES[s]} {parts[s]:.0%}" for s in order if parts[s] >= _MAIN]
    text = ", ".join(main)
    if factor < _CORRELATED:
        text += f"; correlated with {partner}: σ × {factor:.2f} if known"
    return ("not separated, the prior holds it; " if unknown else "") + text
