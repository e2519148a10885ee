from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.causes.noise_causes import BOUNDARY_NOISE
from driver.diagnosis.search import extension as extension_module
from driver.diagnosis.search.extension import Extension, corrected_anew, extended
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.load_outliers import bad_loads
from driver.diagnosis.search.refit import Executor, refit_causes
from driver.diagnosis.statistics.score_test import score
from driver.diagnosis.statistics.screening import screened
from driver.forward.model import ForwardModel
from driver.identification.fit import Fit
from driver.identification.objective import Objective
from meshes.arrays import FloatArray
from solver_adapters.interface import Simulation
from tools import closed_form
from tools.closed_form_diagnosis import SETTINGS, finer, identified

BENCH = closed_form.problem()
CAUSE = "stretch_not_proportional"
HIDDEN = {"stretch_curvature": 0.1}
WRONG, WRONG_TOO = 12, 30


class ErringWithStrength(closed_form.ClosedFormSolver):
    """A finer simulation that folds the face as τ0 is off, by its square."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        """Displacement of the output nodes (T, n, 3) and load (T,)."""
        motion, load = super().answer(simulation)
        x = simulation.mesh.points[simulation.output_nodes, 0]
        off = simulation.material.tau0 / BENCH.truth["tau0"] - 1.0
        motion[..., 2] += 2.0 * off**2 * np.sin(x)
        return motion, load


def refitted(objective: Objective, baseline: Fit, name: str = CAUSE) -> Refit:
    """A cause, refitted from the baseline."""
    causes, names = screened(objective.model, baseline.best.free, (name,))
    augmented = objective.evaluate(baseline.values, names)
    (cause,) = causes
    rows = [augmented.free.index(name) for name in cause.parameters]
    one = score(
        cause, augmented.jacobian[rows], objective.restrict(augmented, baseline.best.free), 1
    )
    (found,) = refit_causes([one], augmented, baseline.best, objective, Executor(1, 1))
    return found


def extension(off: float, other: float = 0.0) -> tuple[Fit, Extension]:
    """The baseline, which leaves a load out, and the model that is extended from it.

    Args:
        off: by how much this load is wrong [µN].
        other: by how much another one is wrong [µN].
    """
    made = closed_form.objective(BENCH, BENCH.truth | HIDDEN)
    load = made.data.load.copy()
    load[WRONG] += off
    load[WRONG_TOO] += other
    made = replace(made, data=replace(made.data, load=load, bad_loads=(WRONG,)))
    objective, baseline = identified(BENCH, made)
    begin = Extension(
        baseline, objective, FineModels(finer(BENCH)), (), {}, 0.0, baseline.best.free, ()
    )
    return baseline, extended(begin, refitted(objective, baseline), SETTINGS)


def test_a_load_that_was_left_out_and_that_the_extended_model_explains_is_taken_back() -> None:
    _, found = extension(0.0)
    assert found.objective.data.bad_loads == ()


def test_a_load_that_is_wrong_stays_left_out() -> None:
    _, found = extension(40 * closed_form.LOAD_NOISE)
    assert found.objective.data.bad_loads == (WRONG,)
    assert found.fit.values["stretch_curvature"] == pytest.approx(0.1, abs=0.015)


def test_a_load_that_looks_wrong_at_the_extended_model_alone_is_not_left_out() -> None:
    _, found = extension(0.0, 40 * closed_form.LOAD_NOISE)
    data = found.objective.data
    assert [bad.frame for bad in bad_loads(found.fit.best, data)] == [WRONG_TOO]
    assert data.bad_loads == ()


def test_the_extended_model_has_its_own_correction_its_own_noise_and_a_fit_that_has_converged() -> (
    None
):
    baseline, found = extension(0.0)
    assert [cause.name for cause in found.causes] == [CAUSE]
    assert found.surpassed == (frozenset(),)
    assert found.fit.converged and found.fit.best.free == (*baseline.best.free, *HIDDEN)
    data = found.objective.data
    assert data.load_noise == pytest.approx(closed_form.LOAD_NOISE, rel=0.35)
    assert data.image.noise_factor == pytest.approx(1.0, abs=0.05)
    own = np.asarray(found.objective.correction.load)
    model, at = found.objective.model, found.fit.values
    expected = finer(BENCH).predict(at).load - model.predict(at).load
    of_baseline = finer(BENCH).predict(baseline.values).load - model.predict(baseline.values).load
    scale = np.abs(expected).max()
    assert np.abs(own - expected).max() < 0.02 * scale < np.abs(of_baseline - expected).max()


def extended_from(factor: float, one: ForwardModel) -> Extension:
    """The model extended from a refit that stands at so many times its τ0.

    Args:
        factor: of τ0.
        one: the finer model.
    """
    made = closed_form.objective(BENCH, BENCH.truth | HIDDEN)
    objective, baseline = identified(BENCH, made)
    winner = refitted(objective, baseline)
    values = winner.fit.values | {"tau0": factor * winner.fit.values["tau0"]}
    at = winner.objective.evaluate(values, winner.fit.best.free)
    winner = replace(winner, fit=replace(winner.fit, best=at))
    meshes = FineModels(one)
    begin = Extension(baseline, objective, meshes, (), {}, 0.0, baseline.best.free, ())
    return extended(begin, winner, SETTINGS)


@pytest.mark.parametrize(("factor", "times"), [(1.0, 1), (2.0, 2)])
def test_a_model_far_from_where_its_correction_was_taken_is_corrected_once_more(
    factor: float, times: int, lines: list[str]
) -> None:
    """Where τ0 is twice what it is the loads are twice as large, and so is what mesh errs by."""
    found = extended_from(factor, finer(BENCH))
    assert lines.count("finer mesh and steps at the extended model") == times
    assert found.fit.converged
    model, end = found.objective.model, found.fit.values
    expected = finer(BENCH).predict(end).load - model.predict(end).load
    own = np.asarray(found.objective.correction.load)
    assert own == pytest.approx(expected, abs=0.02 * np.abs(expected).max())


@pytest.mark.parametrize(("factor", "times"), [(1.0, 1), (1.03, 2)])
def test_a_model_whose_correction_has_changed_on_its_way_is_corrected_once_more(
    factor: float, times: int, lines: list[str]
) -> None:
    """The prediction moves by 28 σ, not far; derivatives leave as much out as they tell."""
    erring = replace(BENCH.model, adapter=ErringWithStrength())
    found = extended_from(factor, erring)
    assert lines.count("finer mesh and steps at the extended model") == times
    assert found.fit.converged
    end = found.fit.values
    own = erring.predict(end).motion - BENCH.model.predict(end).motion
    # Taken where τ0 is 3 % off it would be wrong here by 1.4 nm.
    assert np.abs(own - found.objective.correction.at(end).motion).max() < 1e-4


def test_a_model_that_is_always_outgrown_is_corrected_three_times(
    monkeypatch: pytest.MonkeyPatch, lines: list[str]
) -> None:
    monkeypatch.setattr(extension_module, "_outgrown", lambda *_: True)
    extension(0.0)
    assert lines.count("finer mesh and steps at the extended model") == 3


def test_what_was_added_is_tested_where_the_model_is_corrected_anew() -> None:
    """Evidence for the cause added last was found with a correction that has changed since."""
    _, found = extension(0.0)
    kept = corrected_anew(found, SETTINGS)
    assert kept.causes == found.causes and kept.fit.converged
    assert kept.fit.values["stretch_curvature"] == pytest.approx(0.1, abs=0.015)
    made = closed_form.objective(BENCH, BENCH.truth)
    nothing = replace(found.objective, data=replace(made.data, bad_loads=()))
    dropped = corrected_anew(replace(found, objective=nothing), SETTINGS)
    assert dropped.causes == () and dropped.fit.values["stretch_curvature"] == 0.0
    assert dropped.fit.best.free == found.fitted


def test_a_noise_without_a_level_is_no_cause_of_the_model_that_is_corrected_anew() -> None:
    _, found = extension(0.0)
    causes = (BOUNDARY_NOISE, *found.causes)
    after = corrected_anew(replace(found, causes=causes, of_noise=7.0), SETTINGS)
    assert after.causes == found.causes and after.of_noise == 0.0
