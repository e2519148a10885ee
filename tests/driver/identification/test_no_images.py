from __future__ import annotations

import numpy as np
import pytest

from driver.identification.data import Data
from driver.identification.no_images import no_images
from driver.identification.objective import Objective
from driver.parameters.registry import declared_parameters
from tools import closed_form
from tools.closed_form import KNOTS, LOAD_NOISE


@pytest.fixture(scope="module")
def objective() -> Objective:
    """The loads of the closed-form specimen, and nothing else."""
    problem = closed_form.problem()
    load = closed_form.readings(problem, problem.truth, 0)
    data = Data(no_images(load.size), load, LOAD_NOISE, 0.0, np.arange(load.size))
    return Objective(problem.model, data, declared_parameters(len(KNOTS) + 1))


def test_the_residual_is_that_of_the_loads_alone(objective: Objective) -> None:
    problem = closed_form.problem()
    free = ("tau0", "load_gain", "origin_Y", "elongation_2")
    found = objective.evaluate(problem.truth, free)
    beside = closed_form.objective(problem, problem.truth).evaluate(problem.truth, free)
    np.testing.assert_array_equal(found.residual, beside.residual[: beside.n_load])
    np.testing.assert_array_equal(found.jacobian, beside.jacobian[:, : beside.n_load])
    assert found.chi_image == 0.0 and found.chi_load == pytest.approx(1.0, abs=0.3)


def test_it_is_empty_also_with_some_of_the_frames(objective: Objective) -> None:
    half = objective.data.frames(np.arange(10))
    residual, shift, rho = half.residual(np.zeros((objective.data.load.size, 0, 3)), half.load)
    assert residual.shape == (10,) and shift.shape == rho.shape == (10, 0)
