"""The diagnosis from a fitted baseline: screen, refit, name, extend, test, measure the gain."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from driver.common.outcomes import Failure, attempt
from driver.diagnosis.answer.result_types import Diagnosis, DiscretisationCheck, Round, Settings
from driver.diagnosis.answer.verdict import (
    BEGIN_AT_END,
    BETTER_STARTS,
    MORE_ITERATIONS,
    decide,
    with_bounds,
    with_doubts,
    with_own_error_counted,
    with_share_of_correction,
    with_what_one_mesh_shows,
)
from driver.diagnosis.causes.all_causes import every
from driver.diagnosis.causes.candidates import NotExamined, not_examined
from driver.diagnosis.causes.ebsd_flips import flips_of
from driver.diagnosis.causes.noise_causes import COVARIANCE, NOISE_NOT_UNIFORM
from driver.diagnosis.search.baseline import loads_taken_back, prepared
from driver.diagnosis.search.boundary_noise import (
    BoundaryNoiseSensitivities,
    sensitivities_where_they_pay,
)
from driver.diagnosis.search.discretisation_check import (
    discretisation_check,
    with_missing_share,
    with_what_is_needed,
)
from driver.diagnosis.search.extension import Extension
from driver.diagnosis.search.final_comparison import (
    Final,
    correction_at,
    final_comparison,
)
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.forward_selection import (
    Selection,
    forward_selection,
    with_correction_anew,
)
from driver.diagnosis.search.image_noise import with_uneven_noise
from driver.diagnosis.statistics.model_comparison import (
    log_evidence,
    share_described,
    share_explained,
)
from driver.diagnosis.statistics.score_test import Score
from driver.diagnosis.statistics.screening import honoured, parameters_of_the_specimen, screened
from driver.identification.correction import Correction
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from driver.parameters.covariance import NOISE_RATIO
from meshes.arrays import IntArray

logger = logging.getLogger(__name__)

_MOST_ANEW = 3  # fits of the last model with the correction at its own end


def diagnose(
    baseline: Fit,
    objective: Objective,
    finer: FineModels,
    cycles: IntArray,
    settings: Settings,
    augmented: Evaluation | None = None,
) -> Diagnosis:
    """Find out what the baseline gets wrong.

    Args:
        baseline: converged fit with the correction.
        objective: its objective.
        finer: the finer models behind the correction.
        cycles: number of the cycle of each image, shape (T,).
        settings: how to run.
        augmented: evaluation at the baseline with the parameters of `screened` free, if known.

    Raises:
        SolverError: a simulation could not be finished.
    """
    model = objective.model
    left = not_examined(
        parameters_of_the_specimen(model), honoured(model), baseline.best.free, settings.wanted,
        settings.own, model.n_grains,
    ) + flips_of(model.microstructure.orientations, settings.wanted)[1]  # fmt: skip
    candidates, names = screened(model, baseline.best.free, settings.wanted, settings.own)
    if augmented is None:
        augmented = objective.evaluate(baseline.values, names)
    begin = prepared(baseline, objective, augmented, candidates, settings)
    stated, uneven = objective.data.load_noise, begin.uneven
    stops = sensitivities_where_they_pay(
        begin.baseline.best, begin.objective, stated, settings.wanted
    )
    begin = loads_taken_back(begin, stops, candidates, names)
    left += begin.left + (() if stops.why is None else (stops.why,))
    for unexamined in left:
        logger.info(f"  {unexamined.cause} is not examined: {unexamined.why}")
    selection = forward_selection(begin, finer, stops, settings)
    selection, final, passed = _with_own_error_tested(selection, stops, cycles, settings)
    first, end, rounds = selection.begin, selection.end, list(selection.rounds)
    fitted, current = end.fit, end.objective
    causes, levels = list(end.causes), dict(end.levels)
    if uneven is not None:
        rounds = [_with_score(round_, uneven.score) for round_ in rounds]
    explained = share_explained(final.uncounted, fitted.best) if causes else float("nan")
    of_causes = {cause.name for cause in causes}
    # What was dropped and added again counts once.
    sets = {round_.named[0]: round_.named for round_ in rounds if of_causes & set(round_.named[:1])}
    known = every(current.model.n_grains)
    by_name = {cause.name: cause for cause in (*known, *settings.own)}
    added_sets = [[by_name[name] for name in names] for names in sets.values()]
    answer = partial(
        decide, added_sets, rounds[-1].goodness_of_fit.seen, settings.imaging_limited,
        explained=share_described(
            final.uncounted, fitted.best, rounds[-1].goodness_of_fit.left
        ),
        tried=any(s.degrees for round_ in rounds for s in round_.scores),
    )  # fmt: skip
    held = [n for n in fitted.at_bounds(current.parameters) if current.parameters[n].ends_at_bounds]
    verdict = with_bounds(answer(numerics=None), held)
    if passed.words is not None:
        left_over = bool(passed.fitted_anew) and not rounds[-1].goodness_of_fit.accepted
        if left_over and verdict.kind == "unexplained":
            verdict = with_own_error_counted(verdict)
        else:
            verdict = answer(numerics=passed.words)
    elif passed.between_meshes:
        verdict = with_what_one_mesh_shows(verdict, passed.along.title, passed.effect)
    if passed.missing is not None:
        verdict = with_share_of_correction(verdict, *passed.missing)
    fits = {"identified": first.fit} | ({"extended": fitted} if causes else {})
    verdict = with_doubts(
        verdict,
        [
            f"the fit of the {name} model has not converged ({fit.reason})"
            for name, fit in fits.items()
            if not fit.converged
        ],
        [*selection.doubts, *_at_bounds(end)],
        to_converge(baseline, first.fit),
    )
    if uneven is not None and uneven.named:
        verdict = with_uneven_noise(verdict)
        causes = [NOISE_NOT_UNIFORM, *causes]
        levels |= {NOISE_RATIO.name: (uneven.ratio, uneven.sigma)}
    return Diagnosis(
        baseline=first.fit,
        baseline_objective=first.objective,
        extended=fitted,
        objective=current,
        bad_loads=tuple(load for load in begin.bad if load.frame in current.data.bad_loads),
        rounds=tuple(rounds),
        causes=tuple(causes),
        numerics=passed,
        held_out=final.held_out,
        explained=explained,
        log_evidence=end.of_noise + log_evidence(final.before, fitted.best, current, causes),
        not_examined=left + _never_tried(rounds),
        verdict=verdict,
        levels=levels,
    )


def _with_own_error_tested(
    selection: Selection,
    stops: BoundaryNoiseSensitivities,
    cycles: IntArray,
    settings: Settings,
) -> tuple[Selection, Final, DiscretisationCheck]:
    """Return what was selected, fitted anew where its own error is another one at its end.

    Returns:
        The selection, what is found at its end, and the test of its own error.
    """
    logger.info("the correction once more, and the held-out cycle predicted from the others")
    final = _compared(selection, cycles, settings)
    fresh, passed = final.fresh, _own_error(selection, final.fresh)
    for fitted_anew in range(1, _MOST_ANEW + 1):
        if passed.passed or not selection.end.causes:
            break
        logger.info("its own error is another one there: fitted with the correction taken anew")
        anew = attempt(partial(with_correction_anew, selection, stops, settings))
        if isinstance(anew, Failure):
            logger.info(f"  it cannot be simulated ({anew.why})")
            break
        selection = anew
        logger.info("the correction once more")
        end = selection.end
        fresh = correction_at(end.fit, end.objective, end.finer.one)
        passed = replace(_own_error(selection, fresh), fitted_anew=fitted_anew)
    if passed.fitted_anew:
        logger.info("compared with the baseline once more")
        final = _compared(selection, cycles, settings, fresh)
    if not passed.passed and passed.needed is None:
        end = selection.end
        passed = with_what_is_needed(
            passed, end.objective, end.fit, fresh, end.finer.one,
            selection.rounds[-1].scores, _added(end),
        )  # fmt: skip
    if passed.passed:
        end, last = selection.end, selection.rounds[-1]
        passed = with_missing_share(passed, last, end.objective, end.fit, fresh, end.finer.one)
    return selection, final, passed


def _compared(
    selection: Selection, cycles: IntArray, settings: Settings, fresh: Correction | None = None
) -> Final:
    """Return what is found at the end of the rounds."""
    first, end = selection.begin, selection.end
    before, after = (first.fit, first.objective), (end.fit, end.objective)
    return final_comparison(before, after, end.causes, end.finer.one, cycles, settings, fresh)


def _own_error(selection: Selection, fresh: Correction) -> DiscretisationCheck:
    """Return the test of the simulation's own error at the end of the rounds."""
    end, last = selection.end, selection.rounds[-1]
    passed = discretisation_check(end.objective, end.fit, fresh, last.scores, _added(end))
    if last.lost is not None and not end.causes and (passed.passed or not last.lost.passed):
        passed = last.lost
    logger.info(
        f"  change of the simulation's own error: {passed.effect:.2f} σ along {passed.along.name}"
    )
    return passed


def _added(end: Extension) -> list[str]:
    """Return the parameters of the causes that were added, noises apart."""
    return [n for cause in end.causes if cause not in COVARIANCE for n in cause.parameters]


def to_converge(identified: Fit, baseline: Fit) -> str:
    """Return what lets the fits converge of which one has not.

    Args:
        identified: the fit that was given.
        baseline: the same as it was examined, by iterations of its own where the noise changed.
    """
    if baseline.converged:
        return BEGIN_AT_END
    return MORE_ITERATIONS if identified.at_limit else BETTER_STARTS


def _at_bounds(end: Extension) -> list[str]:
    """Return parameters of the causes that ended at a bound, in words; companions are no effect."""
    known, values = end.objective.parameters, end.fit.values
    of_causes = {name for cause in end.causes for name in cause.parameters}
    return [
        f"{known[name].title} stands at its bound, {values[name]:g} {known[name].unit}".rstrip()
        + f": the data would have it {'larger' if values[name] >= known[name].upper else 'smaller'}"
        for name in end.fit.at_bounds(known)
        if name in of_causes
    ]


def _never_tried(rounds: Sequence[Round]) -> tuple[NotExamined, ...]:
    """Return the flips of the EBSD frame that no round tried, with the reason of the last one."""
    tried = {s.cause.name for round_ in rounds for s in round_.scores}
    why = {
        untried.cause: untried
        for round_ in rounds
        for untried in round_.untried
        if untried.cause not in tried
    }
    return tuple(why.values())


def _with_score(round_: Round, score: Score) -> Round:
    scores = sorted((*round_.scores, score), key=lambda s: -s.log_evidence)
    return replace(round_, scores=tuple(scores))
