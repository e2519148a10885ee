"""A finding has to be there on a second finer mesh as well.

A mesh errs in its own way, mostly where crystals yield, and so do many causes: on a coarse mesh
and with many images the error of the finer simulation may look like one of them.

Of hexahedra the second mesh has smaller cells of the same family, and errs less than the first by
a known factor: it takes the place of the first. Of tetrahedra both are as good as each other: the
mean of both corrections is the better one, and half of what they differ by is what it may be off. A
little of it makes what is visible larger; where it is more than that the simulation is not exact
enough to judge.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from driver.diagnosis.answer.result_types import DiscretisationCheck
from driver.diagnosis.causes.causes import NUMERICS
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.refit import Executor
from driver.diagnosis.statistics.correction_change import whitened_difference
from driver.diagnosis.statistics.score_test import NAMING_LEVEL, Score, significance
from driver.identification.correction import Correction, SecondMesh
from driver.identification.fit import POLISH, Fit, fit_from
from driver.identification.identify import with_correction
from driver.identification.objective import Objective

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class OnBoth:
    """What two finer meshes say.

    Attributes:
        lost: the change by which the mean of both takes every significant score away, passed where
            the meshes are close enough for their mean to judge; None where one of them stays, and
            where the second mesh is the better one.
        first: the correction by the first finer mesh, to be taken at the fit.
        second: what the other one says beside it.
    """

    lost: DiscretisationCheck | None
    first: Correction
    second: SecondMesh


def held_against_both(
    finer: FineModels,
    here: Fit,
    objective: Objective,
    scores: Sequence[Score],
    accepted: bool,
    widened: float,
    executor: Executor,
) -> OnBoth | None:
    """Hold what is significant against a second mesh.

    A better mesh judges by itself, of what the tests reject without a cause as well.

    Args:
        finer: the finer models.
        here: the fit.
        objective: its objective, with the correction by the finer model.
        scores: of all causes at the fit.
        accepted: whether the tests against no particular cause accept the residual.
        widened: by how much the simulation's own error widens them.
        executor: who simulates.

    Returns:
        None where there is nothing to hold against it, the objective has both meshes already, or
        there is no other one.

    Raises:
        SolverError: the finer simulation could not be finished.
    """
    seen = [s for s in scores if s.p < NAMING_LEVEL and s.directions.size and s.cause != NUMERICS]
    asked = bool(seen) or (finer.size is not None and not accepted)
    if not asked or objective.second is not None or finer.make_second is None:
        return None
    first, second = _corrections(finer, here, objective, executor)
    if second is None:
        return None
    taken = objective.correction.at(here.values)
    both = whitened_difference(objective, first.at(here.values).with_second(second), taken)
    apart = whitened_difference(objective, second.difference, Correction())
    effects = []
    for scored in seen:
        p = significance(
            scored.cause, scored.components - scored.directions @ both / widened,
            scored.directions, here.best,
            scored.family, objective.data.load_degrees,
        )  # fmt: skip
        moved = scored.directions @ apart / widened
        effects.append(float(np.linalg.norm(moved)))
        logger.info(
            f"  {scored.cause.name}: moved by {effects[-1]:.1f} σ, p {scored.p:.2g} → {p:.2g}"
        )
        if p < NAMING_LEVEL:
            return OnBoth(None, first, second)
    if second.is_better:
        return OnBoth(None, first, second)
    worst = int(np.argmax(effects))
    lost = DiscretisationCheck(effects[worst], seen[worst].cause, "mesh", between_meshes=True)
    return OnBoth(lost, first, second)


def _corrections(
    finer: FineModels, here: Fit, objective: Objective, executor: Executor
) -> tuple[Correction, SecondMesh | None]:
    """Return the correction by the finer mesh, and what the other one adds at the fit."""
    known = objective.correction
    if known.derivatives is None:
        logger.info("finer mesh and steps at this fit")
        return finer.corrections(objective, here, True, executor)
    # Its derivatives take it to the fit: no more than a polish has moved that since.
    return known, finer.second(objective, here)


def with_both(
    objective: Objective, here: Fit, both: OnBoth, sizes: tuple[float, float]
) -> tuple[Objective, Fit]:
    """Return the objective with what both meshes say together, fitted.

    Args:
        objective: with the correction by the first finer model.
        here: its fit.
        both: what two finer meshes say.
        sizes: element sizes of the working and of the first finer mesh [µm].

    Raises:
        SolverError: a simulation could not be finished.
    """
    first, noise = both.first.completed_by(objective.correction), objective.data.image.noise_factor
    objective = with_correction(objective, noise, first, sizes, both.second)
    return objective, fit_from(here.best, objective, POLISH)
