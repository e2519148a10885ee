"""Noise of the boundary motion as a cause: σ_e, found by its restricted likelihood.

It is the first suspect where loads scatter: an error of the elongation shows in the loads first,
for images resolve nanometres and a specimen of 10 µN/nm answers to a tenth of one. The fast load
residual tells it from a model error, which is slow, and from noise of the loads, for it grows with
the tangent stiffness: the noise of the loads is estimated with it, never taken as known.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.common.distributions import chi2_sf
from driver.common.progress import quiet
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.causes.candidates import NotExamined
from driver.diagnosis.causes.noise_causes import BOUNDARY_NOISE
from driver.diagnosis.search.refit import MOST_ITERATIONS, TOLERANCE
from driver.diagnosis.statistics.goodness_of_fit import FAMILY_LEVEL
from driver.diagnosis.statistics.high_pass_loads import FEWEST, LEFT, high_pass_loads
from driver.diagnosis.statistics.score_test import Score
from driver.diagnosis.statistics.variance_component import Component, component
from driver.identification.boundary_jitter import BoundaryJitter, boundary_jitter
from driver.identification.data import Data
from driver.identification.fit import fit
from driver.identification.objective import Evaluation, Objective
from driver.parameters.covariance import SIGMA_E
from meshes.arrays import FloatArray

logger = logging.getLogger(__name__)

Level = tuple[float, float]

_TURNS = 5  # of fit and level
_SIMULATED = 2  # turns after which the answers to each stop are simulated anew
_SEEN = 1e-3  # effect of a prior scale on the fast loads [σ] below which a cause explains none
_CLEAR = 3.0  # log evidence: twenty to one
_SETTLED = 0.03  # relative change of the level with which they end


@dataclass(frozen=True, eq=False)
class BoundaryNoiseSensitivities:
    """The answers to an elongation of one prior scale at each stop, or why there are none.

    Attributes:
        effect: the answers, None where they were not computed.
        why: the reason for which they were not, None where nobody asked for them.
    """

    effect: BoundaryJitter | None
    why: NotExamined | None = None


def sensitivities_where_they_pay(
    baseline: Evaluation, objective: Objective, stated: float, wanted: tuple[str, ...] | None
) -> BoundaryNoiseSensitivities:
    """Return the answers to each stop where the fast loads are worse than stated, else the reason.

    Args:
        baseline: the fit, with the noise of the loads that was found.
        objective: its objective.
        stated: the noise of the loads that was stated [µN].
        wanted: names of the causes to try, None for all.

    Raises:
        SolverError: as `ForwardModel.predict`.
    """
    model, data = objective.model, objective.data

    def none(why: str) -> BoundaryNoiseSensitivities:
        return BoundaryNoiseSensitivities(None, NotExamined(BOUNDARY_NOISE.name, why))

    if wanted is not None and BOUNDARY_NOISE.name not in wanted:
        return BoundaryNoiseSensitivities(None)
    if data.jitter is not None:
        return none("boundary.jitter_nm states it, and the covariance holds it")
    if not data.with_loads:
        return none("there are no loads")
    if model.adapter.capabilities().runs_per_direction:
        return none(
            f"it takes a derivative for each of {data.index.size} images, and the solver has none"
        )
    degrees, factor = data.load_degrees, data.load_noise / stated
    if not FEWEST <= degrees < np.inf:
        return none("there are too few loads to tell noises by")
    p = float(chi2_sf(degrees * factor**2, degrees))
    if p > FAMILY_LEVEL:
        return none(
            f"the loads scatter by {factor:.2f} of their stated noise (p {p:.2g}): none is seen"
        )
    return BoundaryNoiseSensitivities(
        boundary_jitter(model, data.image, baseline.values, SIGMA_E.scale)
    )


def score_boundary_noise(
    stops: BoundaryJitter,
    baseline: Evaluation,
    data: Data,
    causes: Sequence[FloatArray],
    family: int,
) -> Score:
    """Score σ_e; it has to stand with any other cause freed.

    Args:
        stops: the answers to each stop.
        baseline: the fit, under a covariance without it.
        data: the data.
        causes: whitened sensitivities per prior scale of each cause, shapes (k_c, n).
        family: number of tries, of which a cause is one.
    """
    fast = high_pass_loads(baseline)
    shown, y = fast.of(data.effect_of_stops(stops)), fast.residual
    noise = component(shown, y)
    worst = noise.p
    for cause in causes:
        apart = _complement(fast.of(cause))
        worst = max(worst, component(shown @ apart, y @ apart).p)
    return Score(
        cause=BOUNDARY_NOISE,
        statistic=noise.ratio,
        degrees=1,
        p=min(1.0, worst * family),
        family=family,
        log_evidence=noise.log_evidence,
        estimate=np.array([noise.level]),
        sigma=np.array([noise.spread]),
        visible=np.array([noise.visible]),
        components=np.empty(0),
        directions=np.empty((0, baseline.residual.size)),
        strengths=np.empty(0),
    )


def in_fast_loads(stops: BoundaryJitter, at: Evaluation, data: Data) -> Component:
    """σ_e as a variance component of the fast load residual.

    Args:
        stops: the answers to each stop.
        at: a fit, whitened without them.
        data: the data without them.
    """
    fast = high_pass_loads(at)
    return component(fast.of(data.effect_of_stops(stops)), fast.residual)


def explains_better(
    stops: BoundaryJitter, whole: Evaluation, data: Data, frames: Sequence[int]
) -> bool:
    """Whether σ_e makes what is seen in loads clearly likelier than errors of some of them do.

    Where the specimen is stiff its stops stand out of the loads as errors of single ones do. Both
    are judged by their likelihood in all fast loads, less what each was free to choose (Schwarz's
    criterion; an error may be that of any load).

    Args:
        stops: the answers to each stop.
        whole: a fit whose residual holds these loads, whitened without noise of the boundary.
        data: its data.
        frames: of the loads in question.
    """
    # In the space in which they were found to be errors.
    fast = high_pass_loads(whole, LEFT)
    y, m = fast.residual, fast.residual.size
    single = np.eye(whole.n_load)[np.isin(data.load_index, frames)]
    across = _complement(fast.of(data.load_changes(data.load_noise * single)))
    off = y @ across
    choice = 0.5 * np.log(m)
    of_errors = 0.5 * m * np.log(float(y @ y) / float(off @ off))
    of_errors = max(of_errors - len(frames) * (choice + np.log(whole.n_load)), 0.0)
    noise = component(fast.of(data.effect_of_stops(stops)), y)
    return bool(0.5 * noise.ratio - choice > of_errors + _CLEAR)


def _complement(rows: FloatArray) -> FloatArray:
    """Orthonormal columns across the rows that are seen at all, shape (m, m − rank)."""
    _, strength, across = np.linalg.svd(rows)
    return np.asarray(across[int(np.count_nonzero(strength > _SEEN)) :].T)


def refit_boundary_noise(
    stops: BoundaryJitter, baseline: Evaluation, objective: Objective
) -> Refit:
    """Fit under the covariance with σ_e, and σ_e to what the fit leaves, by turns.

    The answers to each stop are those of a fit that did not know of the noise, and may be wrong
    where it yields: they are simulated again once the fit does.

    Raises:
        SolverError: as `ForwardModel.predict`.
    """
    model, image = objective.model, objective.data.image
    noise, best = in_fast_loads(stops, baseline, objective.data), baseline
    for turn in range(_TURNS):
        noisy = with_level(objective, stops, noise)
        with quiet():
            result = fit(
                noisy, best.values, best.free, MOST_ITERATIONS,
                start=noisy.with_free(best, best.free), tolerance=TOLERANCE,
            )  # fmt: skip
        before, best = noise.level, result.best
        if turn < _SIMULATED:
            stops = boundary_jitter(model, image, best.values, SIGMA_E.scale)
        noise = in_fast_loads(stops, objective.with_free(best, best.free), objective.data)
        if turn >= _SIMULATED and abs(noise.level - before) <= _SETTLED * before:
            break
    noisy = with_level(objective, stops, noise)
    result = replace(result, best=noisy.with_free(best, best.free))
    level, sigma = _level(noise)
    logger.info(
        f"  {BOUNDARY_NOISE.name}: log evidence {noise.log_evidence:+.1f}, "
        f"χ_F {result.best.chi_load:.2f}, χ of images {result.best.chi_image:.3f}, "
        f"σ_e {1e3 * level:.3g} nm"
    )
    return Refit(BOUNDARY_NOISE, noisy, result, noise.log_evidence, {SIGMA_E.name: (level, sigma)})


def with_level(objective: Objective, stops: BoundaryJitter, found: Component) -> Objective:
    """Return objective with a boundary as noisy as found, and loads as noisy as found beside it."""
    jitter = BoundaryJitter(found.level * stops.load, found.level * stops.image)
    data = objective.data
    data = replace(
        data, jitter=jitter, load_noise=found.noise * data.load_noise,
        load_degrees=float(found.power.size),
    )  # fmt: skip
    return replace(objective, data=data)


def level_again(
    at: Evaluation,
    objective: Objective,
    before: Mapping[str, Level],
) -> tuple[Objective, dict[str, Level]]:
    """σ_e once more after a cause was added; none where it is not needed any more.

    Args:
        at: the fit.
        objective: its objective, with σ_e as it was.
        before: σ_e as it was, by name.

    Returns:
        The objective, and σ_e with its standard deviation [µm] by name, empty if the data do
        without.
    """
    assumed, data = objective.data.jitter, replace(objective.data, jitter=None)
    assert assumed is not None
    scales = before[SIGMA_E.name][0] / SIGMA_E.scale
    stops = BoundaryJitter(assumed.load / scales, assumed.image / scales)
    bare = replace(objective, data=data)
    noise = in_fast_loads(stops, bare.with_free(at, at.free), data)
    if noise.p < FAMILY_LEVEL:
        return with_level(bare, stops, noise), {SIGMA_E.name: _level(noise)}
    logger.info(f"{BOUNDARY_NOISE.name} is not needed any more")
    return bare, {}


def _level(found: Component) -> Level:
    """σ_e and its standard deviation [µm]."""
    return SIGMA_E.scale * found.level, SIGMA_E.scale * found.spread
