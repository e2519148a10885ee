"""The virtual laboratory on a reference in closed form, where the answers are known."""

from __future__ import annotations

import numpy as np
import pytest

from driver.dic.series import measure
from driver.dic.surface_images import SurfaceImages, prepare
from driver.noise_floor.laboratory import (
    DRAWS,
    SERIES,
    Laboratory,
    elongation,
    errors,
    laboratory,
    strain_yy,
)
from driver.noise_floor.motions import known_motions
from driver.results.noise_floor import Errors
from driver.virtual.microscope.relief import Waves

PIXEL, LENGTH, WIDTH, NOISE = 0.11, 6.0, 2.2, 0.004
ORIGIN, SHAPE = (17.5, 9.0), (36, 73)
BOUNDS = (-1.0, 1.0, 0.1, LENGTH - 0.1)


@pytest.fixture(scope="module")
def images() -> SurfaceImages:
    x, y = np.meshgrid(
        *((np.arange(n) - o) * PIXEL for n, o in zip(SHAPE, ORIGIN, strict=True)), indexing="ij"
    )
    rng = np.random.default_rng(0)
    relief = 0.6 + 0.02 * Waves.random(rng, 0.8, 2.0)(x, y)
    repeats = relief + NOISE * rng.normal(size=(10, *SHAPE))
    return prepare(repeats[:2], repeats, None, PIXEL, ORIGIN, BOUNDS)


@pytest.fixture(scope="module")
def lab(images: SurfaceImages) -> Laboratory:
    return laboratory(images, known_motions(PIXEL, LENGTH, WIDTH, 0.02), LENGTH)


@pytest.fixture(scope="module")
def found(lab: Laboratory) -> dict[int, Errors]:
    return {size: errors(lab, size * PIXEL, size * PIXEL / 2) for size in (12, 32)}


def test_a_clean_image_is_the_reference_moved(images: SurfaceImages, lab: Laboratory) -> None:
    """f + w − g(x + u) at the true motion, by the sum of cosines: no more than its table's error.

    g is known at its pixels only, so the places x + u are taken to be those of pixels.
    """
    rows, columns = np.nonzero(lab.region)
    place = np.column_stack([rows - lab.relief.origin[0], columns - lab.relief.origin[1]]) * PIXEL
    for clean, motion in zip(lab.clean, lab.motions, strict=True):
        points = place.copy()
        for _ in range(30):  # a contraction: strains are of a per cent
            points = place - motion(*points.T)[0][:, :2]
        expected = lab.relief.cosine_sum(*points.T) + motion(*points.T)[0][:, 2]
        residual = expected - clean[lab.region]
        assert np.abs(residual).max() < 1e-4 * NOISE


def test_the_scatter_is_that_of_the_covariance(found: dict[int, Errors]) -> None:
    """Interpolation between pixels lowers the noise: the covariance is an upper bound.

    72 draws know a standard deviation to 9 %.
    """
    for errors_ in found.values():
        scatter = np.sqrt(np.mean(errors_.scatter["elongation"] ** 2))
        assert 0.65 < scatter / errors_.predicted < 1.2
        assert errors_.converged == 1.0


def test_large_elements_have_less_scatter_and_more_bias_in_a_wave(found: dict[int, Errors]) -> None:
    small, large = found[12], found[32]
    for quantity in ("u", "v", "w", "strain"):
        assert (large.scatter[quantity] < small.scatter[quantity]).all()
    waves = [np.linalg.norm(errors_.bias["strain"][-2:]) for errors_ in (large, small)]
    assert waves[0] > 2 * waves[1]
    # A rigid or affine motion is in every mesh: its bias is a fraction of the scatter.
    assert (large.bias["v"][:5] < 0.5 * large.scatter["v"][:5]).all()
    total = np.sqrt(np.mean(large.bias["u"] ** 2 + large.scatter["u"] ** 2))
    assert large.total("u") == pytest.approx(total)


def test_a_series_repeats_itself_and_no_other(lab: Laboratory) -> None:
    one, again, other = lab.series(0), lab.series(0), lab.series(1)
    np.testing.assert_array_equal(one.frames.coefficients, again.frames.coefficients)
    assert np.abs(one.reference - other.reference).max() > 0.1 * NOISE
    assert one.n_frames == DRAWS * len(lab.motions) and SERIES > 1
    assert one.sigma == pytest.approx(lab.sigma, rel=0.05)


def test_strain_and_elongation_of_an_affine_motion_are_those_of_its_coefficients(
    images: SurfaceImages,
) -> None:
    motion = measure(images, 16 * PIXEL, 8 * PIXEL)
    n = len(motion.basis_uv.nodes)
    motion.coefficients[:, n : 2 * n] = 0.01 * motion.basis_uv.nodes[:, 1]
    np.testing.assert_allclose(strain_yy(motion, images), 0.01, rtol=1e-9)
    stretch, sigma = elongation(motion, images, LENGTH)
    np.testing.assert_allclose(stretch, 0.01 * LENGTH, rtol=1e-9)
    assert 0 < sigma < 0.02
