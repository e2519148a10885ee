"""What an objective asks of the solver where much is known already."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from driver.identification.objective import Objective
from driver.workflow.identify_stage import same_simulation
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.interface import Progress, Response, Simulation
from tools import closed_form

FITTED, FURTHER = ("tau0", "elongation_2"), ("c", "tau0_grain2")


@dataclass
class Watched(BundledAdapter):
    """The bundled solver, and what it was asked and answered."""

    seen: list[tuple[Simulation, Response]] = field(default_factory=list)

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        response = super().solve(simulation, workspace, progress)
        self.seen.append((simulation, response))
        return response


@pytest.fixture(scope="module")
def objective() -> Objective:
    """Data in closed form, held against the bundled solver in steps that refine themselves."""
    problem = closed_form.problem()
    known = closed_form.objective(problem, problem.truth)
    return replace(known, model=replace(known.model, adapter=Watched(), accuracy=1.0))


def watched(objective: Objective) -> list[tuple[Simulation, Response]]:
    adapter = objective.model.adapter
    assert isinstance(adapter, Watched)
    return adapter.seen


def test_what_an_evaluation_lacks_is_added_without_iterations_and_in_its_steps(
    objective: Objective,
) -> None:
    values = objective.model.null_values() | closed_form.problem().truth
    fitted = objective.evaluate(values, FITTED)
    completed = objective.with_free(fitted, (*FURTHER, *FITTED))
    simulation, response = watched(objective)[-1]
    known = fitted.prediction.response
    assert [direction.name for direction in simulation.directions] == [*FURTHER]
    assert response.iterations < 0.05 * known.iterations
    assert known.refinements > 0 and simulation.accuracy is None and simulation.steps is not None
    np.testing.assert_allclose(simulation.steps, known.ends, rtol=1e-12)
    whole = objective.evaluate(values, (*FURTHER, *FITTED))
    assert completed.free == whole.free
    np.testing.assert_allclose(completed.residual, whole.residual, atol=1e-6)
    np.testing.assert_allclose(
        completed.jacobian, whole.jacobian, atol=1e-4 * abs(whole.jacobian).max()
    )


def test_near_an_evaluation_others_take_fewer_iterations_and_find_the_same(
    objective: Objective,
) -> None:
    values = objective.model.null_values() | closed_form.problem().truth
    here = objective.with_time_steps_of(objective.evaluate(values, FITTED))
    there = values | {"tau0": 1.01 * values["tau0"]}
    cold = here.evaluate(there, ())
    near = here.warm_started_from(objective.evaluate(values, ())).evaluate(there, ())
    fewer, many = (e.prediction.response.iterations for e in (near, cold))
    assert fewer < 0.8 * many
    np.testing.assert_allclose(near.residual, cold.residual, atol=1e-4)


def test_a_finished_identification_is_simulated_once_more_without_iterations(
    objective: Objective,
) -> None:
    values = objective.model.null_values() | closed_form.problem().truth
    response = objective.evaluate(values, ()).prediction.response
    assert response.trajectory is not None
    written = {
        "trajectory/times": response.trajectory.times,
        "trajectory/displacement": response.trajectory.displacement,
    }
    again = same_simulation(objective, written, values).evaluate(values, FITTED)
    simulation, _ = watched(objective)[-1]
    assert again.prediction.response.iterations < 0.05 * response.iterations
    assert simulation.accuracy is None and simulation.steps is not None
    np.testing.assert_allclose(simulation.steps, response.ends, rtol=1e-12)
    assert same_simulation(objective, {}, values) is objective  # an external solver
