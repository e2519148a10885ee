"""A finding has to be there on another mesh as well.

A mesh errs in its own way, mostly where crystals yield, and so do many causes: on a coarse mesh
and with many images the error of the finer simulation may look like one of them. On another mesh
of about that size it is another one: the mean of both corrections is the better one, and half of
what they differ by is what each may be off.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.diagnosis.gate import GATE, Gate
from driver.diagnosis.score import NAMING_LEVEL, Score, significance
from driver.diagnosis.screening import whitened_difference
from driver.identification.fit import Fit, fit
from driver.identification.objective import Correction, Objective
from driver.identification.procedure import correction
from driver.model import ForwardModel

MOST_ITERATIONS = 8


@dataclass(frozen=True, eq=False)
class OnBoth:
    """What two finer meshes say.

    Attributes:
        lost: the change that takes every significant score away, None where one of them stays.
        spread: half of what the other one adds, None where there was no need of it.
    """

    lost: Gate | None
    spread: Correction | None


def on_another_mesh(
    another: Callable[[], ForwardModel],
    here: Fit,
    objective: Objective,
    scores: Sequence[Score],
    widened: float,
    log: Callable[[str], None],
) -> OnBoth:
    """Hold what is significant against another mesh.

    A score stays if it is significant with the mean of both corrections, or if the other mesh
    moves it by less than the gate allows.

    Args:
        another: makes the finer model on another mesh.
        here: the fit.
        objective: its objective, with the correction by the finer model.
        scores: of all causes at the fit.
        widened: by how much the simulation's own error widens them.
        log: takes one line of progress.

    Raises:
        SolverError: the simulation could not be finished.
    """
    seen = [s for s in scores if s.p < NAMING_LEVEL and s.directions.size]
    if not seen or objective.spread is not None:
        return OnBoth(None, None)
    change = spread(objective.model, another(), here, objective.correction, log)
    twice = Correction(2.0 * np.asarray(change.motion), 2.0 * np.asarray(change.load))
    difference = whitened_difference(objective, twice, Correction())
    effects = []
    for one in seen:
        moved = one.directions @ difference / widened
        p = significance(
            one.cause, one.components - 0.5 * moved, one.directions, here.best, len(scores),
            objective.data.load_degrees,
        )  # fmt: skip
        effects.append(float(np.linalg.norm(moved) / np.sqrt(moved.size)))
        log(f"  {one.cause.name}: moved by {effects[-1]:.1f} σ, p {one.p:.2g} → {p:.2g}")
        if p < NAMING_LEVEL or effects[-1] <= GATE:
            return OnBoth(None, change)
    return OnBoth(Gate(effects[0], seen[0].cause.name, "mesh", between_meshes=True), change)


def spread(
    working: ForwardModel,
    another: ForwardModel,
    here: Fit,
    known: Correction,
    log: Callable[[str], None],
) -> Correction:
    """Half of what the correction by another finer model has more than the one that is known.

    Args:
        working: the working model.
        another: the finer model on another mesh.
        here: the fit at which both are taken.
        known: the correction by the one finer model.
        log: takes one line of progress.

    Raises:
        SolverError: the simulation could not be finished.
    """
    log("the finer simulation once more, on another mesh")
    change = correction(working, another, here, log)
    return Correction(
        0.5 * (np.asarray(change.motion) - known.motion),
        0.5 * (np.asarray(change.load) - known.load),
    )


def with_both(
    objective: Objective, here: Fit, spread: Correction, log: Callable[[str], None]
) -> tuple[Objective, Fit]:
    """The objective with the mean of both corrections, fitted.

    Args:
        objective: with the correction by the finer model.
        here: its fit.
        spread: half of what the other mesh adds.
        log: takes a line for each iteration.
    """
    both = replace(objective, correction=objective.correction.towards(spread), spread=spread)
    start = both.compare(here.best.prediction, here.values, here.best.free)
    return both, fit(both, here.values, here.best.free, MOST_ITERATIONS, log, start=start)
