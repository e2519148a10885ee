from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from driver.diagnosis.finer_meshes import FinerMeshes
from driver.diagnosis.own_correction import REACH, with_own_corrections
from driver.diagnosis.refit import Crew, Refit, refit_causes
from driver.diagnosis.score import score
from driver.diagnosis.screening import screened
from driver.identification.fit import Fit
from driver.log import silent
from solver_adapters.interface import Simulation, SolverError
from tests.driver import closed_form
from tests.driver.closed_form_diagnosis import finer, identified

FloatArray = NDArray[np.float64]

BENCH = closed_form.bench()
TRUE, RIVAL = "grain_contrast", "boundary_position"


class ErringWithContrast(closed_form.ClosedFormSolver):
    """A working mesh that bends the face where the grains differ, as no specimen does."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        motion, load = super().answer(simulation)
        x = simulation.mesh.points[simulation.output_nodes, 0]
        grown = np.linspace(0.0, 0.003 * np.log(simulation.material.tau0_grain2), len(motion))
        motion[..., 2] += grown[:, None] * x**2
        return motion, load


class Failing(closed_form.ClosedFormSolver):
    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        raise SolverError("no step is short enough\nstep 3")


@cache
def refitted() -> tuple[Fit, list[Refit]]:
    """The baseline, and the true cause and its rival refitted under its correction."""
    working = replace(BENCH.model, adapter=ErringWithContrast())
    made = closed_form.objective(BENCH, BENCH.truth | {"tau0_grain2": 3.0})
    objective, baseline = identified(replace(BENCH, model=working), replace(made, model=working))
    causes, names = screened(objective.model, baseline.best.free, (TRUE, RIVAL))
    screening = objective.evaluate(baseline.values, names)
    rows = {name: row for name, row in zip(screening.free, screening.jacobian, strict=True)}
    scores = [
        score(cause, np.array([rows[n] for n in cause.parameters]), baseline.best, len(causes))
        for cause in causes
    ]
    refits = refit_causes(scores, screening, baseline.best, objective, Crew(1, 1, silent))
    return baseline, sorted(refits, key=lambda refit: -refit.log_evidence)


def names_of(refits: list[Refit]) -> list[str]:
    return [refit.cause.name for refit in refits]


def test_what_the_working_mesh_gets_wrong_at_a_cause_no_longer_speaks_against_it() -> None:
    baseline, before = refitted()
    assert names_of(before) == [RIVAL, TRUE]
    crew = Crew(1, 1, silent)
    after = with_own_corrections(before, baseline.best, FinerMeshes(finer(BENCH)), crew)
    assert names_of(after) == [TRUE, RIVAL]
    assert after[0].log_evidence > before[1].log_evidence + 10
    # Where the mesh errs no more than at the baseline, nothing has changed.
    assert after[1].log_evidence == pytest.approx(before[0].log_evidence, abs=0.2)


def test_a_refit_that_cannot_be_simulated_finer_stays_and_the_log_says_so() -> None:
    baseline, before = refitted()
    lines: list[str] = []
    failing = FinerMeshes(replace(BENCH.model, adapter=Failing()))
    after = with_own_corrections(before, baseline.best, failing, Crew(1, 1, lines.append))
    assert after == before
    assert lines[1:] == [
        f"  {refit.cause.name}: log evidence {refit.log_evidence:+.1f} as it was, for it cannot be "
        "simulated (no step is short enough)"
        for refit in before
    ]


def test_one_that_leads_alone_is_not_simulated() -> None:
    baseline, (first, second) = refitted()
    far = replace(second, log_evidence=first.log_evidence - REACH - 0.1)
    lines: list[str] = []
    failing = FinerMeshes(replace(BENCH.model, adapter=Failing()))
    crew = Crew(1, 1, lines.append)
    assert with_own_corrections([first, far], baseline.best, failing, crew) == [first, far]
    assert with_own_corrections([], baseline.best, failing, crew) == [] and not lines
