"""What a design predicts, against the identification of a virtual experiment that was made."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from driver.case.model import load_case
from driver.design.command import design
from driver.identification.fit import Fit
from driver.identification.identify import corrected_with_derivatives
from driver.results.files import DESIGN, IDENTIFY, RESULTS
from driver.results.hdf5 import read_hdf5
from driver.results.identification import read_identification
from driver.virtual.writing import record
from driver.workflow.engine import StageContext
from driver.workflow.identify_stage import load_problem, same_simulation, saved_objective
from driver.workflow.pipeline import run
from tools.converged_truth import known_case, pulled


def at_its_end(case: Path) -> tuple[tuple[str, ...], dict[str, float], dict[str, float]]:
    """Names, values and σ of a fit, its correction with the derivatives at the result.

    The identification has those at the end of stage B, the diagnosis takes them anew, as here.
    """
    results = case.parent / RESULTS
    stated = load_case(case)
    problem = load_problem(StageContext(stated, results, results))
    identified, texts = read_hdf5(results / IDENTIFY), read_identification(results / IDENTIFY)
    objective = saved_objective(problem, identified)
    values = problem.objective.model.null_values() | texts.values
    here = same_simulation(objective, identified, values).evaluate(values, texts.names)
    _, there = corrected_with_derivatives(objective, problem.finer, here, problem.plan.sizes)
    fit = Fit(there, True, "", ())
    sigma = {name: fit.sigma(name, objective.parameters) for name in texts.names}
    return texts.names, values, sigma


@pytest.mark.long
def test_the_predicted_sigma_is_that_of_the_fit_though_no_image_is_looked_at(
    tmp_path: Path,
) -> None:
    """Two grains, images and loads of a converged simulation, with the bundled solver.

    Within 12 %: the fit also estimates the noise of the images (to 2 %), and its gradient holds
    what 31 images leave of noise.
    """
    case = record(tmp_path, known_case(), pulled({}), 1)
    run(case, "identify", False)
    names, values, fitted = at_its_end(case)
    assumed = "\n".join(["[truth]", *(f"{name} = {values[name]!r}" for name in names)])
    (tmp_path / "settings.toml").write_text(assumed, encoding="utf-8")
    (tmp_path / "images.tif").unlink()
    design(case, tmp_path / "settings.toml", [], False)
    found = json.loads((tmp_path / "results" / DESIGN).read_text(encoding="utf-8"))
    predicted = {p["parameter"]: p["sigma"] for p in found["experiment"]["parameters"]}
    assert set(predicted) == set(fitted)
    for name, sigma in fitted.items():
        assert predicted[name] == pytest.approx(sigma, rel=0.12), name
