"""Trials of flips that cannot be simulated; which flips are named is tested with `diagnose`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from driver.diagnosis.causes.ebsd_flips import FLIPS
from driver.diagnosis.search.flip_trial import try_flips
from driver.diagnosis.search.refit import Executor
from meshes.arrays import FloatArray
from solver_adapters.interface import NotRunError, Simulation, SolverError
from solver_adapters.jobs.errors import JobError
from solver_adapters.jobs.status import Status
from tools import closed_form
from tools.closed_form import ClosedFormSolver
from tools.closed_form_diagnosis import identified

BENCH = closed_form.problem()
GRAINS = BENCH.model.microstructure.orientations


class AsMeasured(ClosedFormSolver):
    """A solver that has an answer to the measured orientations alone."""

    def __init__(self, otherwise: Exception) -> None:
        super().__init__()
        self.otherwise = otherwise

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        if not np.allclose(simulation.orientations, GRAINS):
            raise self.otherwise
        return super().answer(simulation)


@pytest.mark.parametrize(
    "error",
    [
        NotRunError("absent"),
        JobError("bar", Status.KILLED),
        JobError("bar", Status.OUT_OF_TIME),
    ],
    ids=str,
)
def test_a_flip_that_was_not_run_ends_the_trial(error: SolverError) -> None:
    objective, baseline = identified(BENCH, closed_form.objective(BENCH, BENCH.truth))
    there = replace(objective, model=replace(objective.model, adapter=AsMeasured(error)))
    with pytest.raises(type(error)):
        try_flips(FLIPS, baseline.best, there, Executor(1, 1), np.inf)


def test_flips_that_cannot_be_simulated_are_told_as_not_examined() -> None:
    objective, baseline = identified(BENCH, closed_form.objective(BENCH, BENCH.truth))
    never = AsMeasured(SolverError("no step is short enough\nat t = 1 s"))
    there = replace(objective, model=replace(objective.model, adapter=never))
    found = try_flips(FLIPS, baseline.best, there, Executor(1, 1), np.inf)
    assert not found.scores and not found.refits
    assert [(one.cause, one.why) for one in found.untried] == [
        (flip.name, "it cannot be simulated (no step is short enough)") for flip in FLIPS
    ]
