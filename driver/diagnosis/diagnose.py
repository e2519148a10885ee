"""The diagnosis from a fitted baseline: screen, refit, name, extend, test, measure the gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from driver.boundary import elongation_names, tilt_names
from driver.diagnosis.causes import LIBRARY, NUMERICS, Cause, NotExamined, not_examined
from driver.diagnosis.ebsd_flips import FLIPS, flips_of
from driver.diagnosis.elimination import eliminate
from driver.diagnosis.flip_trial import turned
from driver.diagnosis.gain import log_evidence, share_explained
from driver.diagnosis.gate import gate
from driver.diagnosis.held_out import HeldOut, HeldOutTask, knots_of_cycle, predict_held_out
from driver.diagnosis.loads import bad_loads
from driver.diagnosis.outcome import Diagnosis, Log, Settings, Step
from driver.diagnosis.preparation import noise_of_images, prepared, with_load_noise
from driver.diagnosis.refit import Refit
from driver.diagnosis.round import examine
from driver.diagnosis.screening import honoured, parameters_of_the_specimen, screened
from driver.diagnosis.verdict import MOST_ADDITIONS, decide
from driver.identification.fit import Correction, Evaluation, Fit, Objective, fit
from driver.identification.procedure import correction, with_correction
from driver.model import ForwardModel
from driver.side_by_side import side_by_side

IntArray = NDArray[np.int64]

MOST_STEPS = 5  # rounds, where elimination keeps taking back what was added
POLISH = 8  # Newton iterations of an extended model with its own correction


def diagnose(
    baseline: Fit,
    objective: Objective,
    finer: ForwardModel,
    cycles: IntArray,
    settings: Settings,
    log: Log,
    wide: Evaluation | None = None,
) -> Diagnosis:
    """Find out what the baseline gets wrong.

    Args:
        baseline: converged fit with the correction.
        objective: its objective.
        finer: the finer model behind the correction.
        cycles: number of the cycle of each image, shape (T,).
        settings: how to run.
        log: takes one line of progress.
        wide: evaluation at the baseline with the parameters of `screened` free, if known.

    Raises:
        SolverError: the model cannot be evaluated at the baseline.
    """
    model = objective.model
    left = not_examined(
        parameters_of_the_specimen(model), honoured(model), baseline.best.free, settings.wanted,
        settings.own,
    ) + flips_of(model.microstructure.orientations, settings.wanted)[1]  # fmt: skip
    for one in left:
        log(f"  {one.cause} is not examined: {one.why}")
    candidates, names = screened(model, baseline.best.free, settings.wanted, settings.own)
    if wide is None:
        wide = objective.evaluate(baseline.values, names)
    begin = prepared(baseline, objective, wide, candidates, settings, log)
    objective, known = begin.objective, begin.wide
    here, current = begin.baseline, objective
    steps: list[Step] = []
    causes: list[Cause] = []
    while True:
        log(f"screening at χ_F {here.best.chi_load:.2f}, χ of images {here.best.chi_image:.3f}")
        step, winner = examine(here, current, causes, settings, known, log)
        known = None
        steps.append(step)
        if winner is None or len(causes) == MOST_ADDITIONS or len(steps) > MOST_STEPS:
            break
        causes.append(winner.cause)
        log(f"added {winner.cause.name}, log evidence {winner.log_evidence:+.1f}")
        finer = turned(finer, (winner.cause,))
        here, current = _extended(winner, finer, settings, log)
        here, current, causes = eliminate(here, current, causes, log)
    log("the correction once more, and the held-out cycle predicted from the others")
    tasks: list[_Refresh | _Again | HeldOutTask] = [_Refresh(current.model, finer, here)]
    # Before and after are compared under one covariance, that of the end.
    final = replace(objective, data=current.data)
    if causes:
        tasks.append(_Again(final, begin.baseline))
    tasks += _held_out_tasks(final, current, begin.baseline, here, cycles, settings)
    ends = side_by_side(_run, tasks, settings.processes, settings.threads)
    fresh = next(end for end in ends if isinstance(end, Correction))
    before = next((end.best for end in ends if isinstance(end, Fit)), here.best)
    held = [end for end in ends if isinstance(end, HeldOut)]
    added = [name for cause in causes for name in cause.parameters]
    passed = gate(current, here, fresh, finer, steps[-1].scores, added)
    log(f"  change of the simulation's own error: {passed.effect:.2f} σ along {passed.cause}")
    explained = share_explained(before, here.best) if causes else float("nan")
    of_causes = {cause.name for cause in causes}
    every = (*LIBRARY, *FLIPS, *settings.own, NUMERICS)
    verdict = decide(
        [step.named for step in steps if step.named and step.named[0] in of_causes],
        steps[-1].omnibus.accepted,
        settings.imaging_limited,
        passed.words,
        {cause.name: cause.sentence for cause in every},
        {cause.name: cause.check for cause in every},
        explained,
    )
    return Diagnosis(
        baseline=begin.baseline,
        extended=here,
        objective=current,
        bad_loads=tuple(one for one in begin.bad if one.frame in current.data.bad_loads),
        steps=tuple(steps),
        causes=tuple(causes),
        gate=passed,
        held_out=(held[0], held[-1]) if held else None,
        explained=explained,
        log_evidence=log_evidence(before, here.best, current, causes),
        not_examined=left + _never_tried(steps),
        verdict=verdict,
    )


def _never_tried(steps: Sequence[Step]) -> tuple[NotExamined, ...]:
    """The flips of the EBSD frame that no round tried, with the reason of the last one."""
    tried = {s.cause.name for step in steps for s in step.scores}
    why = {one.cause: one for step in steps for one in step.untried if one.cause not in tried}
    return tuple(why.values())


def _extended(
    winner: Refit, finer: ForwardModel, settings: Settings, log: Log
) -> tuple[Fit, Objective]:
    """The extended model with its own correction and noise, fitted.

    A load that was left out and that the extended model explains is taken back.
    """
    objective = winner.objective
    log("finer mesh and steps at the extended model")
    change = correction(objective.model, finer, winner.fit, log)
    noise = noise_of_images(winner.fit, objective.data, settings)
    objective = with_correction(objective, noise, change, settings.sizes)
    free = winner.fit.best.free
    here = fit(objective, winner.fit.values, free, POLISH, log)
    data = objective.data
    if data.bad_loads:
        whole = replace(objective, data=replace(data, bad_loads=()))
        again = whole.compare(here.best.prediction, here.values, free)
        still = {one.frame for one in bad_loads(again, whole.data)} & set(data.bad_loads)
        data = replace(data, bad_loads=tuple(sorted(still)))
        objective = replace(objective, data=data)
    at = objective.compare(here.best.prediction, here.values, free)
    objective = replace(objective, data=with_load_noise(data, at, log))
    at = objective.compare(here.best.prediction, here.values, free)
    return fit(objective, here.values, free, POLISH, log, start=at), objective


@dataclass(frozen=True, eq=False)
class _Refresh:
    """A correction to be taken at a fit."""

    working: ForwardModel
    finer: ForwardModel
    at: Fit


@dataclass(frozen=True, eq=False)
class _Again:
    """A fit to be made again under another covariance."""

    objective: Objective
    fit: Fit


def _run(task: _Refresh | _Again | HeldOutTask) -> Correction | Fit | HeldOut:
    if isinstance(task, HeldOutTask):
        return predict_held_out(task)
    if isinstance(task, _Refresh):
        return correction(task.working, task.finer, task.at, _silent)
    best = task.fit.best
    start = task.objective.compare(best.prediction, best.values, best.free)
    return fit(task.objective, best.values, best.free, POLISH, _silent, start=start)


def _silent(line: str) -> None:
    """These jobs run side by side: their lines would interleave."""


def _held_out_tasks(
    final: Objective,
    current: Objective,
    baseline: Fit,
    here: Fit,
    cycles: IntArray,
    settings: Settings,
) -> list[HeldOutTask]:
    """The held-out cycle before and after, both with the covariance of the end."""
    if settings.held_out is None:
        return []
    boundary, rows = final.model.boundary, final.model.image_row
    weights = boundary.weights[rows]
    n_knots = weights.shape[1]
    every = (*elongation_names(n_knots), *tilt_names(n_knots))
    names: Sequence[str] = [name for name in every if name in baseline.best.free]
    knots = knots_of_cycle(cycles, weights, settings.held_out, names)
    fits = [(final, baseline)]
    if here is not baseline:
        fits.append((current, here))
    return [HeldOutTask(o, f, settings.held_out, cycles, knots) for o, f in fits]
