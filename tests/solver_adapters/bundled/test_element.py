from __future__ import annotations

import numpy as np
import pytest

from solver_adapters.bundled.element import shape_gradient_velocity, shape_gradients
from tests.solver_adapters.boxes import box

MESH = box((2, 2, 2), (2.0, 4.0, 3.0), jitter=0.2)


def test_the_gauss_weights_fill_the_volume() -> None:
    _, weights = shape_gradients(MESH.points, MESH.cells)
    np.testing.assert_allclose(weights.sum(), 24.0, rtol=1e-13)


def test_a_quadratic_field_has_its_own_gradient_at_the_gauss_points() -> None:
    """On straight cells the ten shape functions span all quadratic polynomials."""
    x, y, z = MESH.points.T
    gradients, weights = shape_gradients(MESH.points, MESH.cells)
    found = np.einsum("eqaj,ea->eqj", gradients, (x * y + 2 * z**2 + 3 * y)[MESH.cells])
    linear = np.einsum("eqaj,ea->eqj", gradients, x[MESH.cells])
    np.testing.assert_allclose(linear, np.broadcast_to([1.0, 0, 0], linear.shape), atol=1e-13)
    # ∫ (y, x + 3, 4z) over the box
    integral = np.einsum("eq,eqj->j", weights, found)
    np.testing.assert_allclose(integral, 24.0 * np.array([2.0, 1.0 + 3.0, 4 * 1.5]), rtol=1e-13)


def test_the_velocity_of_gradients_and_weights_is_their_difference_quotient() -> None:
    velocity = np.random.default_rng(1).normal(size=MESH.points.shape)
    step = 1e-5
    high, low = (
        shape_gradients(MESH.points + sign * step * velocity, MESH.cells) for sign in (1, -1)
    )
    gradients, weights = shape_gradients(MESH.points, MESH.cells)
    found = shape_gradient_velocity(gradients, weights, MESH.cells, velocity)
    for k in range(2):
        expected = (high[k] - low[k]) / (2 * step)
        np.testing.assert_allclose(found[k], expected, atol=1e-7 * abs(expected).max())


def test_an_inverted_cell_is_refused_by_its_number() -> None:
    cells = MESH.cells.copy()
    cells[5] = cells[5, [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]
    with pytest.raises(ValueError, match="cell 5 of the mesh is inverted"):
        shape_gradients(MESH.points, cells)
