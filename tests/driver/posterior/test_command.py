"""The command on the specimen of the closed-form solver, and its cost beside a whole evaluation."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from driver.case.model import load_case, write_case
from driver.common.errors import InputError
from driver.forward import build
from driver.posterior.command import posterior
from driver.posterior.importance_sampling import Weighted
from driver.posterior.moments import Sampled, lines_of
from driver.results.files import POSTERIOR, POSTERIOR_DRAWS, RESULTS
from driver.workflow import pipeline
from driver.workflow.engine import run_stages
from solver_adapters.interface import SolverError
from tools import closed_form


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A case whose identification is finished."""
    folder = tmp_path_factory.mktemp("identified")
    with pytest.MonkeyPatch.context() as patch:
        solver = closed_form.ClosedFormSolver(0.001)
        patch.setattr(build, "find_adapter", lambda name, profile: solver)
        closed_form.write_files(folder, {})
        path = folder / "case.toml"
        one_process = load_case(path).with_values_at({"execution.processes": 1})
        write_case(one_process, path)
        case = load_case(path)
        run_stages(case, pipeline.stages(case), "identify")
        yield path


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_posterior_that_is_nearly_gaussian_has_the_moments_of_the_hessian(
    identified: Path, lines: list[str]
) -> None:
    found = posterior(identified, 300)
    # The closed form is nearly linear over the widths that its data leave.
    for one in found:
        assert abs(one.mean - one.value) < 0.3 * one.sigma, one
        assert one.deviation == pytest.approx(one.sigma, rel=0.2), one
        assert one.lower < one.median < one.upper
    assert any("300 draws, worth" in line and "Pareto k" in line for line in lines)
    assert any("300 draws: " in line for line in lines)
    table = rows(identified.parent / RESULTS / POSTERIOR)
    known = {row["parameter"]: row for row in rows(identified.parent / RESULTS / "identify.csv")}
    for row in table:
        other = known[row["name"]]
        assert float(row["value"]) == pytest.approx(float(other["value"]), rel=1e-4)
        assert float(row["sigma"]) == pytest.approx(float(other["sigma"]), rel=2e-2)
    draws = rows(identified.parent / RESULTS / POSTERIOR_DRAWS)
    assert len(draws) == 300
    assert sum(float(draw["weight"]) for draw in draws) == pytest.approx(1, rel=1e-4)


def test_the_same_seed_gives_the_same_numbers(identified: Path) -> None:
    assert posterior(identified, 60, seed=4) == posterior(identified, 60, seed=4)
    assert posterior(identified, 60, seed=4) != posterior(identified, 60, seed=5)


def test_draws_that_cannot_be_simulated_have_no_weight_and_are_told(
    identified: Path, monkeypatch: pytest.MonkeyPatch, lines: list[str]
) -> None:
    whole = closed_form.ClosedFormSolver.solve
    start = {row.name: row.value for row in posterior(identified, 50)}["tau0"]

    def fails_when_hard(self, simulation, *others):  # type: ignore[no-untyped-def]
        if simulation.material.tau0 > 1.002 * start:
            raise SolverError("no equilibrium")
        return whole(self, simulation, *others)

    monkeypatch.setattr(closed_form.ClosedFormSolver, "solve", fails_when_hard)
    found = {one.name: one for one in posterior(identified, 200)}
    assert found["tau0"].mean < found["tau0"].value and found["tau0"].upper < 1.003 * start
    assert any("could not be simulated" in line for line in lines)


def test_what_is_not_there_yet_is_told(identified: Path, tmp_path: Path) -> None:
    closed_form.write_files(tmp_path, {})
    with pytest.raises(InputError, match="found no results of mesh, measure, identify"):
        posterior(tmp_path / "case.toml")


def test_the_cost_of_a_draw_is_that_of_the_model_with_images_to_first_order() -> None:
    """Of a model that is linear, images included, it is the whole cost."""
    specimen = closed_form.problem()
    values = specimen.model.null_values() | {"tau0": 40.0}
    objective = closed_form.objective(specimen, values)
    free = ("tau0", "c", "lambda_plus_Y")
    at = objective.evaluate(values, free)
    for name in free:
        known = objective.parameters[name]
        step = 1e-4
        moved = dict(values) | {name: known.value(step, values[name])}
        prediction = objective.model.predict(moved, ())
        slope = (objective.cost_about(at, prediction, moved) - at.cost) / step
        row = free.index(name)
        assert slope == pytest.approx(
            -2 * at.gradient[row], rel=0.02, abs=0.02 * abs(at.cost) ** 0.5
        )
    same = objective.model.predict(values, ())
    assert objective.cost_about(at, same, values) == pytest.approx(at.cost, rel=1e-12)
    held = replace(objective, prior={"tau0": (44.0, 0.1)})
    gap = objective.parameters["tau0"].theta(44.0, 40.0)
    begin = held.compare(at.prediction, values, free)
    assert held.cost_about(begin, same, values) == pytest.approx(at.cost + (gap / 0.1) ** 2)
    assert np.isfinite(begin.cost)


def test_with_weights_that_cannot_be_trusted_no_gaussian_is_called_poor() -> None:
    one = Sampled("tau0", "MPa", 22.0, 0.2, 23.0, 0.1, 22.8, 23.0, 23.2)
    weights = np.full(50, 0.02)
    trusted, doubtful = (list(lines_of([one], Weighted(weights, k), 0)) for k in (0.3, 1.4))
    assert trusted[-1].endswith("not the Gaussian about the identified value")
    assert "not to be trusted" in "".join(doubtful) and "Gaussian" not in doubtful[-1]
    # Of a mean 0.4 σ off ten draws tell nothing, a thousand do.
    near = replace(one, mean=22.08, deviation=0.2)
    assert not near.poor(10) and near.poor(1000)
