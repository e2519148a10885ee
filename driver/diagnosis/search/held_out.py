"""Prediction of a cycle that was not fitted: does the extension hold where it was not trained?

Everything but the knots of the held-out cycle is fitted to the other cycles; then only those
knots are fitted to the held-out cycle, for no elongation is known to a fraction of a nanometre
without its loads. What is left of its loads and images is the score.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from driver.diagnosis.answer.result_types import HeldOut
from driver.identification.fit import Fit, fit
from driver.identification.objective import Objective
from meshes.arrays import IntArray

MOST_ITERATIONS = 5
TOLERANCE = 0.3


@dataclass(frozen=True, eq=False)
class HeldOutTask:
    """A model to be tried on a cycle.

    Attributes:
        objective: model, data and priors.
        fit: the fit to all cycles, from which the search starts.
        cycle: number of the held-out cycle.
        frames: number of the cycle of each frame, shape (T,).
        knots: names of the knots that move in that cycle alone.
    """

    objective: Objective
    fit: Fit
    cycle: int
    frames: IntArray
    knots: tuple[str, ...]


def trained_on_others(task: HeldOutTask) -> Fit:
    """Return the fit of all but the knots of the cycle to the other cycles.

    Raises:
        SolverError: a simulation could not be finished.
    """
    others = np.flatnonzero(task.frames != task.cycle)
    best = task.fit.best
    without = replace(task.objective, data=task.objective.data.frames(others))
    shared = tuple(name for name in best.free if name not in task.knots)
    return fit(
        without, best.values, shared, MOST_ITERATIONS, without.with_free(best, shared),
        TOLERANCE,
    )  # fmt: skip


def predict_held_out(task: HeldOutTask) -> HeldOut:
    """Fit without the cycle, then only its knots to it.

    Raises:
        SolverError: a simulation could not be finished.
    """
    inside = np.flatnonzero(task.frames == task.cycle)
    trained = trained_on_others(task)
    only = replace(task.objective, data=task.objective.data.frames(inside))
    begin = only.with_free(trained.best, task.knots)
    predicted = fit(only, trained.values, task.knots, MOST_ITERATIONS, begin, TOLERANCE).best
    loads = predicted.residual[: predicted.n_load]
    # The elongation knots are seen by the loads, the tilt knots by the images.
    fitted = sum(name.startswith("elongation") for name in task.knots)
    return HeldOut(
        task.cycle,
        float(np.sqrt(loads @ loads / max(loads.size - fitted, 1))),
        predicted.chi_image,
    )


def knots_of_cycle(
    frames: IntArray, weights: NDArray[np.float64], cycle: int, names: Sequence[str]
) -> tuple[str, ...]:
    """Knots that move images of this cycle and of no other.

    Args:
        frames: cycle of each image, shape (T,).
        weights: knot weights at the images, shape (T, n_knots).
        cycle: the cycle.
        names: names of the knots after the first, once per component.
    """
    n = weights.shape[1] - 1
    alone = [
        np.any(weights[frames == cycle, k] > 0) and not np.any(weights[frames != cycle, k] > 0)
        for k in range(1, n + 1)
    ]
    return tuple(name for index, name in enumerate(names) if alone[index % n])
