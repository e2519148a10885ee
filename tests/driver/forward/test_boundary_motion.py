from __future__ import annotations

import numpy as np
import pytest

from driver.experiment.history import knot_weights
from driver.forward.boundary_motion import BoundaryMotion, knots_of_stage
from driver.forward.build import build_model
from driver.parameters.boundary import (
    BOUNDARY_DECLARATIONS,
    elongation_names,
    knot_declarations,
    tilt_names,
)
from tools import closed_form

NULL = {p.name: p.null for p in BOUNDARY_DECLARATIONS}
KNOTS = dict(zip(elongation_names(5), (0.10, 0.07, 0.30, 0.26), strict=True))
TILTS = dict(zip(tilt_names(5), (0.01, 0.02, 0.05, 0.04), strict=True))
DEPARTED = {
    "lambda_plus_Y": 0.8, "lambda_plus_Z": 1.1, "lambda_minus_Y": 0.9, "lambda_minus_Z": 1.2,
    "apex_curvature": 0.3, "end_rotation": 0.2, "end_shear": -0.1, "stretch_curvature": 0.05,
}  # fmt: skip

# Edge −1, middle, +1, and the apex, on both ends.
ACROSS = np.array([-1.0, 0.0, 1.0, 0.0])
ZETA = np.array([0.0, 0.0, 0.0, 1.0])
MINUS_EDGE, MINUS_APEX, PLUS_EDGE, PLUS_APEX = slice(0, 3), 3, slice(4, 7), 7


@pytest.fixture(scope="module")
def motion() -> BoundaryMotion:
    return BoundaryMotion(
        nodes=np.arange(8),
        side=np.repeat([-1.0, 1.0], 4),
        zeta=np.tile(ZETA, 2),
        across=np.tile(ACROSS, 2),
        weights=knot_weights(closed_form.history()),
        mask=np.ones((8, 3), dtype=np.bool_),
    )


@pytest.mark.parametrize("name", [*DEPARTED, *KNOTS, *TILTS])
def test_the_derivative_is_that_of_the_motion(motion: BoundaryMotion, name: str) -> None:
    values = NULL | DEPARTED | KNOTS | TILTS
    h = 1e-6
    above, below = (motion.evaluate(values | {name: values[name] + s}) for s in (h, -h))
    np.testing.assert_allclose(
        motion.derivative(values, name), (above - below) / (2 * h), rtol=0, atol=1e-9
    )
    assert np.abs(motion.derivative(values, name)).max() > 1e-3


def test_every_parameter_is_declared_and_none_is_forgotten(motion: BoundaryMotion) -> None:
    declared = {p.name for p in (*BOUNDARY_DECLARATIONS, *knot_declarations(5))}
    assert motion.parameters == declared == set(NULL | KNOTS | TILTS)


def test_the_edges_part_by_the_knots_and_their_mean_stands_still(motion: BoundaryMotion) -> None:
    u = motion.evaluate(NULL | DEPARTED | KNOTS | TILTS | {"end_shear": 0.0})
    minus, plus = u[:, MINUS_EDGE].mean(axis=1), u[:, PLUS_EDGE].mean(axis=1)
    np.testing.assert_allclose(minus + plus, 0, atol=1e-15)
    turning = closed_form.history().turning
    np.testing.assert_allclose((plus - minus)[turning, 1], [0, *KNOTS.values()], atol=1e-15)
    np.testing.assert_allclose((plus - minus)[turning, 2], [0, *TILTS.values()], atol=1e-15)


@pytest.mark.parametrize("component", [1, 2])
def test_the_apex_moves_lambda_times_its_edge(motion: BoundaryMotion, component: int) -> None:
    lambdas = {name: DEPARTED[name] for name in DEPARTED if name.startswith("lambda")}
    u = motion.evaluate(NULL | lambdas | KNOTS | TILTS)[..., component]
    axis = "XYZ"[component]
    for sign, edge, apex in (("plus", PLUS_EDGE, PLUS_APEX), ("minus", MINUS_EDGE, MINUS_APEX)):
        expected = lambdas[f"lambda_{sign}_{axis}"] * u[:, edge].mean(axis=1)
        np.testing.assert_allclose(u[:, apex], expected, atol=1e-15)


def test_the_motion_is_linear_in_stage_travel_and_still_in_a_hold(motion: BoundaryMotion) -> None:
    history = closed_form.history()
    u = motion.evaluate(NULL | KNOTS | TILTS)
    moved, travelled = np.diff(u, axis=0), np.diff(history.stage)
    assert (travelled == 0).sum() == 4
    np.testing.assert_array_equal(moved[travelled == 0], 0.0)
    for start, end in zip(history.turning[:-1], history.turning[1:], strict=True):
        rows = np.arange(start, end)
        rows = rows[travelled[rows] != 0]
        rate = moved[rows] / travelled[rows, None, None]
        np.testing.assert_allclose(rate, np.broadcast_to(rate[:1], rate.shape), atol=1e-15)


def test_curvature_of_the_stretch_leaves_the_knots_where_they_are(motion: BoundaryMotion) -> None:
    straight = motion.evaluate(NULL | KNOTS | TILTS)[:, PLUS_APEX, 1]
    bent = motion.evaluate(NULL | KNOTS | TILTS | {"stretch_curvature": 0.1})[:, PLUS_APEX, 1]
    turning = closed_form.history().turning
    np.testing.assert_allclose(bent[turning], straight[turning], atol=1e-15)
    # At the middle of the first loading: a tenth of its elongation, half of it on this end.
    assert bent[5] - straight[5] == pytest.approx(0.5 * 0.1 * 0.10)


def test_the_ends_move_sideways_by_shear_alone(motion: BoundaryMotion) -> None:
    values = NULL | DEPARTED | KNOTS | TILTS
    np.testing.assert_array_equal(motion.evaluate(values | {"end_shear": 0.0})[..., 0], 0.0)
    sheared = motion.evaluate(values)[..., 0]
    assert np.ptp(sheared[:, PLUS_EDGE], axis=1).max() == 0
    assert np.abs(sheared[:, PLUS_APEX]).max() > 0.01
    np.testing.assert_array_equal(sheared[:, :4], 0.0)


@pytest.mark.parametrize(("U_X", "held"), [("held", "all"), ("free", "one")])
def test_free_ends_pin_one_node_along_x(U_X: str, held: str) -> None:
    b = closed_form.problem()
    boundary = b.case.boundary.model_copy(update={"U_X": U_X})
    case = b.case.model_copy(update={"boundary": boundary})
    mask = build_model(
        case, b.mesh, b.history, closed_form.pixels(), closed_form.ClosedFormSolver(), 1
    ).boundary.mask
    assert mask[:, 1:].all()
    assert mask[:, 0].sum() == (len(mask) if held == "all" else 1)


def test_knots_of_the_stage_follow_its_travel_and_their_errors_add_phase_by_phase() -> None:
    along, sigma = knots_of_stage(np.array([0.0, 100.0, 70.0, 170.0]), 2e-4, 1e-5)
    np.testing.assert_allclose(along, [0.02, 0.014, 0.034])
    np.testing.assert_allclose(sigma, 1e-5 * np.sqrt([1e4, 1e4 + 9e2, 2e4 + 9e2]))
    # A stage that comes back to where it was says less of the end than a still one.
    assert knots_of_stage(np.array([0.0, 50.0, 0.0]), 2e-4, 1e-5)[1][-1] > 0
