from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from driver.common.splines.kernels import coefficients
from driver.dic.correlation import correlate
from driver.dic.relief_gain import Relief
from driver.dic.system import sensitivity
from meshes.arrays import FloatArray

SHAPE = (90, 120)
ROW, COL = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)


def motion(t: int) -> FloatArray:
    """u, v of the points that are at these pixels in the reference [px], (n_pix, 2)."""
    return np.column_stack([np.full(ROW.size, 0.3 * t), (-0.2 * t + 0.0005 * t * COL).ravel()])


def images(gains: list[float], noise: float = 0.05) -> tuple[FloatArray, FloatArray]:
    """A reference of relief 1 about 5, and moved images whose heights have gains."""
    rng = np.random.default_rng(1)
    relief = ndimage.gaussian_filter(rng.normal(size=(130, 160)), 2.5)
    relief = 5.0 + relief / relief.std()

    def image(t: int, gain: float) -> FloatArray:
        at = [ROW + 20 - 0.3 * t, 20 + (COL + 0.2 * t) / (1 + 0.0005 * t)]
        seen = gain * ndimage.map_coordinates(relief, at, order=5)
        return np.asarray(seen + rng.normal(0.0, noise, SHAPE))

    return image(0, 1.0), np.array([image(t + 1, gain) for t, gain in enumerate(gains)])


@pytest.mark.parametrize("gain", [0.9, 1.1, 0.7])
def test_an_image_of_another_gain_moves_as_it_would_without(gain: float) -> None:
    found = correlate(*images([1.0, gain, 1.0, 1.0]))
    plain = correlate(*images([1.0, 1.0, 1.0, 1.0]))
    assert found.gains.value == pytest.approx([1.0, gain, 1.0, 1.0], abs=5 * found.gains.sigma)
    assert found.applied == pytest.approx([1.0, gain, 1.0, 1.0], abs=0.01)
    for t in range(4):
        # 0.13 px where the gain was taken for motion
        error = found.at_pixels(t)[:, :2] - motion(t + 1)
        best = plain.at_pixels(t)[:, :2] - motion(t + 1)
        assert np.sqrt(np.mean(error**2)) < 1.5 * np.sqrt(np.mean(best**2)) < 0.04
    assert np.std(found.at_pixels(1)[:, 2]) < 0.05


def test_a_gain_is_as_sure_as_it_says() -> None:
    draws = []
    for seed in range(3):
        f, g = images([1.0] * 6)
        noise = np.random.default_rng(seed).normal(0.0, 0.3, (7, *SHAPE))
        found = correlate(f + noise[0], g + noise[1:])
        assert (found.applied == 1.0).all()
        draws.append((found.gains.value - 1.0) / found.gains.sigma)
    # The noise of the reference is shared: 21 numbers are independent.
    assert 0.5 < np.sqrt(np.mean(np.square(draws))) < 1.6


def test_noise_without_relief_tells_no_gain() -> None:
    rng = np.random.default_rng(2)
    slope = 0.02 * (ROW + COL)
    found = correlate(slope + rng.normal(0, 0.1, SHAPE), [slope + rng.normal(0, 0.1, SHAPE)])
    assert (found.applied == 1.0).all()


def test_what_changes_a_gain_is_the_residual_along_relief_that_no_motion_makes() -> None:
    f, g = images([1.0, 1.0, 1.0, 1.0])
    found = correlate(f, g, sigma=0.05)
    system = found.system
    relief, end = Relief.of(system), system.iterate(coefficients(g[3]), found.coefficients[3], 1e-3)
    assert 0 < np.isnan(end.residual).sum() < 500  # pixels that have left the image
    seen = sensitivity(system.pixels.slope, system.basis_uv, system.basis_w).toarray()
    held = sum(
        weight * np.asarray(part) for weight, part in zip(system.weights, system.parts, strict=True)
    )
    c = system.pixels.height - system.pixels.height.mean()
    z = np.linalg.solve(seen.T @ seen + held, seen.T @ c)
    left = c - seen @ z
    assert relief.sight == pytest.approx(c @ left, rel=1e-10)
    along = np.nansum(left * end.residual) + z @ held @ end.p
    assert relief.along(end) == pytest.approx(along, rel=1e-8)
