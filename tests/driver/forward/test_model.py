from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest

from driver.experiment.history import History, turning_points
from driver.forward.build import build_model, geometry_of
from driver.forward.model import ForwardModel
from driver.forward.prediction import Prediction
from driver.forward.surface_projection import apply
from driver.parameters.boundary import elongation_names, tilt_names
from driver.parameters.history import HOLD
from driver.parameters.registry import declared_parameters
from meshes.arrays import FloatArray
from meshes.prism import generate
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.interface import Progress, Response, Simulation
from solver_adapters.material import MATERIAL_DECLARATIONS
from tools import closed_form

# One of each kind: law, orientation, boundary motion, geometry, load cell, images, pose.
# No step may reach a kink, where a slip system starts: the next one of c is 1.3e-4 to 2.5e-4 off.
STEPS = {
    "tau0": 1e-2, "n": 1e-3, "c": 0.8, "C44_scale": 1e-4,
    "rotation_grain2_x": 1e-4, "rotation_frame_z": 1e-4,
    "lambda_plus_Y": 1e-3, "elongation_2": 1e-5, "tilt_1": 1e-5, "stretch_curvature": 1e-4,
    "depth_scale": 1e-4, "boundary_shift": 1e-4, "apex_shift": 1e-4,
    "load_gain": 1e-4, "load_drift": 1e-2, "load_lag": 1e-4,
    "height_scale": 1e-4, "tilt_drift": 1e-5, "origin_Y": 1e-4,
}  # fmt: skip
CARRIED = ("boundary_shift", "origin_Y")
VALUES = {
    "tau0": 35.0, "rotation_grain1_y": 0.05, "rotation_frame_z": -0.03, "lambda_plus_Y": 0.8,
    "lambda_minus_Z": 1.2, "depth_scale": 0.04, "boundary_shift": 0.1, "load_gain": 0.1,
    "load_lag": 0.3,
    "height_scale": -0.05, "magnification_drift": 1e-3, "origin_X": 0.02,
}  # fmt: skip


class Exact(BundledAdapter):
    """The bundled solver iterated so far that differences of its answers are derivatives."""

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        return super().solve(replace(simulation, tolerance=1e-11), workspace, progress)


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """So few cells are no work for more."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


@pytest.fixture(scope="module")
def model() -> ForwardModel:
    """Six steps of the bundled solver on a few cells: load, hold, unload."""
    case = closed_form.small_case()
    stage = np.array([0.0, 20.0, 40.0, 40.0, 30.0, 20.0])
    history = History(
        time=10.0 * np.arange(6.0), stage=stage, image_row=np.array([0, 2, 3, 5]),
        force=np.zeros(4), turning=turning_points(stage), cycle=np.ones(4, dtype=np.int64),
    )  # fmt: skip
    mesh = generate(geometry_of(case), 2.0)
    return build_model(case, mesh, history, closed_form.pixels(), Exact(), 1)


@pytest.fixture(scope="module")
def values(model: ForwardModel) -> dict[str, float]:
    knots = dict(zip((*elongation_names(3), *tilt_names(3)), (0.03, 0.02, 0.004, 0.003),
                     strict=True))  # fmt: skip
    return model.null_values() | knots | VALUES


@pytest.fixture(scope="module")
def prediction(model: ForwardModel, values: dict[str, float]) -> Prediction:
    return model.predict(values, tuple(STEPS))


def test_the_specimen_has_yielded(prediction: Prediction, model: ForwardModel) -> None:
    """The tests below would say little about an elastic one."""
    elastic = model.predict(model.null_values() | {"elongation_1": 0.03, "tau0": 1e4})
    assert np.abs(prediction.load).max() < 0.5 * np.abs(elastic.load).max()


@pytest.mark.parametrize("name", STEPS)
def test_derivatives_are_those_of_the_prediction(
    model: ForwardModel, values: dict[str, float], prediction: Prediction, name: str
) -> None:
    row, h = list(STEPS).index(name), STEPS[name]
    above, below = (model.predict(values | {name: values[name] + s}) for s in (h, -h))
    for derivative, high, low in (
        (prediction.d_load[row], above.load, below.load),
        (prediction.d_surface[row], above.surface, below.surface),
    ):
        difference = (high - low) / (2 * h)
        scale = np.abs(derivative).max() + 1e-9 * np.abs(high).max() / h
        assert np.abs(difference - derivative).max() < 1e-4 * scale
    d_motion = apply(prediction.projection.value, prediction.d_surface[row])
    d_motion = d_motion + prediction.carried.get(row, 0.0)
    difference = (above.motion - below.motion) / (2 * h)
    # Where the surface slides under the pixels, some of them change their cell within a step.
    close = 2e-2 if name in CARRIED else 1e-4
    assert np.linalg.norm(difference - d_motion) <= close * np.linalg.norm(d_motion) + 1e-9
    assert (row in prediction.carried) == (name in CARRIED)


def test_every_direction_acts_on_the_data(prediction: Prediction) -> None:
    for row, name in enumerate(STEPS):
        acts = np.abs(prediction.d_load[row]).max() + np.abs(prediction.d_surface[row]).max()
        assert acts > 0 or name in CARRIED, name


@pytest.mark.parametrize("lag", [0.0, 4.0, -3.0])
def test_the_derivative_for_the_length_of_the_holds_is_that_of_two_simulations(
    model: ForwardModel, values: dict[str, float], lag: float
) -> None:
    """One hold of 10 s before the third image; what follows it comes later and keeps its speed."""
    prompt = values | {"load_lag": lag}
    found = model.predict(prompt, ("tau0", HOLD))
    (direction,) = model.simulation(prompt, (HOLD,)).directions
    assert direction.times is not None and direction.scale == 5.0
    np.testing.assert_allclose(direction.times, [0, 0, 0, 1, 1, 1])
    high, low = (model.predict(prompt | {HOLD: error}) for error in (0.01, -0.01))
    for derivative, above, below in (
        (found.d_load[1], high.load, low.load),
        (found.d_surface[1], high.surface, low.surface),
    ):
        slope = (above - below) / 0.02
        assert np.abs(slope).max() > 0
        np.testing.assert_allclose(derivative, slope, rtol=0, atol=1e-6 * np.abs(slope).max())
    assert not found.d_load[1, :1].any() and found.d_load[1, 2:].all()


def test_free_parameters_do_not_change_the_prediction(
    model: ForwardModel, values: dict[str, float], prediction: Prediction
) -> None:
    alone = model.predict(values)
    np.testing.assert_allclose(alone.load, prediction.load, rtol=1e-9)
    np.testing.assert_allclose(alone.surface, prediction.surface, atol=1e-12)
    assert alone.d_surface.shape[0] == 0 and not alone.carried


def test_a_solver_gets_one_direction_for_each_parameter_that_it_feels(
    model: ForwardModel, values: dict[str, float]
) -> None:
    simulation = model.simulation(values, tuple(STEPS))
    named = [direction.name for direction in simulation.directions]
    observed = {"load_gain", "load_drift", "load_lag", "height_scale", "tilt_drift", "origin_Y"}
    assert named == [name for name in STEPS if name not in observed]
    kinds = {
        d.name: (bool(d.material), d.rotation is not None, d.motion is not None,
                 d.points is not None)
        for d in simulation.directions
    }  # fmt: skip
    assert kinds["tau0"] == (True, False, False, False)
    assert kinds["rotation_frame_z"] == (False, True, False, False)
    assert kinds["elongation_2"] == (False, False, True, False)
    assert kinds["depth_scale"] == (False, False, False, True)
    scales = {direction.name: direction.scale for direction in simulation.directions}
    # One prior scale: e-fold for tau0, which is 35 MPa here, 10 nm for a knot.
    assert (scales["tau0"], scales["elongation_2"], scales["depth_scale"]) == (35.0, 0.01, 0.05)


def test_the_load_is_that_of_the_image_after_its_hold_and_a_lag_reads_another(
    model: ForwardModel, values: dict[str, float], prediction: Prediction
) -> None:
    """Images at 0, 20, 30 (after a hold from 20 s on) and 50 s, the stage moves from 30 s on."""
    prompt = model.predict(values | {"load_lag": 0.0})
    simulation = replace(model.simulation(values), output=np.arange(6))
    every = (1 + values["load_gain"]) * model.adapter.solve(simulation).force
    # The hold relaxes, which the image after it sees.
    assert every[3] < 0.99 * every[2]
    np.testing.assert_allclose(prompt.load, every[[0, 2, 3, 5]], rtol=1e-12)
    early, late = (model.predict(values | {"load_lag": s}) for s in (-10.0, 4.0))
    np.testing.assert_allclose(early.load, every[[0, 1, 2, 4]], rtol=1e-9)
    between = [0.6 * every[k] + 0.4 * every[k + 1] for k in (0, 2, 3)]
    np.testing.assert_allclose(late.load, [*between, every[5]], rtol=1e-9)
    # The images are those of their own time, whatever the load.
    np.testing.assert_allclose(early.surface, prompt.surface, atol=1e-12)


def test_in_the_steps_of_a_response_other_parameters_take_the_same_steps(
    model: ForwardModel, values: dict[str, float]
) -> None:
    """Steps that refine themselves follow the clock of holds that last longer."""
    refined = replace(model, accuracy=1.0)
    response = refined.predict(values).response
    other = values | {"tau0": 1.1 * values["tau0"], HOLD: 3.0}
    held = refined.with_time_steps_of(response.ends, values)
    simulation = held.simulation(other)
    assert simulation.accuracy is None and simulation.steps is not None
    ends = np.interp(response.ends, refined.clock(values), refined.clock(other))
    np.testing.assert_allclose(simulation.steps, ends, rtol=1e-12)
    assert held.predict(other).response.steps == response.steps > len(model.times) - 1
    as_given = model.predict(values).response.ends
    assert model.with_time_steps_of(as_given, values) is model
    cut = model.with_time_steps_of(np.append(as_given[:1] / 2, as_given), values)
    assert cut.steps is not None and cut.steps.size == as_given.size + 1


def test_near_a_response_simulations_begin_by_it_on_their_own_clock(
    model: ForwardModel, values: dict[str, float]
) -> None:
    known = model.predict(values)
    beside = model.warm_started_from(known.response.trajectory, values)
    assert beside.predict(values).response.iterations < 0.1 * known.response.iterations
    other = values | {"tau0": 1.01 * values["tau0"], HOLD: 3.0}
    near, cold = beside.predict(other), model.predict(other)
    assert near.response.iterations < cold.response.iterations
    np.testing.assert_allclose(near.load, cold.load, atol=1e-5 * abs(cold.load).max())
    trajectory = beside.simulation(other).warm_start
    assert trajectory is not None
    np.testing.assert_allclose(
        trajectory.times, model.simulation(other).times
    )  # a step an interval
    longer = model.warm_started_from(model.predict(other).response.trajectory, other).trajectory
    assert longer is not None
    np.testing.assert_allclose(longer.times, model.times)
    assert model.warm_started_from(None, values) is model  # of a solver that does not tell it


def test_nulls_are_those_of_the_declarations_but_for_the_constants_of_the_case(
    model: ForwardModel,
) -> None:
    changed = replace(model, material=replace(model.material, n=20.0, tau0_112=1.1))
    nulls, declared = changed.null_values(), declared_parameters(3)
    assert set(nulls) == set(declared)
    assert nulls["n"] == 20.0 and nulls["tau0_112"] == 1.1
    constants = {p.name for p in MATERIAL_DECLARATIONS}
    assert all(nulls[n] == p.null for n, p in declared.items() if n not in constants)


def test_a_quadratic_motion_is_exact_at_the_pixels(model: ForwardModel) -> None:
    look = model.projection.at(model.projection.surface.points, model.null_values())

    def field(xy: FloatArray) -> FloatArray:
        x, y = xy.T
        u = np.column_stack([1 + x * y, y**2 - 3 * x, x**2 + 0.5 * x * y - y])
        return np.asarray(np.arange(1, 4)[:, None, None] * u)

    seen = apply(look.value, field(model.projection.surface.points))
    np.testing.assert_allclose(seen, field(model.projection.pixels), atol=1e-12)
    # Slopes are differences over 2 nm; a pixel on an edge of the mesh sees both of its sides.
    x, y = model.projection.pixels.T
    slope = apply(look.slope_X, field(model.projection.surface.points))[0]
    np.testing.assert_allclose(slope[:, 1], -3.0, atol=1e-9)
    np.testing.assert_allclose(slope[:, 0], y, atol=1e-9)
    slope = apply(look.slope_Y, field(model.projection.surface.points))[0]
    np.testing.assert_allclose(slope[:, 2], 0.5 * x - 1, atol=1e-9)


def test_a_shift_of_the_nodes_alone_is_no_motion(model: ForwardModel) -> None:
    """The grain boundary of a specimen that strains uniformly can be anywhere."""
    surface, shifted = model.projection.surface, model.projection.surface.points.copy()
    velocity = model.microstructure.velocities["boundary_shift"][surface.nodes, :2]
    shifted += 0.3 * velocity
    look = model.projection.at(shifted, model.null_values())
    strain = np.column_stack([-0.3 * shifted[:, 0], shifted[:, 1], 0 * shifted[:, 0]])[None]
    seen = apply(look.value, strain)[0]
    np.testing.assert_allclose(seen[:, :2], model.projection.pixels * [-0.3, 1.0], atol=1e-12)


def test_pixels_off_the_face_see_its_rim(model: ForwardModel) -> None:
    pose = model.null_values() | {"origin_Y": 0.3}
    look = model.projection.at(model.projection.surface.points, pose)
    np.testing.assert_allclose(look.value.sum(axis=1), 1.0, atol=1e-12)
    ys = look.value @ model.projection.surface.points[:, 1]
    expected = np.minimum(model.projection.pixels[:, 1] + 0.3, closed_form.LENGTH - 2e-3)
    np.testing.assert_allclose(ys, expected, atol=1e-12)
