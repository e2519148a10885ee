from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind_misfit import Left, left_of
from benchmarks.blind_ruler import identified, shown
from driver.case.model import load_case
from driver.diagnosis.causes.causes import LIBRARY, Cause
from driver.forward import build
from driver.virtual.truth import Course, seen_course
from driver.workflow.engine import run_stages
from driver.workflow.pipeline import stages
from tools import closed_form

BY_NAME = {cause.name: cause for cause in LIBRARY}
CURVED, DRIFT = BY_NAME["stretch_not_proportional"], BY_NAME["magnification_drift"]
Experiment = tuple[Path, Course, Course]
HIDDEN = {"stretch_curvature": 0.03}  # small enough for the first order to hold


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Experiment]:
    """A specimen whose elongation is not proportional to stage travel, identified without that."""
    folder, problem = tmp_path_factory.mktemp("curved"), closed_form.problem()
    truth = problem.truth | HIDDEN
    closed_form.write_files(folder, HIDDEN)
    path = folder / "case.toml"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "find_adapter", lambda name, profile: closed_form.ClosedFormSolver())
        run_stages(load_case(path), stages(load_case(path)), "identify")
        model = problem.model
        course, unaffected = (
            seen_course(model, model.simulation(values), problem.history, values)
            for values in (truth, problem.truth)
        )
        yield path, course, unaffected


def left(experiment: Experiment, *causes: Cause) -> Left:
    return left_of(*experiment, causes)


def test_what_is_left_of_a_cause_is_the_amount_times_what_the_fit_cannot_take(
    experiment: Experiment,
) -> None:
    objective, values, free = identified(experiment[0])
    wide = objective.evaluate(values, (*free, *HIDDEN))
    here = objective.restrict(wide, free)
    (name,) = HIDDEN
    effect = wide.jacobian[wide.free.index(name)]
    J = here.jacobian
    alone = effect - J.T @ np.linalg.solve(here.hessian, J @ effect)
    slope = objective.parameters[name].slope(values[name])
    expected = float(np.linalg.norm(alone)) * HIDDEN[name] / slope
    found = left(experiment, CURVED)
    assert expected > 6
    assert found.like_itself[0] == pytest.approx(expected, rel=0.1)
    # All of the effect looks like itself.
    assert found.whole == pytest.approx(found.like_itself[0], rel=0.1)


def test_what_the_simulation_gets_wrong_is_no_part_of_what_is_left_of_an_effect(
    experiment: Experiment,
) -> None:
    """It misses 10 nm of either course, which is more than all of the effect."""
    path, *courses = experiment
    wrong = 0.01 * np.random.default_rng(0).normal(size=courses[0].motion.shape)
    course, unaffected = (replace(one, motion=one.motion + wrong) for one in courses)
    objective, _, _ = identified(path)
    missed = shown(course, objective) - shown(courses[0], objective)
    found = left(experiment, CURVED)
    size = np.linalg.norm(objective.data.change(missed, np.zeros(len(wrong))))
    again = left((path, course, unaffected), CURVED)
    assert size > 2.5 * found.whole
    assert abs(again.whole - found.whole) < 0.1 * size


def test_a_single_cause_has_nothing_beside_it(experiment: Experiment) -> None:
    found = left(experiment, CURVED)
    assert found.beside == pytest.approx(found.like_itself)


def test_what_another_effect_imitates_of_a_cause_is_not_left_beside_that_one(
    experiment: Experiment,
) -> None:
    found = left(experiment, CURVED, DRIFT)
    alone, imitated = found.like_itself
    assert imitated > 3  # what was hidden looks like the drift that was not, too
    assert found.beside[1] < 0.3 * imitated
    assert 0.5 * alone < found.beside[0] <= alone
