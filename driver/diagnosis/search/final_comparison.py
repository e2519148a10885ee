"""When the rounds are over: the correction once more, the baseline again, and the held-out cycle.

None of them waits for another: they run side by side, but for a correction that is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from driver.common.parallel import side_by_side
from driver.common.progress import quiet
from driver.diagnosis.answer.result_types import HeldOut, Settings
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.noise_causes import BOUNDARY_NOISE
from driver.diagnosis.search.held_out import HeldOutTask, knots_of_cycle, predict_held_out
from driver.forward.model import ForwardModel
from driver.identification.correction import Correction, correction
from driver.identification.fit import POLISH, Fit, fit_from
from driver.identification.objective import Evaluation, Objective
from driver.parameters.boundary import elongation_names, tilt_names
from meshes.arrays import IntArray


@dataclass(frozen=True, eq=False)
class Final:
    """What was found at the end.

    Attributes:
        fresh: finer minus working prediction at the extended fit, as two meshes have it together
            where there were two.
        before: the baseline, fitted under the covariance of the end; the last fit itself where
            no cause is left.
        uncounted: the same without the noise of the boundary that was found: what that explains
            is an excess where it is not counted.
        held_out: score of the held-out cycle before and after, None where none is held out.
    """

    fresh: Correction
    before: Evaluation
    uncounted: Evaluation
    held_out: tuple[HeldOut, HeldOut] | None


def final_comparison(
    first: tuple[Fit, Objective],
    last: tuple[Fit, Objective],
    causes: Sequence[Cause],
    finer: ForwardModel,
    cycles: IntArray,
    settings: Settings,
    fresh: Correction | None = None,
) -> Final:
    """Make them.

    Before and after are compared under one covariance, that of the end; in the held-out cycle a
    noise of the boundary that was found counts afterwards alone.

    Args:
        first: the baseline, and its objective.
        last: the extended fit, and its objective.
        causes: the causes that were added.
        finer: the finer model, its orientations those of the extended fit.
        cycles: number of the cycle of each image, shape (T,).
        settings: how the diagnosis is run.
        fresh: the correction at the extended fit (`correction_at`), where it is known.

    Raises:
        SolverError: a simulation could not be finished.
    """
    (baseline, objective), (extended, current) = first, last
    second = current.second
    if objective.second is None:  # it was asked for in a later round
        objective = replace(objective, correction=objective.correction.with_second(second))
    counted = replace(objective, data=current.data)
    uncounted = replace(counted, data=replace(counted.data, jitter=objective.data.jitter))
    tasks: list[_Refresh | _Again | HeldOutTask] = []
    if fresh is None:
        tasks.append(_Refresh(current, finer, extended))
    if causes:
        tasks.append(_Again(counted, baseline))
    if BOUNDARY_NOISE in causes:
        tasks.append(_Again(uncounted, baseline))
    tasks += _held_out_tasks(uncounted, current, baseline, extended, cycles, settings)
    ends = side_by_side(_run, tasks, settings.processes, settings.threads)
    fits = [end.best for end in ends if isinstance(end, Fit)] or [extended.best]
    held = [end for end in ends if isinstance(end, HeldOut)]
    if fresh is None:
        fresh = next(end for end in ends if isinstance(end, Correction)).with_second(second)
    return Final(
        fresh=fresh,
        before=fits[0],
        uncounted=fits[-1],
        held_out=(held[0], held[-1]) if held else None,
    )


def correction_at(here: Fit, objective: Objective, finer: ForwardModel) -> Correction:
    """Return finer minus working prediction at a fit, as two meshes have it where there were two.

    Args:
        here: the fit.
        objective: its objective.
        finer: the finer model, its orientations those of the fit.

    Raises:
        SolverError: the simulation could not be finished.
    """
    change = _run(_Refresh(objective, finer, here))
    assert isinstance(change, Correction)
    return change.with_second(objective.second)


@dataclass(frozen=True, eq=False)
class _Refresh:
    """A correction to be taken at a fit."""

    objective: Objective
    finer: ForwardModel
    at: Fit


@dataclass(frozen=True, eq=False)
class _Again:
    """A fit to be made again under another covariance."""

    objective: Objective
    fit: Fit


@quiet()
def _run(task: _Refresh | _Again | HeldOutTask) -> Correction | Fit | HeldOut:
    if isinstance(task, HeldOutTask):
        return predict_held_out(task)
    if isinstance(task, _Refresh):
        objective, at = task.objective, task.at
        return correction(
            objective.model, task.finer, at.best.prediction, at.values, near=objective.correction
        )
    return fit_from(task.fit.best, task.objective, POLISH)


def _held_out_tasks(
    before: Objective,
    current: Objective,
    baseline: Fit,
    here: Fit,
    cycles: IntArray,
    settings: Settings,
) -> list[HeldOutTask]:
    """Return the held-out cycle before and after, with the noise of loads and images of the end."""
    if settings.held_out is None:
        return []
    boundary, rows = before.model.boundary, before.model.image_row
    weights = boundary.weights[rows]
    n_knots = weights.shape[1]
    every = (*elongation_names(n_knots), *tilt_names(n_knots))
    names: Sequence[str] = [name for name in every if name in baseline.best.free]
    knots = knots_of_cycle(cycles, weights, settings.held_out, names)
    fits = [(before, baseline)]
    if here is not baseline:
        fits.append((current, here))
    return [HeldOutTask(o, f, settings.held_out, cycles, knots) for o, f in fits]
