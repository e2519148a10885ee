"""What the data say of each parameter, and what only the prior says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from driver.common.errors import InputError
from driver.common.formatting import joined
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation
from driver.parameters.registry import label_of
from meshes.arrays import FloatArray

INSENSITIVE = 0.5  # share of the variance that is the prior's from which a parameter is named
# Eigenvalue of the Hessian, scaled to a diagonal of ones, below which rounding decides.
SINGULAR = 1e-13
FAR = 3.0  # widths of its prior from whose mean on a parameter is told to be off
_PART = 0.2  # components of a null vector that are named

FAR_OFF = "far off the prior"
"""How the warning on such parameters begins."""


@dataclass(frozen=True)
class PriorRule:
    """A parameter that the prior decides rather than the data.

    Attributes:
        name: of the parameter.
        share: of its variance that comes from the prior.
        moved: by how many widths of its prior the data have moved it off the mean of that.
    """

    name: str
    share: float
    moved: float

    def sentence(self) -> str:
        """Return what a person should know of it."""
        stays = abs(self.moved) < 0.05
        where = "at whose mean it stays" if stays else f"{self.moved:+.1f} widths off its mean"
        return (
            f"{label_of(self.name)}: the data hardly see it; {self.share:.0%} of its variance is "
            f"that of its prior, {where}"
        )


def prior_shares(evaluation: Evaluation) -> FloatArray:
    """Share of the variance of each free parameter that comes from the prior, shape (k,).

    H⁻¹ = H⁻¹(JJᵀ)H⁻¹ + H⁻¹PH⁻¹: the noise of the data, and the width of the prior.
    """
    covariance = np.linalg.inv(evaluation.hessian)
    of_prior = np.einsum("ij,j,ij->i", covariance, evaluation.prior_weight, covariance)
    return np.asarray(of_prior / np.diag(covariance))


def ruled_by_prior(fit: Fit) -> tuple[PriorRule, ...]:
    """Return the parameters of which more than half of the variance is the prior's."""
    best = fit.best
    moved = -best.prior_gap * np.sqrt(best.prior_weight)
    return tuple(
        PriorRule(name, float(share), float(by))
        for name, share, by in zip(best.free, prior_shares(best), moved, strict=True)
        if share > INSENSITIVE
    )


def far_off_prior(fit: Fit) -> dict[str, float]:
    """By how many widths of its prior each parameter is off its mean, of those beyond `FAR`."""
    best = fit.best
    moved = -best.prior_gap * np.sqrt(best.prior_weight)
    return {name: float(by) for name, by in zip(best.free, moved, strict=True) if abs(by) > FAR}


def far_off_told(fit: Fit) -> tuple[str, ...]:
    """Return one sentence on all parameters that are far off their priors, or none."""
    far = far_off_prior(fit)
    if not far:
        return ()
    which = joined([f"{label_of(name)} by {by:+.1f}" for name, by in far.items()])
    return (
        f"{FAR_OFF}, in widths of it: {which}; usually the model lacks something that this "
        "makes up for (an apex amplitude: the law, the orientations or the drawn geometry), "
        "or start and width in the case are not what is known",
    )


def null_vector(evaluation: Evaluation) -> Mapping[str, float] | None:
    """Parts of a combination of parameters that neither data nor prior see, or None.

    In units of each parameter's own resolution; the largest is 1, small ones are left out.
    """
    hessian = evaluation.hessian
    unit = np.sqrt(np.diag(hessian))
    for name, length in zip(evaluation.free, unit, strict=True):
        if length == 0.0:
            return {name: 1.0}
    strength, modes = np.linalg.eigh(hessian / np.outer(unit, unit))
    if strength[0] > SINGULAR * strength[-1]:
        return None
    weakest = modes[:, 0] / modes[np.argmax(np.abs(modes[:, 0])), 0]
    return {
        name: float(part)
        for name, part in zip(evaluation.free, weakest, strict=True)
        if abs(part) > _PART
    }


def refuse_what_is_not_seen(evaluation: Evaluation) -> None:
    """Refuse a fit of which data and prior leave a combination of parameters open.

    Raises:
        InputError: with the names of the parameters.
    """
    parts = null_vector(evaluation)
    if parts is None:
        return
    names = ", ".join(parts)
    if len(parts) == 1:
        found = f"{names} changes nothing that images and loads show"
    else:
        mix = " ".join(f"{part:+.2g}·{name}" for name, part in parts.items())
        found = f"images and loads do not tell {names} apart (nothing changes along {mix})"
    raise InputError(
        f"identification: found that {found}, and no prior holds them; expected fewer free "
        'parameters, or a prior (identification.prior = "gaussian")'
    )
