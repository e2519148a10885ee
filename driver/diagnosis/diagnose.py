"""The diagnosis from a fitted baseline: screen, refit, name, extend, test, measure the gain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from driver.boundary import elongation_names, tilt_names
from driver.diagnosis.boundary_noise import (
    Stops,
    level_again,
    refit_boundary_noise,
    score_boundary_noise,
    stops_where_they_pay,
)
from driver.diagnosis.causes import (
    BOUNDARY_NOISE,
    COVARIANCE,
    EVERY,
    NOISE_NOT_UNIFORM,
    NOISE_RATIO,
    NUMERICS,
    SIGMA_E,
    Cause,
    NotExamined,
    not_examined,
)
from driver.diagnosis.held_out import HeldOut, HeldOutTask, knots_of_cycle, predict_held_out
from driver.diagnosis.image_noise import (
    Unevenness,
    examine_noise,
    reweigh,
    with_uneven_noise,
)
from driver.diagnosis.omnibus import FAMILY_LEVEL, Omnibus, omnibus
from driver.diagnosis.refit import Refit, log_bayes_factor, refit_causes
from driver.diagnosis.score import Score, cosine
from driver.diagnosis.screening import (
    honoured,
    parameters_of_the_specimen,
    screen,
    screened,
    whitened_difference,
)
from driver.diagnosis.verdict import MOST_ADDITIONS, Verdict, decide
from driver.identification.fit import Correction, Evaluation, Fit, Objective, fit
from driver.identification.procedure import correction, temporal_noise, with_correction
from driver.model import ForwardModel
from driver.side_by_side import side_by_side

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Log = Callable[[str], None]

WITHIN = 3.0  # log evidence within which causes are not told apart
PARALLEL = 0.95  # cosine beyond which they cannot be
IMAGING = 1.2  # χ of free correlation beyond which imaging errors dominate
MOST_STEPS = 5  # rounds, where elimination keeps taking back what was added
POLISH = 8  # Newton iterations of an extended model with its own correction
GATE = 1.0  # largest effect of the change of the correction on a score [σ]


@dataclass(frozen=True, eq=False)
class Step:
    """One round of screening, and the cause that it added (or None).

    Attributes:
        scores: every cause that was tried, best log evidence first.
        refits: the nonlinear refits, best first.
        named: the cause that was added and those that cannot be told from it, or empty.
        omnibus: tests of the baseline of this round.
        chi_load, chi_image: of that baseline.
    """

    scores: tuple[Score, ...]
    refits: tuple[Refit, ...]
    named: tuple[str, ...]
    omnibus: Omnibus
    chi_load: float
    chi_image: float


@dataclass(frozen=True, eq=False)
class Gate:
    """Change of the finer-minus-working difference from where it was taken to the result.

    Attributes:
        effect: largest effect on the score of any cause [σ].
        cause: the cause whose score it would change most.
    """

    effect: float
    cause: str

    @property
    def passed(self) -> bool:
        """Whether no score could have been moved by more than one σ."""
        return self.effect <= GATE


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """All that was found.

    Attributes:
        baseline: the fit that was examined.
        extended: the fit with the causes that were added (the baseline where there are none).
        objective: the objective of the extended fit.
        steps: the rounds.
        causes: the causes that were added.
        gate: the test of the simulation's own error.
        held_out: score of the held-out cycle before and after, None where none is held out.
        explained: share of the excess misfit that the extension explains (NaN where the
            excess is within the scatter of noise).
        log_evidence: log Bayes factor of the extended model against the baseline.
        not_examined: the causes that were not tried, and why.
        verdict: the answer.
        levels: of each covariance cause that was added its level and the standard deviation of
            it, by the name of its parameter.
    """

    baseline: Fit
    extended: Fit
    objective: Objective
    steps: tuple[Step, ...]
    causes: tuple[Cause, ...]
    gate: Gate
    held_out: tuple[HeldOut, HeldOut] | None
    explained: float
    log_evidence: float
    not_examined: tuple[NotExamined, ...]
    verdict: Verdict
    levels: Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Settings:
    """How a diagnosis is run.

    Attributes:
        wanted: names of the causes to try, None for all.
        refit: how many causes are refitted in a round.
        held_out: number of the cycle to hold out, None for none.
        processes: processes side by side.
        threads: threads of each.
        free_chi: χ of free correlation.
        sizes: element sizes of the working and of the finer mesh [µm].
    """

    wanted: tuple[str, ...] | None
    refit: int
    held_out: int | None
    processes: int
    threads: int
    free_chi: float
    sizes: tuple[float, float]


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
        parameters_of_the_specimen(model), honoured(model), baseline.best.free, settings.wanted
    )
    limited = settings.free_chi > IMAGING
    if limited:
        objective = _inflated(objective, settings.free_chi)
        baseline, wide = fit(objective, baseline.values, baseline.best.free, 5, log), None
    levels: dict[str, tuple[float, float]] = {}
    uneven = examine_noise(baseline.best, objective.data, settings.wanted)
    if isinstance(uneven, NotExamined):
        left += (uneven,)
    elif uneven is not None and uneven.named:
        log(f"the noise of the images is uneven, by a factor of {uneven.ratio:.2f}: re-weighted")
        baseline, objective = reweigh(baseline, objective, uneven, settings.sizes, log)
        levels[NOISE_RATIO.name], wide = (uneven.ratio, uneven.sigma), None
    stops = stops_where_they_pay(baseline.best, objective, settings.wanted)
    left += () if stops.why is None else (stops.why,)
    for one in left:
        log(f"  {one.cause} is not examined: {one.why}")
    here = baseline
    gained = 0.0  # by covariance causes, whose evidence a common covariance does not show
    steps: list[Step] = []
    causes: list[Cause] = []
    current = objective
    accepted = False
    while True:
        log(f"screening at χ_F {here.best.chi_load:.2f}, χ of images {here.best.chi_image:.3f}")
        step, winner = _round(here, current, causes, settings, stops, wide, log)
        wide = None
        steps.append(step)
        accepted = step.omnibus.accepted
        if winner is None or len(causes) == MOST_ADDITIONS or len(steps) > MOST_STEPS:
            break
        causes.append(winner.cause)
        log(f"added {winner.cause.name}, log evidence {winner.log_evidence:+.1f}")
        log("finer mesh and steps at the extended model")
        change = correction(model, finer, winner.fit, log)
        noise = winner.objective.data.image.noise_factor * temporal_noise(
            winner.fit, winner.objective.data
        )
        if limited:
            noise = max(noise, settings.free_chi)
        current = with_correction(winner.objective, noise, change, settings.sizes)
        here = fit(current, winner.fit.values, winner.fit.best.free, POLISH, log)
        levels |= winner.levels
        gained += winner.log_evidence if winner.levels else 0.0
        if BOUNDARY_NOISE in causes[:-1] and stops.effect is not None:
            here, current, again = level_again(here, current, stops.effect, POLISH, log)
            levels = {n: level for n, level in levels.items() if n != SIGMA_E.name} | again
            if not again:
                causes, gained = [c for c in causes if c is not BOUNDARY_NOISE], 0.0
        here, current, causes = _eliminate(here, current, causes, log)
    if isinstance(uneven, Unevenness):
        scores = sorted((*steps[0].scores, uneven.score), key=lambda s: -s.log_evidence)
        steps[0] = replace(steps[0], scores=tuple(scores))
    tasks: list[_Refresh | HeldOutTask] = [_Refresh(model, finer, here)]
    tasks += _held_out_tasks(objective, current, baseline, here, cycles, settings)
    log("the correction once more, and the held-out cycle predicted from the others")
    ends = side_by_side(_run, tasks, settings.processes, settings.threads)
    fresh = next(end for end in ends if isinstance(end, Correction))
    held = [end for end in ends if isinstance(end, HeldOut)]
    fitted = [n for c in causes for n in c.parameters if c not in COVARIANCE]
    gate = _gate(current, here.best, fresh, steps[-1].scores, fitted)
    log(f"  change of the simulation's own error: {gate.effect:.2f} σ along {gate.cause}")
    numerics = None
    if not gate.passed:
        numerics = (
            f"close to the result its own error still changes by {gate.effect:.1f} σ "
            f"along {gate.cause}; a mesh and time steps half as large are needed"
        )
    # Before and after are compared under one covariance, that of the end.
    before = replace(objective, data=current.data).compare(
        baseline.best.prediction, baseline.values, baseline.best.free
    )
    # The excess is that of before a noise was counted.
    data = replace(current.data, jitter=objective.data.jitter)
    bare = replace(objective, data=data).compare(
        baseline.best.prediction, baseline.values, baseline.best.free
    )
    added = [n for c in causes for n in (*c.parameters, *c.companions) if c not in COVARIANCE]
    groups = [step.named for step in steps if step.named and step.named[0] in _names(causes)]
    verdict = decide(
        groups, accepted, limited, numerics,
        {cause.name: cause.sentence for cause in EVERY},
        {cause.name: cause.check for cause in EVERY},
    )  # fmt: skip
    if NOISE_RATIO.name in levels:
        verdict = with_uneven_noise(verdict)
        causes = [NOISE_NOT_UNIFORM, *causes]
    return Diagnosis(
        baseline=baseline,
        extended=here,
        objective=current,
        steps=tuple(steps),
        causes=tuple(causes),
        gate=gate,
        held_out=(held[0], held[-1]) if held else None,
        explained=_explained(bare, here.best) if groups else float("nan"),
        log_evidence=gained + log_bayes_factor(before, here.best, current, added),
        not_examined=left,
        verdict=verdict,
        levels=levels,
    )


def _names(causes: Sequence[Cause]) -> tuple[str, ...]:
    return tuple(cause.name for cause in causes)


def _inflated(objective: Objective, chi: float) -> Objective:
    image = objective.data.image
    louder = replace(image, noise_factor=max(image.noise_factor, chi))
    return replace(objective, data=replace(objective.data, image=louder))


def _round(
    here: Fit,
    objective: Objective,
    added: Sequence[Cause],
    settings: Settings,
    stops: Stops,
    wide: Evaluation | None,
    log: Log,
) -> tuple[Step, Refit | None]:
    """Screen all causes, refit the best, and pick the one to add."""
    candidates, names = screened(objective.model, here.best.free, settings.wanted)
    screening = wide if wide is not None else objective.evaluate(here.values, names)
    scores = screen(here, objective, candidates, screening)
    if stops.effect is not None and objective.data.jitter is None:
        family = len(scores) + 1
        scores.append(score_boundary_noise(stops.effect, here.best, objective, family))
        scores.sort(key=lambda s: -s.log_evidence)
    tests = omnibus(here.best, objective.data)
    significant = [s for s in scores if s.p < FAMILY_LEVEL and s.cause.name != NUMERICS.name]
    chosen = significant[: settings.refit]
    for s in scores[:5]:
        log(f"  {s.cause.name}: log evidence {s.log_evidence:+.1f}, p {s.p:.2g}")
    refits: list[Refit] = []
    if chosen and len(added) < MOST_ADDITIONS:
        log(f"refitting {', '.join(s.cause.name for s in chosen)}")
        material = [s for s in chosen if s.cause not in COVARIANCE]
        refits = refit_causes(
            material, screening, here.best, objective, settings.processes, settings.threads, log
        )
        if len(material) < len(chosen) and stops.effect is not None:
            refits.append(refit_boundary_noise(stops.effect, here.best, objective, log))
        refits.sort(key=lambda r: -r.log_evidence)
    winner = refits[0] if refits and refits[0].log_evidence > 0 else None
    named: tuple[str, ...] = ()
    if winner is not None:
        named = _set_of(winner, refits, scores)
    step = Step(tuple(scores), tuple(refits), named, tests, here.best.chi_load, here.best.chi_image)
    return step, winner


def _set_of(winner: Refit, refits: Sequence[Refit], scores: Sequence[Score]) -> tuple[str, ...]:
    """The winner, and the causes that cannot be told from it, best first.

    A refitted cause belongs to it by its evidence; or, if its linearised effect is parallel, by a
    misfit that is as low (then only the priors differ). Of causes that were not refitted the
    angle alone is known.
    """
    by_name = {s.cause.name: s for s in scores}
    best = by_name[winner.cause.name]
    names = [winner.cause.name]
    for other in refits[1:]:
        close = winner.log_evidence - other.log_evidence < WITHIN
        as_low = other.fit.best.misfit - winner.fit.best.misfit < 2 * WITHIN
        parallel = cosine(best, by_name[other.cause.name]) > PARALLEL
        if close or (parallel and as_low):
            names.append(other.cause.name)
    refitted = {r.cause.name for r in refits}
    names += [
        s.cause.name
        for s in scores
        if s.cause.name not in refitted
        and s.cause.name != NUMERICS.name
        and s.degrees == best.degrees
        and cosine(best, s) > PARALLEL
    ]
    return tuple(names)


def _eliminate(
    here: Fit, objective: Objective, causes: list[Cause], log: Log
) -> tuple[Fit, Objective, list[Cause]]:
    """Drop an earlier cause that the later ones have made superfluous (Wald test)."""
    null = objective.model.null_values()
    for cause in causes[:-1]:
        if cause in COVARIANCE:
            continue
        rows = [here.best.free.index(name) for name in cause.parameters]
        theta = np.array(
            [objective.parameters[n].theta(here.values[n], null[n]) for n in cause.parameters]
        )
        covariance = here.covariance[np.ix_(rows, rows)]
        statistic = float(theta @ np.linalg.solve(covariance, theta))
        if chi2.sf(statistic, len(rows)) < FAMILY_LEVEL:
            continue
        log(f"{cause.name} is not needed any more")
        freed = (*cause.parameters, *cause.companions)
        free = tuple(name for name in here.best.free if name not in freed)
        back = {name: null[name] for name in freed}
        prior = {name: p for name, p in objective.prior.items() if name not in freed}
        objective = replace(objective, prior=prior)
        here = fit(objective, here.values | back, free, 5, log)
        causes = [c for c in causes if c is not cause]
    return here, objective, causes


def _explained(before: Evaluation, after: Evaluation) -> float:
    """Share of the misfit above its expectation that is gone; NaN if it was within the noise."""
    scatter = np.sqrt(2.0 * before.residual.size)
    return 1.0 - after.excess / before.excess if before.excess > 3 * scatter else float("nan")


@dataclass(frozen=True, eq=False)
class _Refresh:
    """A correction to be taken at a fit."""

    working: ForwardModel
    finer: ForwardModel
    at: Fit


def _run(task: _Refresh | HeldOutTask) -> Correction | HeldOut:
    if isinstance(task, HeldOutTask):
        return predict_held_out(task)
    return correction(task.working, task.finer, task.at, lambda line: None)


def _held_out_tasks(
    objective: Objective,
    current: Objective,
    baseline: Fit,
    here: Fit,
    cycles: IntArray,
    settings: Settings,
) -> list[HeldOutTask]:
    """The held-out cycle before and after, both with the covariance of the end."""
    if settings.held_out is None:
        return []
    model = objective.model
    weights = model.boundary.weights[model.image_row]
    n_knots = weights.shape[1]
    every = (*elongation_names(n_knots), *tilt_names(n_knots))
    names = [name for name in every if name in baseline.best.free]
    knots = knots_of_cycle(cycles, weights, settings.held_out, names)
    fits = [(replace(objective, data=current.data), baseline)]
    if here is not baseline:
        fits.append((current, here))
    return [HeldOutTask(o, f, settings.held_out, cycles, knots) for o, f in fits]


def _gate(
    objective: Objective,
    at: Evaluation,
    fresh: Correction,
    scores: Sequence[Score],
    named: Sequence[str],
) -> Gate:
    """Effect of a fresh correction on the score of any cause, and on the parameters named."""
    change = whitened_difference(objective, at, fresh, objective.correction)
    effects = [
        (float(np.linalg.norm(s.directions @ change) / np.sqrt(s.degrees)), s.cause.name)
        for s in scores
        if s.degrees and s.cause.name != NUMERICS.name
    ]
    # What was named already is fitted: there the change moves the parameter itself.
    shift = np.linalg.solve(at.hessian, at.jacobian @ change)
    moved = np.abs(shift) / np.sqrt(np.diag(np.linalg.inv(at.hessian)))
    effects += [(float(moved[at.free.index(name)]), name) for name in named]
    effect, cause = max(effects, default=(0.0, NUMERICS.name))
    return Gate(effect, cause)
