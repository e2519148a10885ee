"""First-order scores at a fit of the specimen in closed form, and looks from afar at them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from driver.diagnosis.search.finite_step_score import FiniteStepScores, finite_step_scores
from driver.diagnosis.search.refit import Executor
from driver.diagnosis.statistics.score_test import Score, effects_of
from driver.diagnosis.statistics.screening import screen, screened
from driver.forward.model import ForwardModel
from driver.identification.fit import Fit
from driver.identification.objective import Objective
from tools import closed_form
from tools.closed_form import ClosedFormSolver
from tools.closed_form_diagnosis import SETTINGS, identified


@dataclass(frozen=True, eq=False)
class Examined:
    """First-order scores of causes of the law at a fit."""

    scores: list[Score]
    fit: Fit
    objective: Objective


def scored(
    hidden: dict[str, float],
    wanted: Sequence[str],
    solver: type[ClosedFormSolver] = ClosedFormSolver,
    seed: int = 0,
) -> Examined:
    """A fit to data in which something is hidden, and the scores of some causes."""
    problem = closed_form.problem()
    objective = closed_form.objective(problem, problem.truth | hidden, seed)
    objective, fitted = identified(problem, objective)
    objective = replace(objective, model=replace(objective.model, adapter=solver()))
    return first_order(fitted, objective, wanted)


def first_order(fitted: Fit, objective: Objective, wanted: Sequence[str]) -> Examined:
    """The scores of some causes at a fit."""
    candidates, names = screened(objective.model, fitted.best.free, wanted)
    augmented = objective.evaluate(fitted.values, names)
    effects = effects_of(candidates, augmented, objective.parameters)
    scores, _ = screen(fitted, objective, candidates, effects, SETTINGS.sizes)
    return Examined(scores, fitted, objective)


def look(at: Examined, accepted: bool = True) -> FiniteStepScores:
    return finite_step_scores(
        at.scores, at.fit, at.objective, finer_of(at), 1.0, accepted, Executor(1, 1)
    )


def finer_of(at: Examined) -> ForwardModel:
    solver = at.objective.model.adapter
    assert isinstance(solver, ClosedFormSolver)
    return replace(at.objective.model, adapter=type(solver)(0.001))


def with_scores(at: Examined, *changed: Score) -> Examined:
    """The same with other scores of some causes, best log evidence first."""
    by_name = {s.cause.name: s for s in (*at.scores, *changed)}
    return replace(at, scores=sorted(by_name.values(), key=lambda s: -s.log_evidence))


def score_of(scores: list[Score], name: str) -> Score:
    return next(s for s in scores if s.cause.name == name)
