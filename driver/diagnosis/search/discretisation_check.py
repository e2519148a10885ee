"""The discretisation check: could the simulation's own error be taken for a cause, or be seen?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.common.outcomes import Failure, attempt
from driver.common.progress import quiet
from driver.diagnosis.answer.result_types import DiscretisationCheck, Refinement, Round
from driver.diagnosis.causes.causes import NUMERICS, Cause
from driver.diagnosis.statistics.correction_change import whitened_difference
from driver.diagnosis.statistics.score_test import NAMING_LEVEL, Score
from driver.forward.model import ForwardModel
from driver.identification.correction import Correction
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter

_SURE = 2.0  # standard deviations by which a share is known
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


def with_missing_share(
    check: DiscretisationCheck,
    last: Round,
    objective: Objective,
    here: Fit,
    fresh: Correction,
    finer: ForwardModel,
) -> DiscretisationCheck:
    """Return a check that was passed with the share of the correction that the data show beside it.

    A larger share than the whole is that of another effect, which resembles the correction by
    chance, and where the tests of the residual reject a finer simulation would be no remedy.

    Args:
        check: the check.
        last: the last round.
        objective: of the fit.
        here: the fit.
        fresh: finer minus working prediction at the fit.
        finer: the finer model.

    Raises:
        NotRunError: the simulation that tells what to refine was not run.
        JobError, ResultFileError: it was killed, ran out of time or left no result.
    """
    own = next((s for s in last.scores if s.cause == NUMERICS and s.p < NAMING_LEVEL), None)
    if own is None or not last.goodness_of_fit.accepted:
        return check
    share, sigma = float(own.estimate[0]), float(own.sigma[0])
    if abs(share) > 1.0 + _SURE * sigma:
        return check
    needed: Refinement | Failure | None = check.needed
    if needed is None:
        along = _Direction(own.cause, own.directions)
        needed = attempt(lambda: _refinement(objective, here, fresh, finer, along))
    # Of time steps that cannot be simulated on the working mesh nothing is known.
    return replace(
        check,
        missing=(share, sigma),
        needed="mesh" if isinstance(needed, Failure) else needed,
    )


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
    between = replace(objective.model, adapter=finer.adapter).in_steps_of(finer)
    with quiet():
        stepped, working = between.predict(here.values), here.best.prediction
    steps = Correction(stepped.motion - working.motion, stepped.load - working.load)
    of_steps = along.effect(whitened_difference(objective, steps, Correction()))
    of_mesh = along.effect(whitened_difference(objective, fresh, steps))
    if of_steps < _MATTERS * of_mesh:
        return "mesh"
    if of_mesh < _MATTERS * of_steps:
        return "steps"
    return "mesh and steps"
