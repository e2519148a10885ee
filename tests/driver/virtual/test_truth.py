from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from driver.common.errors import InputError
from driver.experiment.history import read_history
from driver.forward import build
from driver.forward.build import build_model, mesh_of
from driver.virtual.settings import Face, Program, Virtual
from driver.virtual.truth import course_of, knots, pull, stage_program
from driver.virtual.writing import record
from solver_adapters.interface import Capabilities, CellFields, Progress, Response, Simulation
from tools import closed_form


@pytest.fixture(autouse=True)
def closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "find_adapter", lambda name, profile: closed_form.ClosedFormSolver())


def test_the_program_moves_holds_and_looks(tmp_path: Path) -> None:
    history = stage_program([(2, 1)])
    np.testing.assert_array_equal(history.time, [0, 10, 40, 50, 80, 90, 120])
    np.testing.assert_array_equal(history.stage, [0, 5, 5, 10, 10, 5, 5])
    np.testing.assert_array_equal(history.image_row, [0, 2, 4, 6])
    np.testing.assert_array_equal(history.turning, [0, 4, 6])
    # It survives the file that a virtual experiment writes.
    course = pull(closed_form.small_case(), history, {"elongation_1": 0.02, "elongation_2": 0.015})
    record(tmp_path, closed_form.small_case(), course, 0)
    found = read_history(tmp_path / "history.csv")
    np.testing.assert_array_equal(found.time, history.time)
    np.testing.assert_array_equal(found.image_row, history.image_row)


def test_loading_goes_with_the_stage_and_unloading_gives_back_what_is_elastic() -> None:
    history = stage_program([(4, 3), (8, 1)])
    found = knots(history, Program(largest_strain=0.012, recovered_strain=5e-4), 10.0)
    # Stage 20, 5, 45, 40 µm; 120 nm at 45.
    peak = 0.12 * 20 / 45
    values = [peak, peak - 0.005, 0.12, 0.12 - 0.005]
    for k, value in enumerate(values, start=1):
        assert found[f"elongation_{k}"] == pytest.approx(value)
        assert found[f"tilt_{k}"] == pytest.approx(value / 4)
    small = knots(history, Program(largest_strain=1e-4), 10.0)
    assert small["elongation_2"] == pytest.approx(1e-3 * 5 / 45)


def test_a_true_parameter_is_checked_against_the_general_model() -> None:
    history = stage_program([(2, 1)])
    with pytest.raises(InputError, match='truth: found the name "tau", expected tau0'):
        pull(closed_form.small_case(), history, {"tau": 1.0})
    with pytest.raises(InputError, match=r"truth.height_scale: found 2, expected a number from"):
        pull(closed_form.small_case(), history, {"height_scale": 2.0})


def test_slip_steps_are_refused_where_the_solver_answers_no_slip(tmp_path: Path) -> None:
    history = stage_program([(2, 1)])
    with pytest.raises(InputError, match="with the solver closed form, .* expected 0"):
        pull(closed_form.small_case(), history, {}, cell_slip=True)
    course = pull(closed_form.small_case(), history, {})
    with pytest.raises(InputError, match="for a response without the slip of the cells"):
        record(
            tmp_path, closed_form.small_case(), course, 0, Virtual(face=Face(slip_spacing_um=0.4))
        )


def test_the_instruments_see_what_the_truth_says_of_them() -> None:
    """A gain of load and of height is the same motion and load times it."""
    history = stage_program([(2, 1)])
    stretch = {"elongation_1": 0.02, "elongation_2": 0.015, "tilt_1": 0.004, "tilt_2": 0.003}
    plain = pull(closed_form.small_case(), history, stretch)
    gained = pull(
        closed_form.small_case(), history, stretch | {"load_gain": 0.1, "height_scale": 0.2}
    )
    np.testing.assert_allclose(gained.load, 1.1 * plain.load)
    np.testing.assert_allclose(gained.motion, plain.motion * [1.0, 1.0, 1.2])


class WithSlip(closed_form.ClosedFormSolver):
    """The solver in closed form with slips that say at which row they stand."""

    def capabilities(self) -> Capabilities:
        return replace(super().capabilities(), cell_fields=True)

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        n_cells = len(simulation.mesh.cells)
        rows = np.asarray(simulation.output, dtype=np.float64)[:, None, None]
        cells = CellFields(*(rows * np.ones((n_cells, n)) for n in (6, 24, 24, 3)))
        return replace(super().solve(simulation), cells=cells)


def test_a_load_that_lags_is_read_later_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "find_adapter", lambda name, profile: WithSlip())
    history = stage_program([(2, 1)])
    stretch = {"elongation_1": 0.02, "elongation_2": 0.015}
    plain = pull(closed_form.small_case(), history, stretch, cell_slip=True)
    every = replace(history, image_row=np.arange(7))
    rows = pull(closed_form.small_case(), every, stretch).load
    # A hold of 30 s earlier: the load at the end of the move.
    early = pull(closed_form.small_case(), history, stretch | {"load_lag": -30.0}, cell_slip=True)
    np.testing.assert_allclose(early.load, rows[[0, 1, 3, 5]])
    late = pull(closed_form.small_case(), history, stretch | {"load_lag": 5.0}, cell_slip=True)
    np.testing.assert_allclose(late.load[1:3], (rows[[2, 4]] + rows[[3, 5]]) / 2)
    for lagging in (early, late):
        np.testing.assert_array_equal(lagging.motion, plain.motion)
        assert lagging.slip is not None and plain.slip is not None
        np.testing.assert_array_equal(lagging.slip, plain.slip)
        assert lagging.slip[:, 0, 0].tolist() == [0, 2, 4, 6]


def test_any_response_becomes_a_course_whatever_the_order_of_its_nodes() -> None:
    case, history = closed_form.small_case(), stage_program([(2, 1)])
    mesh = mesh_of(case, 1.2)
    adapter = closed_form.ClosedFormSolver()
    model = build_model(case, mesh, history, np.zeros((0, 2)), adapter, 1)
    values = model.null_values() | {"elongation_1": 0.02, "elongation_2": 0.01}
    everywhere = np.random.default_rng(0).permutation(len(mesh.points))
    simulation = replace(model.simulation(values), output_nodes=everywhere)
    fields = CellFields(*(np.ones((4, len(mesh.cells), n)) for n in (6, 24, 24, 3)))
    response: Response = replace(adapter.solve(simulation), cells=fields)
    course = course_of(simulation, response, history, values)
    direct = pull(case.model_copy(), history, {"elongation_1": 0.02, "elongation_2": 0.01})
    assert course.motion.shape == (4, len(course.face.nodes), 3)
    at_plus = np.isclose(course.face.points[:, 1], closed_form.LENGTH)
    np.testing.assert_allclose(course.motion[2, at_plus, 1], 0.01, atol=1e-12)
    np.testing.assert_allclose(course.load, direct.load, rtol=0.05)
    assert course.slip is not None and course.slip.shape == (4, len(mesh.cells), 24)
    lacking = replace(simulation, output_nodes=course.face.nodes[1:])
    with pytest.raises(ValueError, match="found none of 1 nodes of the face TOP"):
        course_of(lacking, adapter.solve(lacking), history, values)
