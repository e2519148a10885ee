"""The finer simulation behind the correction: on its own mesh, and on a second one."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.common.progress import collected_lines
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.search.flip_trial import turned
from driver.diagnosis.search.refit import Executor
from driver.forward.model import ForwardModel
from driver.identification.correction import Correction, SecondMesh, correction
from driver.identification.fit import Fit
from driver.identification.objective import Objective

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class FineModels:
    """The finer models.

    Attributes:
        one: on the finer mesh of the case.
        make_second: makes it on the second mesh; None for a simulation without a mesh.
        size: of the cells of that mesh, where they are the better ones [µm]; None where both
            meshes are as good as each other.
    """

    one: ForwardModel
    make_second: Callable[[], ForwardModel] | None = None
    size: float | None = None

    def turned(self, causes: Sequence[Cause]) -> FineModels:
        """Return the same with the orientations that the flips among these causes make."""
        make = self.make_second
        second = None if make is None else partial(_turned, make, causes)
        return replace(self, one=turned(self.one, causes), make_second=second)

    def corrections(
        self, objective: Objective, here: Fit, both: bool, executor: Executor
    ) -> tuple[Correction, SecondMesh | None]:
        """Finer minus working prediction at a fit, and what the second mesh adds.

        Both are taken at the same parameters: what the difference changes by from fit to fit is no
        difference of the meshes. The latter is None where it was not asked for, or cannot be had.

        Args:
            objective: of the fit, with the correction that it was made with.
            here: the fit.
            both: whether the second mesh is asked for.
            executor: who simulates.

        Raises:
            SolverError: the finer simulation could not be finished, or was not run on the second
                mesh.
        """
        make = self.make_second
        second = attempt(make) if both and make is not None else None
        tasks = [_Task(objective, here, self.one, True)]
        if isinstance(second, ForwardModel):
            tasks.append(_Task(objective, here, second, False))
        # Jobs for another machine are prepared all at once.
        first, *seconds = side_by_side(_taken, tasks, executor.processes, executor.threads)
        change = first.told()
        assert change is not None
        if second is None:
            return change, None
        logger.info(_AGAIN)
        taken = _Taken(second, []) if isinstance(second, Failure) else seconds[0]
        found = taken.told()
        return change, None if found is None else _beside(change, found, self.size)

    def second(self, objective: Objective, here: Fit) -> SecondMesh | None:
        """Return what the second mesh adds at a fit to the correction by the first one.

        That of the objective, which follows its parameters by its derivatives. None where the
        second mesh cannot be had.

        Args:
            objective: of the fit, with the correction that it was made with.
            here: the fit.

        Raises:
            SolverError: the finer simulation was not run on the second mesh.
        """
        if self.make_second is None:
            return None
        logger.info(_AGAIN)
        made = attempt(self.make_second)
        found = (
            made if isinstance(made, Failure) else added_by_second(made, self.size, objective, here)
        )
        if isinstance(found, Failure):
            logger.info(_told(found))
            return None
        return found


def added_by_second(
    second: ForwardModel, size: float | None, objective: Objective, here: Fit
) -> SecondMesh | Failure:
    """Return what the second mesh adds at a fit to the correction by the first one.

    That of the objective, which follows its parameters by its derivatives.

    Args:
        second: the model on the second mesh.
        size: of its cells, where they are the better ones [µm].
        objective: of the fit, with the correction that it was made with.
        here: the fit.

    Raises:
        SolverError: the finer simulation was not run on the second mesh.
    """
    at, values = here.best.prediction, here.values
    known = objective.correction
    first = known.without_second(objective.second).at(values)
    left = known.left_by_steps  # of which the difference of the meshes has no part
    found = attempt(lambda: correction(objective.model, second, at, values, left_by_steps=left))
    return found if isinstance(found, Failure) else _beside(first, found, size)


def _beside(first: Correction, found: Correction, size: float | None) -> SecondMesh:
    """Return what the second mesh says beside the first, by the corrections taken on both."""
    # Steps of first order change both alike.
    (motion, load), (first_motion, first_load) = found.of_mesh, first.of_mesh
    return SecondMesh(Correction(motion - first_motion, load - first_load), size)


def _told(failure: Failure) -> str:
    return f"  one mesh has to do: {failure.why}"


_AGAIN = "the same on a second mesh"


class _Task:
    """A correction to be taken.

    Args:
        objective: of the fit, with the correction that it was made with.
        here: the fit.
        finer: the finer model.
        first: whether it is on the finer mesh of the case, which has to be simulated, with
            derivatives.
    """

    def __init__(self, objective: Objective, here: Fit, finer: ForwardModel, first: bool) -> None:
        best = here.best
        self.first = first
        # The images stay where they are.
        self.take = partial(
            correction, objective.model, finer, best.prediction, here.values,
            free=best.free if first else (),
            near=Correction(course=objective.correction.course) if first else None,
            # What the difference of the meshes has no part of.
            left_by_steps=None if first else objective.correction.left_by_steps,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Taken:
    """What a process answers: a correction or why there is none, and what it told."""

    change: Correction | Failure
    lines: list[str]

    def told(self) -> Correction | None:
        """Return the correction, and pass on what was told; None where there is none."""
        for line in self.lines:
            logger.info(line)
        if isinstance(self.change, Failure):
            logger.info(_told(self.change))
            return None
        return self.change


def _taken(task: _Task) -> _Taken:
    with collected_lines() as lines:
        return _Taken(task.take() if task.first else attempt(task.take), lines)


def _turned(make: Callable[[], ForwardModel], causes: Sequence[Cause]) -> ForwardModel:
    return turned(make(), causes)
