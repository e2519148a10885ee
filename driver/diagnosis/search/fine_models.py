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
        self, working: ForwardModel, here: Fit, both: bool
    ) -> tuple[Correction, Correction | None]:
        """Finer minus working prediction at a fit, and half of what the other mesh adds.

        Both are taken at the same parameters: what the difference changes by from fit to fit is no
        difference of the meshes. The latter is None where it was not asked for, or cannot be had.

        Args:
            working: the working model.
            here: the fit.
            both: whether the other mesh is asked for.

        Raises:
            SolverError: the finer simulation could not be finished, or was not run on the other
                mesh.
        """

        def on_one() -> Correction | None:
            best = here.best
            return correction(
                working, self.one, best.prediction, best.values, with_steps=True, free=best.free
            )

        def on_another() -> Correction | None:
            another = self.another
            assert another is not None
            logger.info("the same on another mesh")
            another_change = attempt(
                lambda: correction(working, another(), here.best.prediction, here.values)
            )
            if isinstance(another_change, Failure):
                logger.info(f"  one mesh has to do: {another_change.why}")
                return None
            return another_change

        asked = [on_one, on_another] if both and self.another is not None else [on_one]
        # One after the other; jobs for another machine are prepared all at once.
        first, *others = side_by_side(lambda take: take(), asked, 1)
        assert first is not None
        second = others[0] if others else None
        if second is None:
            return first, None
        return first, Correction(
            0.5 * (np.asarray(second.motion) - first.motion),
            0.5 * (np.asarray(second.load) - first.load),
        )


def _turned(another: Callable[[], ForwardModel], causes: Sequence[Cause]) -> ForwardModel:
    return turned(another(), causes)
