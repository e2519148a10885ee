"""The discretisation check: could the simulation's own error be taken for a cause?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.common.progress import quiet
from driver.diagnosis.answer.result_types import DiscretisationCheck, Refinement
from driver.diagnosis.causes.causes import NUMERICS, Cause
from driver.diagnosis.statistics.correction_change import whitened_difference
from driver.diagnosis.statistics.score_test import NAMING_LEVEL, Score
from driver.forward.model import ForwardModel
from driver.identification.correction import Correction, correction
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter

_MATTERS = 0.5  # of the larger of two effects, from which the smaller one counts, too


@dataclass(frozen=True, eq=False)
class _Direction:
    """Rows that turn a whitened change into its effect on the score of a cause [σ].

    Attributes:
        along: the cause, or a parameter that was added.
        rows: shape (k, n).
    """

    along: Cause | Parameter
    rows: FloatArray

    def effect(self, change: FloatArray) -> float:
        """Root mean square over the degrees of freedom of the cause [σ]."""
        return float(np.linalg.norm(self.rows @ change) / np.sqrt(len(self.rows)))


def discretisation_check(
    objective: Objective,
    here: Fit,
    fresh: Correction,
    scores: Sequence[Score],
    named: Sequence[str],
) -> DiscretisationCheck:
    """Effect of a fresh correction on the score of any cause, and on the parameters named.

    What has to be refined where it is too large takes a simulation (`with_what_is_needed`).

    Args:
        objective: of the fit, with the correction that it was made with.
        here: the fit.
        fresh: finer minus working prediction at the fit.
        scores: of the causes that were tried last.
        named: the parameters that were added.
    """
    change = whitened_difference(objective, fresh, objective.correction.at(here.values))
    directions = _directions(here.best, scores, [objective.parameters[name] for name in named])
    effects = [direction.effect(change) for direction in directions]
    if not effects:
        return DiscretisationCheck(0.0, NUMERICS)
    worst = int(np.argmax(effects))
    return DiscretisationCheck(effects[worst], directions[worst].along)


def with_what_is_needed(
    check: DiscretisationCheck,
    objective: Objective,
    here: Fit,
    fresh: Correction,
    finer: ForwardModel,
    scores: Sequence[Score],
    named: Sequence[str],
) -> DiscretisationCheck:
    """Return a check that was not passed with whether mesh or steps have to be refined.

    One more simulation, with the steps of the finer model on the working mesh, tells the error of
    the steps from that of the mesh.

    Args:
        check: the check.
        objective: of the fit.
        here: the fit.
        fresh: finer minus working prediction at the fit.
        finer: the finer model.
        scores: of the causes that were tried last.
        named: the parameters that were added.

    Raises:
        SolverError: the simulation could not be finished.
    """
    directions = _directions(here.best, scores, [objective.parameters[name] for name in named])
    along = next(direction for direction in directions if direction.along == check.along)
    return replace(check, needed=_refinement(objective, here, fresh, finer, along))


def missing(scores: Sequence[Score]) -> Score | None:
    """Return the score of the discretisation where the data show more of the correction, or less.

    Args:
        scores: of the causes that were tried last.
    """
    return next((s for s in scores if s.cause == NUMERICS and s.p < NAMING_LEVEL), None)


def needed_for(
    seen: Score, objective: Objective, here: Fit, fresh: Correction, finer: ForwardModel
) -> Refinement:
    """Return what has to be refined where the data show the discretisation.

    Args:
        seen: its score.
        objective: of the fit.
        here: the fit.
        fresh: finer minus working prediction at the fit.
        finer: the finer model.

    Raises:
        SolverError: the simulation that tells it could not be finished.
    """
    return _refinement(objective, here, fresh, finer, _Direction(seen.cause, seen.directions))


def _directions(
    at: Evaluation, scores: Sequence[Score], named: Sequence[Parameter]
) -> list[_Direction]:
    directions = [
        _Direction(s.cause, s.directions)
        for s in scores
        if s.directions.size and s.cause != NUMERICS
    ]
    # What was named already is fitted: there the change moves the parameter itself.
    covariance = np.linalg.inv(at.hessian)
    for parameter in named:
        row = at.free.index(parameter.name)
        moved = covariance[row] @ at.jacobian / np.sqrt(covariance[row, row])
        directions.append(_Direction(parameter, moved[None]))
    return directions


def _refinement(
    objective: Objective, here: Fit, fresh: Correction, finer: ForwardModel, along: _Direction
) -> Refinement:
    """Whether mesh or steps make the difference between the working and the finer simulation."""
    model = objective.model
    between = replace(model, adapter=finer.adapter).in_steps_of(finer)
    with quiet():
        halved = correction(model, between, here.best.prediction, here.values)
    of_steps = along.effect(whitened_difference(objective, halved, Correction()))
    of_mesh = along.effect(whitened_difference(objective, fresh, halved))
    if of_steps < _MATTERS * of_mesh:
        return "mesh"
    if of_mesh < _MATTERS * of_steps:
        return "steps"
    return "mesh and steps"
