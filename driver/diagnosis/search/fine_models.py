"""The finer simulation behind the correction: on its own mesh, and on another one of that size."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.search.flip_trial import turned
from driver.forward.model import ForwardModel
from driver.identification.correction import Correction, correction
from driver.identification.fit import Fit
from driver.identification.objective import Objective

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class FineModels:
    """The finer models.

    Attributes:
        one: on the finer mesh of the case.
        another: makes it on another mesh; None for a simulation without a mesh.
    """

    one: ForwardModel
    another: Callable[[], ForwardModel] | None = None

    def turned(self, causes: Sequence[Cause]) -> FineModels:
        """Return the same with the orientations that the flips among these causes make."""
        another = None if self.another is None else partial(_turned, self.another, causes)
        return FineModels(turned(self.one, causes), another)

    def corrections(
        self, objective: Objective, here: Fit, both: bool
    ) -> tuple[Correction, Correction | None]:
        """Finer minus working prediction at a fit, and half of what the other mesh adds.

        Both are taken at the same parameters: what the difference changes by from fit to fit is no
        difference of the meshes. The latter is None where it was not asked for, or cannot be had.

        Args:
            objective: of the fit, with the correction that it was made with.
            here: the fit.
            both: whether the other mesh is asked for.

        Raises:
            SolverError: the finer simulation could not be finished, or was not run on the other
                mesh.
        """
        asked = [self._on_one, self._on_another] if both and self.another is not None else []
        # One after the other; jobs for another machine are prepared all at once.
        first, *others = side_by_side(
            lambda take: take(objective, here), asked or [self._on_one], 1
        )
        assert first is not None
        return first, _half(first, others[0] if others else None)

    def spread(self, objective: Objective, here: Fit) -> Correction | None:
        """Half of what the other mesh adds at a fit to the correction that an objective has.

        That correction follows its parameters by its derivatives. None where the other mesh cannot
        be had.

        Args:
            objective: of the fit, with the correction that it was made with.
            here: the fit.

        Raises:
            SolverError: the finer simulation was not run on the other mesh.
        """
        return _half(objective.correction.at(here.values), self._on_another(objective, here))

    def _on_one(self, objective: Objective, here: Fit) -> Correction:
        best = here.best
        return correction(
            objective.model, self.one, best.prediction, best.values, with_steps=True,
            free=best.free, near=objective.correction,
        )  # fmt: skip

    def _on_another(self, objective: Objective, here: Fit) -> Correction | None:
        another = self.another
        assert another is not None
        logger.info("the same on another mesh")
        change = attempt(
            lambda: correction(objective.model, another(), here.best.prediction, here.values)
        )
        if isinstance(change, Failure):
            logger.info(f"  one mesh has to do: {change.why}")
            return None
        return change


def _half(first: Correction, second: Correction | None) -> Correction | None:
    """Return half of what the second correction adds to the first."""
    if second is None:
        return None
    return Correction(
        0.5 * (np.asarray(second.motion) - first.motion),
        0.5 * (np.asarray(second.load) - first.load),
    )


def _turned(another: Callable[[], ForwardModel], causes: Sequence[Cause]) -> ForwardModel:
    return turned(another(), causes)
