from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy import ndimage

from driver.identification.reference_noise import reference_noise
from tools import closed_form

BENCH = closed_form.problem()
IMAGES = closed_form.surface_images(BENCH, BENCH.truth, 0)
RNG = np.random.default_rng(3)
FLAT = 0.4  # of the noise of an image


def weights() -> np.ndarray:
    """Weights of the pixels as test functions have them: smooth over one to three pixels."""
    drawn = RNG.standard_normal((12, *closed_form.SHAPE))
    smooth = np.stack([ndimage.gaussian_filter(one, 1.0 + 0.1 * k) for k, one in enumerate(drawn)])
    rows = smooth[:, IMAGES.rows, IMAGES.cols]
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def numbers_of(weights: np.ndarray) -> tuple[sp.csr_array, np.ndarray]:
    """Test functions of which each is one of the numbers."""
    return sp.csr_array(weights.T), np.eye(len(weights))


def test_without_flats_frames_share_the_reference_alone() -> None:
    images = replace(IMAGES, n_reference=4, sigma_flat=0.0)
    found = reference_noise(images, *numbers_of(weights()), np.ones((3, 2, 2)))
    np.testing.assert_allclose(found, 0.25)


def test_the_error_of_the_flats_is_shared_as_draws_of_it_are() -> None:
    """Whole pixels, which need no interpolation; places that move alike."""
    tested, shifts = weights(), np.array([[0, 0], [1, 0], [0, 2], [3, -1], [2, 0]])
    images = replace(IMAGES, sigma_flat=FLAT * IMAGES.sigma)
    places = np.repeat(shifts[:, None] * images.pixel, 2, axis=1)
    stated = reference_noise(images, *numbers_of(tested), places) - 1.0 / images.n_reference
    draws, rows, cols = 4000, images.rows, images.cols
    drawn = np.zeros((draws, len(shifts), len(tested)))
    for k in range(draws):
        error = FLAT * RNG.standard_normal(np.array(closed_form.SHAPE) + 8)
        there = [
            error[rows + 4 + dr, cols + 4 + dc] - error[rows + 4, cols + 4] for dr, dc in shifts
        ]
        drawn[k] = np.stack(there) @ tested.T
    scatter = np.einsum("ktj,ksj->ts", drawn, drawn) / (draws * len(tested))
    np.testing.assert_allclose(stated, scatter, atol=0.03 * FLAT**2)
    np.testing.assert_allclose(stated[0], 0.0, atol=1e-9)  # it did not move
