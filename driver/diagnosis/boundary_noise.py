"""Noise of the boundary motion as a cause: σ_e, found by its restricted likelihood.

It takes a direction for the stop of each image, and is therefore looked for only where it pays:
where the loads scatter beyond their noise. An error of the elongation shows in the loads first,
for images resolve nanometres and a specimen of 10 µN/nm answers to a tenth of one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from driver.diagnosis.causes import BOUNDARY_NOISE, SIGMA_E, NotExamined
from driver.diagnosis.omnibus import FAMILY_LEVEL
from driver.diagnosis.refit import MOST_ITERATIONS, TOLERANCE, Refit
from driver.diagnosis.score import Score
from driver.diagnosis.variance_component import Component, component
from driver.identification.boundary_jitter import BoundaryJitter, boundary_jitter
from driver.identification.fit import Evaluation, Fit, Objective, fit
from solver_adapters.finite_differences import FiniteDifferences

_ROUNDS = 3  # of fit and level by turns
_SETTLED = 0.05  # relative change of the level with which they end


@dataclass(frozen=True, eq=False)
class Stops:
    """The answers to an elongation of one prior scale at each stop, or why there are none.

    Attributes:
        effect: the answers, None where they were not computed.
        why: the reason for which they were not.
    """

    effect: BoundaryJitter | None
    why: NotExamined | None = None


def stops_where_they_pay(
    baseline: Evaluation, objective: Objective, wanted: tuple[str, ...] | None
) -> Stops:
    """The answers to each stop where the loads are worse than noise, else the reason.

    Raises:
        SolverError: as `ForwardModel.predict`.
    """
    model, data = objective.model, objective.data

    def none(why: str) -> Stops:
        return Stops(None, NotExamined(BOUNDARY_NOISE.name, why))

    if wanted is not None and BOUNDARY_NOISE.name not in wanted:
        return Stops(None)
    if data.jitter is not None:
        return none("boundary.jitter_nm states it, and the covariance holds it")
    if not data.with_loads:
        return none("there are no loads")
    # Words about a running simulation may be wrapped around the solver.
    if isinstance(getattr(model.adapter, "inner", model.adapter), FiniteDifferences):
        return none(
            f"it takes a derivative for each of {data.index.size} images, and the solver has none"
        )
    p = p_of_loads(baseline)
    if p > FAMILY_LEVEL:
        chi = baseline.chi_load
        return none(f"the loads are within their noise (χ_F {chi:.2f}, p {p:.2g}): none is seen")
    return Stops(boundary_jitter(model, data.image, baseline.values, SIGMA_E.scale))


def p_of_loads(fitted: Evaluation) -> float:
    """Probability of loads as far off as these, were there their stated noise alone."""
    taken = np.linalg.solve(np.linalg.cholesky(fitted.hessian), fitted.jacobian)
    loads = fitted.residual[: fitted.n_load]
    freedom = loads.size - float(np.sum(taken[:, : fitted.n_load] ** 2))
    return float(chi2.sf(loads @ loads, max(freedom, 1.0)))


def score_boundary_noise(
    stops: BoundaryJitter, baseline: Evaluation, objective: Objective, family: int
) -> Score:
    """Score σ_e; the statistic is that of the likelihood ratio, p that of the score test."""
    found = component(objective.data.effect_of_stops(stops), baseline)
    return Score(
        cause=BOUNDARY_NOISE,
        statistic=found.ratio,
        degrees=1,
        p=min(1.0, found.p * family),
        log_evidence=found.log_evidence,
        estimate=np.array([found.largest]),
        sigma=np.array([found.spread]),
        visible=np.array([found.visible]),
        directions=np.empty((0, baseline.residual.size)),
    )


def refit_boundary_noise(
    stops: BoundaryJitter, baseline: Evaluation, objective: Objective, log: Callable[[str], None]
) -> Refit:
    """Fit under the covariance with σ_e, and σ_e to what the fit leaves, by turns."""
    found = component(objective.data.effect_of_stops(stops), baseline)
    best, level = baseline, found.largest
    for _ in range(_ROUNDS):
        noisy = with_level(objective, stops, level)
        result = fit(
            noisy, best.values, best.free, MOST_ITERATIONS, _silent,
            start=noisy.complete(best, best.free), tolerance=TOLERANCE,
        )  # fmt: skip
        best, before = result.best, level
        found, level = at_fit(objective, stops, best)
        if abs(level - before) <= _SETTLED * before:
            break
    effect = before * objective.data.effect_of_stops(stops)
    grown = float(np.linalg.slogdet(np.eye(len(effect)) + effect @ effect.T)[1])
    hessians = np.linalg.slogdet(baseline.hessian)[1] - np.linalg.slogdet(best.hessian)[1]
    evidence = 0.5 * (baseline.cost - best.cost + float(hessians) - grown)
    # σ_e is not fixed where it is likeliest, but has a prior.
    evidence += found.log_evidence - 0.5 * found.ratio
    sigma = SIGMA_E.scale * found.spread
    log(
        f"  {BOUNDARY_NOISE.name}: log evidence {evidence:+.1f}, χ_F {best.chi_load:.2f}, χ of "
        f"images {best.chi_image:.3f}, σ_e {1e3 * SIGMA_E.scale * before:.3g} nm"
    )
    level_found = {SIGMA_E.name: (SIGMA_E.scale * before, sigma)}
    return Refit(BOUNDARY_NOISE, noisy, result, evidence, level_found)


def with_level(objective: Objective, stops: BoundaryJitter, level: float) -> Objective:
    """The objective with a boundary that is as noisy as a number of prior scales."""
    jitter = BoundaryJitter(level * stops.load, level * stops.image)
    return replace(objective, data=replace(objective.data, jitter=jitter))


def at_fit(objective: Objective, stops: BoundaryJitter, at: Evaluation) -> tuple[Component, float]:
    """σ_e as a component at a fit, whatever was assumed of it there, and its likeliest level."""
    bare = replace(objective, data=replace(objective.data, jitter=None))
    found = component(bare.data.effect_of_stops(stops), bare.complete(at, at.free))
    return found, found.largest


def level_again(
    here: Fit, objective: Objective, stops: BoundaryJitter, most: int, log: Callable[[str], None]
) -> tuple[Fit, Objective, dict[str, tuple[float, float]]]:
    """σ_e and the fit once more after a cause was added; none where it is not needed any more.

    Returns:
        The fit, its objective, and σ_e with its standard deviation [µm] by name, empty if the
        data do without.
    """
    found, level = at_fit(objective, stops, here.best)
    needed = found.p < FAMILY_LEVEL
    if needed:
        objective = with_level(objective, stops, level)
    else:
        log(f"{BOUNDARY_NOISE.name} is not needed any more")
        objective = replace(objective, data=replace(objective.data, jitter=None))
    free = here.best.free
    here = fit(objective, here.values, free, most, log, start=objective.complete(here.best, free))
    scale = SIGMA_E.scale
    return here, objective, {SIGMA_E.name: (scale * level, scale * found.spread)} if needed else {}


def _silent(line: str) -> None:
    """Its fits are told in one line at the end."""
