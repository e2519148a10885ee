"""The error of time steps of first order, by parts of those that were taken."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from driver.forward.build import build_model, mesh_of
from driver.forward.mesh_extrapolation import lacking_share
from driver.forward.model import ForwardModel
from driver.forward.prediction import Prediction
from driver.identification.correction import correction
from driver.identification.step_error import (
    StepError,
    error_by_parts,
    has_first_order,
    in_parts_of,
    parts_of,
)
from driver.virtual.truth import stage_program
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.interface import Response
from tools import closed_form
from tools.short_specimen import small_case

CASE = small_case()
HISTORY = stage_program([(4, 1)])


def model(steps: int = 1, scheme: str = "backward_euler") -> ForwardModel:
    """A coarse one, without pixels."""
    solver = CASE.solver.model_copy(update={"integration": scheme})
    case = CASE.model_copy(update={"solver": solver})
    pixels = np.array([[0.0, 2.0], [0.5, 6.0]])
    return build_model(case, mesh_of(CASE, 4.0), HISTORY, pixels, BundledAdapter(), steps)


def of_hexahedra(scheme: str, *sizes: tuple[float, int]) -> list[ForwardModel]:
    """Models of so large cells [µm] and so many steps an interval."""
    specimen = CASE.specimen.model_copy(update={"cells": "hex20"})
    solver = CASE.solver.model_copy(update={"integration": scheme})
    case = CASE.model_copy(update={"specimen": specimen, "solver": solver})
    pixels = np.array([[0.0, 2.0], [0.5, 6.0]])
    return [
        build_model(case, mesh_of(case, size), HISTORY, pixels, BundledAdapter(), steps)
        for size, steps in sizes
    ]


def values() -> dict[str, float]:
    return model().null_values() | {"elongation_1": 0.045, "elongation_2": 0.040, "tau0": 25.0}


@pytest.mark.parametrize("parts", [2, 3])
def test_parts_of_the_steps_tell_the_error_against_the_limit_of_small_ones(parts: int) -> None:
    working = model(4)
    coarse, limit = working.predict(values()), model(128).predict(values())
    divided = in_parts_of(working, coarse, values(), parts).predict(values())
    found = error_by_parts(coarse, divided, parts)
    for mine, true in (
        (found.load, limit.load - coarse.load),
        (found.motion, limit.motion - coarse.motion),
    ):
        assert np.linalg.norm(mine - true) < 0.3 * np.linalg.norm(true)


def test_the_steps_that_were_taken_are_divided_those_that_were_cut_too() -> None:
    cut = np.sort(np.append(HISTORY.time[1:], [HISTORY.time[2] - 1.0, HISTORY.time[2] - 0.5]))
    working = replace(model(), steps=cut)
    coarse = working.predict(values())
    np.testing.assert_allclose(coarse.response.ends, cut)
    parts = in_parts_of(working, coarse, values(), 2).predict(values()).response.ends
    assert parts.size == 2 * cut.size
    np.testing.assert_allclose(parts[1::2], cut)
    np.testing.assert_allclose(parts[::2], 0.5 * (np.append(0.0, cut[:-1]) + cut))


@pytest.mark.parametrize("parts", [1, 2, 3])
def test_of_a_finer_simulation_on_the_same_mesh_all_is_of_the_steps(parts: int) -> None:
    working, finer = model(), model(parts)
    assert parts_of(working, finer) == parts
    coarse, divided = working.predict(values()), model(max(parts, 2)).predict(values())
    change = correction(working, finer, coarse, values())
    error, left = error_by_parts(coarse, divided, max(parts, 2)), change.left_by_steps
    assert left is not None
    bound = 1e-6 * abs(error.load).max()
    np.testing.assert_allclose(left.load, error.load / parts, atol=bound)
    np.testing.assert_allclose(change.load, error.load * (1 - 1 / parts), atol=bound)
    np.testing.assert_allclose(change.of_mesh[1], 0.0, atol=bound)


def test_what_the_steps_leave_is_taken_over_where_it_is_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It costs no simulation then."""
    working, finer = model(), model(2)
    coarse = working.predict(values())
    taken = correction(working, finer, coarse, values())
    assert taken.left_by_steps is not None
    known, predict = taken.left_by_steps.times(3.0), ForwardModel.predict
    runs: list[ForwardModel] = []

    def counted(self: ForwardModel, *asked: Any) -> Prediction:
        runs.append(self)
        return predict(self, *asked)

    monkeypatch.setattr(ForwardModel, "predict", counted)
    change = correction(working, finer, coarse, values(), left_by_steps=known)
    assert len(runs) == 1
    assert change.left_by_steps is known
    np.testing.assert_allclose(change.load, 3.0 * np.asarray(taken.load), rtol=1e-6)


def test_a_finer_simulation_takes_the_steps_that_were_cut() -> None:
    """Else its correction would compare steps of the one with other steps of the other."""
    cut = np.sort(np.append(HISTORY.time[1:], HISTORY.time[2] - 1.0))
    working = replace(model(), steps=cut)
    coarse = working.predict(values(), ("tau0",))
    change = correction(working, model(2), coarse, values(), ("tau0",))
    assert change.derivatives is not None
    np.testing.assert_allclose(change.derivatives.finer.response.ends, cut)


def test_where_the_finer_mesh_cuts_more_steps_both_meshes_are_compared_in_these() -> None:
    """Else what its cuts change would count as an error of the mesh, and twice."""
    working, finer = of_hexahedra("backward_euler", (2.0, 1), (1.0, 2))
    share = lacking_share(working.microstructure.mesh, finer.microstructure.mesh)
    there = values() | {"elongation_1": 0.15, "elongation_2": 0.135}
    coarse = working.predict(there, ("tau0",))
    fine = finer.in_steps_of(working).predict(there)
    ends = fine.response.ends
    assert ends.size > coarse.response.ends.size
    alike = working.with_time_steps_of(ends, there).predict(there)
    change = correction(working, finer, coarse, there, ("tau0",))
    expected = (1 + share.load) * (fine.load - alike.load)
    np.testing.assert_allclose(change.of_mesh[1], expected, atol=1e-5 * abs(expected).max())
    # The cuts change more than a tenth of what the mesh does.
    assert np.linalg.norm(alike.load - coarse.load) > 0.1 * np.linalg.norm(fine.load - alike.load)
    assert change.derivatives is not None
    assert change.derivatives.working.response.ends.size == ends.size


def test_another_scheme_or_another_bound_of_the_error_is_left_alone() -> None:
    exponential = model(scheme="exponential")
    coarse = exponential.predict(values())
    assert not has_first_order(exponential, coarse)
    assert has_first_order(model(), coarse)
    assert not has_first_order(replace(model(), accuracy=1.0), coarse)
    finer = model(2, "exponential")
    change = correction(exponential, finer, coarse, values())
    assert change.left_by_steps is None
    np.testing.assert_array_equal(change.of_mesh[1], change.load)
    # Fewer steps than the working ones tell nothing.
    twice = model(2, "exponential")
    assert not np.any(correction(twice, exponential, twice.predict(values()), values()).load)


def test_steps_beyond_those_stated_are_counted_as_cut() -> None:
    cut = np.sort(np.append(HISTORY.time[1:], HISTORY.time[2] - 1.0))
    coarse = replace(model(), steps=cut).predict(values())
    assert model().cut_steps(coarse.response) == 1
    assert model().cut_steps(model().predict(values()).response) == 0
    assert replace(model(), accuracy=1.0).cut_steps(coarse.response) == 0


def test_the_error_of_the_steps_is_one_standard_deviation_of_its_own_pattern() -> None:
    """Over images and loads together: a residual along the pattern has unit variance once whitened.

    The pattern p has covariance I + p pᵀ, in which p itself has |p|²/(1 + |p|²) for |p|².
    """
    b = closed_form.problem()
    data = closed_form.objective(b, b.truth).data
    T = b.history.n_images
    course = np.linspace(0.0, 1.0, T) ** 2
    shape = data.image.images.xy[:, 1, None] * np.array([1e-4, 4e-4, 2e-4])
    motion = course[:, None, None] * shape
    error = StepError(motion, 9.0 * course)
    known = replace(data, step_error=error)
    along, whitened = (d.change(error.motion, error.load) for d in (data, known))
    square = float(along @ along)
    assert square > 10.0
    assert float(whitened @ whitened) == pytest.approx(square / (1.0 + square))
    # What is orthogonal to it is whitened as before, and a sign of its own changes nothing.
    other = np.zeros(T)
    other[3] = 5.0
    plain = data.change(0 * motion, other)
    across = plain - (plain @ along) / square * along
    np.testing.assert_allclose(known._whiten_patterns(across), across, atol=1e-10)
    flipped = replace(data, step_error=StepError(motion, -9.0 * course))
    assert flipped.change(motion, 9.0 * course) @ along != pytest.approx(whitened @ along, rel=1e-3)


@pytest.mark.parametrize("scheme", ["exponential", "backward_euler"])
def test_steps_are_finer_on_the_working_mesh_alone(scheme: str) -> None:
    """What finer cells and finer steps change beyond the sum of each is a product of errors."""
    working, finer, stepped = of_hexahedra(scheme, (2.0, 1), (1.0, 2), (2.0, 2))
    share = lacking_share(working.microstructure.mesh, finer.microstructure.mesh)
    coarse, fine, more_steps, finer_cells = (
        m.predict(values(), ("tau0",))
        for m in (working, finer, stepped, finer.in_steps_of(working))
    )
    change = correction(working, finer, coarse, values(), free=("tau0",))
    of_steps, of_mesh = more_steps.load - coarse.load, finer_cells.load - coarse.load
    assert share.load > share.motion > 0.3
    expected = of_steps + (1 + share.load) * of_mesh
    np.testing.assert_allclose(change.load, expected, rtol=1e-6, atol=1e-6)
    expected = more_steps.motion - coarse.motion
    expected = expected + (1 + share.motion) * (finer_cells.motion - coarse.motion)
    np.testing.assert_allclose(change.motion, expected, atol=1e-6 * abs(expected).max())
    both = np.linalg.norm(fine.load - coarse.load - of_mesh - of_steps)
    assert both < 0.4 * np.linalg.norm(of_steps)
    if scheme == "exponential":
        assert 0.4 * np.linalg.norm(of_steps) < 0.1 * np.linalg.norm(of_mesh)
    # Their derivatives are those of the cells.
    assert change.derivatives is not None
    assert change.derivatives.finer.response.ends.size == coarse.response.ends.size
    motion, load = change.derivatives.change(values() | {"tau0": 26.0})
    step = np.array([np.log(26.0 / 25.0) * 25.0])
    (far, far_load), (near, near_load) = (p.along(step) for p in (finer_cells, coarse))
    np.testing.assert_allclose(load, (1 + share.load) * (far_load - near_load), rtol=1e-6)
    np.testing.assert_allclose(motion, (1 + share.motion) * (far - near), rtol=1e-6, atol=1e-12)


def test_a_correction_begun_by_one_nearby_is_the_same_in_half_the_iterations() -> None:
    (working,) = of_hexahedra("exponential", (4.0, 1))
    (fine,) = of_hexahedra("exponential", (2.0, 1))
    counted: list[int] = []

    class Counted(BundledAdapter):
        def solve(self, *args: Any) -> Response:
            response = super().solve(*args)
            counted.append(response.iterations)
            return response

    fine = replace(fine, adapter=Counted())
    there = values() | {"tau0": 25.2, "lambda_plus_Y": 1.01}
    near = correction(working, fine, working.predict(values()), values())
    coarse = working.predict(there)
    counted.clear()
    cold = correction(working, fine, coarse, there)
    warm = correction(working, fine, coarse, there, near=near)
    assert counted[1] <= 0.6 * counted[0]
    np.testing.assert_allclose(warm.load, cold.load, atol=1e-5 * abs(np.asarray(cold.load)).max())
    np.testing.assert_allclose(warm.motion, cold.motion, atol=1e-8)
