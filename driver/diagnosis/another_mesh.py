"""A finding has to be there on another mesh as well.

A mesh errs in its own way, mostly where crystals yield, and so do many causes: on a coarse mesh
and with many images the error of the finer simulation may look like one of them. On another mesh
of about that size it is another one, and the mean of both corrections is the better one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from driver.diagnosis.gate import GATE, Gate
from driver.diagnosis.score import NAMING_LEVEL, Score, significance
from driver.diagnosis.screening import whitened_difference
from driver.identification.fit import Fit
from driver.identification.objective import Objective
from driver.identification.procedure import correction
from driver.model import ForwardModel

SURE = 20.0
"""Log evidence of a score that no mesh takes away: almost 7 σ."""


def lost_on(
    another: Callable[[], ForwardModel],
    here: Fit,
    objective: Objective,
    scores: Sequence[Score],
    widened: float,
    log: Callable[[str], None],
) -> Gate | None:
    """The change that takes every significant score away, None where one of them stays.

    It stays if it is significant with the mean of both corrections, or if the other mesh moves it
    by less than the gate allows.

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
    if not seen or max(s.log_evidence for s in seen) > SURE:
        return None
    log("the finer simulation once more, on another mesh")
    change = correction(objective.model, another(), here, log)
    difference = whitened_difference(objective, change, objective.correction)
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
            return None
    return Gate(effects[0], seen[0].cause.name, "mesh", between_meshes=True)
