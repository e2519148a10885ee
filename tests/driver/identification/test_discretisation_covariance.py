from __future__ import annotations

import numpy as np
import pytest

from driver.identification.discretisation_covariance import DiscretisationError, simulation_error
from meshes.arrays import FloatArray
from tools import closed_form

T, N_Z = 9, 5
RNG = np.random.default_rng(3)


@pytest.fixture(scope="module")
def error() -> DiscretisationError:
    root = RNG.standard_normal((N_Z, 3))
    field = root @ root.T
    return DiscretisationError(
        2 * RNG.standard_normal((T, 2)), field / np.trace(field), 3 * RNG.standard_normal(T)
    )


def matrix_of(linear: FloatArray) -> FloatArray:
    """The matrix of a symmetric operator from its answers to unit vectors."""
    n = len(linear)
    return np.asarray(linear.reshape(n, n))


def test_images_are_whitened_by_the_inverse_root_of_their_covariance(
    error: DiscretisationError,
) -> None:
    units = np.eye(T * N_Z).reshape(T * N_Z, T, N_Z)
    root = matrix_of(error.whiten_images(units, error.shapes))
    covariance = np.eye(T * N_Z) + np.kron(error.shapes @ error.shapes.T, error.field)
    np.testing.assert_allclose(root @ covariance @ root.T, np.eye(T * N_Z), atol=1e-10)
    np.testing.assert_allclose(root, root.T, atol=1e-12)


def test_loads_are_whitened_by_the_inverse_root_of_their_covariance(
    error: DiscretisationError,
) -> None:
    root = matrix_of(error.whiten_loads(np.eye(T), error.load))
    covariance = np.eye(T) + np.outer(error.load, error.load)
    np.testing.assert_allclose(root @ covariance @ root.T, np.eye(T), atol=1e-10)


def test_no_error_of_the_loads_changes_nothing(error: DiscretisationError) -> None:
    load = RNG.standard_normal(T)
    np.testing.assert_array_equal(error.whiten_loads(load, np.zeros(T)), load)


def test_what_is_left_is_in_proportion_to_the_correction() -> None:
    """As much again at κ = 1, and nothing is left of nothing."""
    b = closed_form.problem()
    image = closed_form.objective(b, b.truth).data.image
    x, y = image.images.xy.T
    bump = 1e-3 * np.exp(-((y - 2.0) ** 2)) * x
    motion = np.linspace(0, 1, b.history.n_images)[:, None, None] * bump[:, None]
    motion = motion * np.array([0.2, 1.0, 0.5])
    load = np.linspace(0, 4, b.history.n_images)
    half = simulation_error(image, motion, load, 0.5, 1.0)
    np.testing.assert_allclose(half.load, load)
    assert np.trace(half.field) == pytest.approx(1.0)
    # The power of the shapes is that of κ times the difference, seen by the images.
    seen = image.pixel_sensitivity(motion)
    assert np.sum(half.shapes**2) == pytest.approx(np.sum(seen**2))
    third = simulation_error(image, 2 * motion, load, 0.5, 1.0)
    np.testing.assert_allclose(np.abs(third.shapes), 2 * np.abs(half.shapes), atol=1e-9)
    none = simulation_error(image, 0 * motion, 0 * load, 0.5, 1.0)
    z = RNG.standard_normal(seen.shape)
    np.testing.assert_allclose(none.whiten_images(z, none.shapes), z, atol=1e-12)


def test_what_is_left_keeps_the_three_strongest_shapes_in_time() -> None:
    b = closed_form.problem()
    image = closed_form.objective(b, b.truth).data.image
    y = image.images.xy[:, 1]
    clock = np.linspace(0.0, 1.0, b.history.n_images)
    bumps = np.stack([np.exp(-4.0 * (y - at) ** 2) for at in (0.5, 1.5, 2.5, 3.5)])
    course = np.stack([np.sin(np.pi * (k + 1) * clock) for k in range(4)], axis=1)
    motion = 1e-3 * np.einsum("tk,kp,c->tpc", course, bumps, np.ones(3))
    strengths = np.linalg.svd(image.pixel_sensitivity(motion), compute_uv=False)
    assert strengths[3] > 0.05 * strengths[0]
    left = simulation_error(image, motion, 0.0 * clock, 0.5, 1.0)
    found = np.linalg.norm(left.shapes, axis=0)
    np.testing.assert_allclose(found, strengths[:3], rtol=1e-9)
