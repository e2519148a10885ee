from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from driver.identification.simulation_error import SimulationError, simulation_error
from tests.driver import closed_form

FloatArray = NDArray[np.float64]

T, N_Z = 9, 5
RNG = np.random.default_rng(3)


@pytest.fixture(scope="module")
def error() -> SimulationError:
    root = RNG.standard_normal((N_Z, 3))
    field = root @ root.T
    return SimulationError(
        2 * RNG.standard_normal((T, 2)), field / np.trace(field), 3 * RNG.standard_normal((2, T))
    )


def matrix_of(linear: FloatArray) -> FloatArray:
    """The matrix of a symmetric operator from its answers to unit vectors."""
    n = len(linear)
    return np.asarray(linear.reshape(n, n))


def test_images_are_whitened_by_the_inverse_root_of_their_covariance(
    error: SimulationError,
) -> None:
    units = np.eye(T * N_Z).reshape(T * N_Z, T, N_Z)
    root = matrix_of(error.whiten_images(units, error.shapes))
    covariance = np.eye(T * N_Z) + np.kron(error.shapes @ error.shapes.T, error.field)
    np.testing.assert_allclose(root @ covariance @ root.T, np.eye(T * N_Z), atol=1e-10)
    np.testing.assert_allclose(root, root.T, atol=1e-12)


def test_loads_are_whitened_by_the_inverse_root_of_their_covariance(
    error: SimulationError,
) -> None:
    root = matrix_of(error.whiten_loads(np.eye(T), error.load))
    covariance = np.eye(T) + error.load.T @ error.load
    np.testing.assert_allclose(root @ covariance @ root.T, np.eye(T), atol=1e-10)


def test_no_error_of_the_loads_changes_nothing(error: SimulationError) -> None:
    load = RNG.standard_normal(T)
    np.testing.assert_array_equal(error.whiten_loads(load, np.zeros((2, T))), load)


def test_what_is_left_is_in_proportion_to_the_correction() -> None:
    """κ = r/(1 − r): as much again for half the element size, and nothing is left of nothing."""
    b = closed_form.bench()
    image = closed_form.objective(b, b.truth).data.image
    x, y = image.images.xy.T
    bump = 1e-3 * np.exp(-((y - 2.0) ** 2)) * x
    motion = np.linspace(0, 1, b.history.n_images)[:, None, None] * bump[:, None]
    motion = motion * np.array([0.2, 1.0, 0.5])
    load = np.linspace(0, 4, b.history.n_images)
    of_mesh, nothing = (motion, load), (0 * motion, 0 * load)
    half = simulation_error(image, of_mesh, nothing, 0.5, 0.5)
    np.testing.assert_allclose(half.load, [load, 0 * load])
    assert np.trace(half.field) == pytest.approx(1.0)
    # The power of the shapes is that of κ times the difference, seen by the images.
    seen = image.pixel_sensitivity(motion)
    assert np.sum(half.shapes**2) == pytest.approx(np.sum(seen**2))
    third = simulation_error(image, (2 * motion, load), nothing, 0.5, 0.5)
    np.testing.assert_allclose(np.abs(third.shapes), 2 * np.abs(half.shapes), atol=1e-9)
    none = simulation_error(image, nothing, nothing, 0.5, 0.5)
    z = RNG.standard_normal(seen.shape)
    np.testing.assert_allclose(none.whiten_images(z, none.shapes), z, atol=1e-12)


def test_what_the_steps_leave_counts_as_it_is_beside_what_the_mesh_leaves() -> None:
    b = closed_form.bench()
    image = closed_form.objective(b, b.truth).data.image
    T = b.history.n_images
    motion = np.linspace(0, 1, T)[:, None, None] * np.full((1, len(image.images.xy), 3), 1e-3)
    steps = (motion[::-1], np.linspace(3, 0, T))
    error = simulation_error(image, (motion, np.ones(T)), steps, 0.5, 1 / 3)
    np.testing.assert_allclose(error.load, [np.full(T, 0.5), steps[1]])
    seen = [0.5 * image.pixel_sensitivity(motion), image.pixel_sensitivity(steps[0])]
    assert np.sum(error.shapes**2) == pytest.approx(sum(np.sum(z**2) for z in seen))
