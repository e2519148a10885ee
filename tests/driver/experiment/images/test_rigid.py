from __future__ import annotations

import numpy as np
import pytest

from driver.experiment.images.heightmaps import ImageError
from driver.experiment.images.rigid import shift_between

PIXEL = 0.11
ROW, COL = np.indices((48, 90), dtype=float)


def surface(row: np.ndarray, col: np.ndarray) -> np.ndarray:
    """Heights [µm] of a smooth random relief of 8 to 16 px wavelength, in closed form."""
    rng = np.random.default_rng(5)
    height = np.full(row.shape, 0.5)
    for angle, wavelength, phase in rng.uniform((0, 8, 0), (np.pi, 16, 2 * np.pi), (40, 3)):
        k = 2 * np.pi / wavelength
        height += 0.01 * np.cos(k * (np.cos(angle) * row + np.sin(angle) * col) + phase)
    return height


@pytest.mark.parametrize(
    "shift", [(0.37, 0.0, 0.0), (0.0, -0.21, 0.0), (0.0, 0.0, 0.013), (-3.4, 5.7, -0.2)]
)
def test_a_known_shift_is_recovered_within_a_thousandth_pixel(
    shift: tuple[float, float, float],
) -> None:
    mask = np.zeros(ROW.shape, bool)
    mask[8:-8, 10:-10] = True
    image = surface(ROW - shift[0], COL - shift[1]) + shift[2]
    found = shift_between(surface(ROW, COL), image, PIXEL, mask)
    assert found.dx / PIXEL == pytest.approx(shift[0], abs=1e-3)
    assert found.dy / PIXEL == pytest.approx(shift[1], abs=1e-3)
    assert found.dz == pytest.approx(shift[2], abs=1e-4)


@pytest.mark.parametrize("tilt", [0.1, -0.5])
def test_a_tilt_larger_than_the_relief_does_not_move_the_shift(tilt: float) -> None:
    mask = np.zeros(ROW.shape, bool)
    mask[8:-8, 10:-10] = True
    image = surface(ROW - 1.7, COL + 2.3) + tilt * (COL / 90 - 0.5)
    found = shift_between(surface(ROW, COL), image, PIXEL, mask)
    assert found.dx / PIXEL == pytest.approx(1.7, abs=1e-3)
    assert found.dy / PIXEL == pytest.approx(-2.3, abs=1e-3)


def test_a_shift_is_found_in_noise_beside_a_trench() -> None:
    rng = np.random.default_rng(6)
    images = []
    for row_shift, col_shift in ((0.0, 0.0), (1.7, -2.3)):
        image = surface(ROW - row_shift, COL - col_shift) + 0.009 * rng.normal(size=ROW.shape)
        image[np.abs(ROW - row_shift - 24) > 14] = 0.0
        images.append(image)
    mask = np.abs(ROW - 24) < 12
    mask[:, :6] = mask[:, -6:] = False
    found = shift_between(images[0], images[1], PIXEL, mask)
    # σ√2/√(Σ (∂f/∂x)²) = 0.009·√2/(0.025·√(23·78)) = 0.012 px
    assert found.dx / PIXEL == pytest.approx(1.7, abs=0.04)
    assert found.dy / PIXEL == pytest.approx(-2.3, abs=0.04)


def test_repeats_of_a_relief_of_a_few_pixels_have_not_moved() -> None:
    """Their power lies beyond the band of the phase correlation, which finds a pixel or more."""
    rng = np.random.default_rng(7)
    relief = np.zeros(ROW.shape)
    for angle, wavelength, phase in rng.uniform((0, 3, 0), (np.pi, 5, 2 * np.pi), (40, 3)):
        k = 2 * np.pi / wavelength
        relief += 0.01 * np.cos(k * (np.cos(angle) * ROW + np.sin(angle) * COL) + phase)
    noise = 0.009
    one, two = (relief + noise * rng.normal(size=ROW.shape) for _ in range(2))
    found = shift_between(one, two, 1.0)
    # σ√2/√(Σ (∂f/∂x)²), slopes of 0.05 smoothed to a third in what chooses the shift.
    assert np.hypot(found.dx, found.dy) < 5 * noise * np.sqrt(2) / (0.05 / 3 * np.sqrt(ROW.size))


def test_the_shift_to_another_surface_stays_within_the_image() -> None:
    heights = surface(ROW, COL)
    other = 1e3 * np.random.default_rng(8).normal(size=ROW.shape)
    found = shift_between(heights, other, PIXEL)
    assert abs(found.dx) <= 48 * PIXEL and abs(found.dy) <= 90 * PIXEL


def test_the_shift_of_a_surface_that_also_shears_is_its_mean() -> None:
    """As in a raster scan: lines read forth and back are apart by a line at one end only."""
    ramp = 1.0 - COL / (COL.shape[1] - 1)
    found = shift_between(surface(ROW, COL), surface(ROW - ramp, COL), PIXEL)
    assert found.dx / PIXEL == pytest.approx(ramp.mean(), abs=0.05)
    assert found.dy / PIXEL == pytest.approx(0.0, abs=0.05)


def test_images_that_cannot_be_compared_are_refused() -> None:
    relief = surface(ROW, COL)
    with pytest.raises(ImageError, match="shape"):
        shift_between(relief, relief[1:], PIXEL)
    with pytest.raises(ImageError, match="no height"):
        shift_between(relief, np.full_like(relief, np.nan), PIXEL)
    with pytest.raises(ImageError, match="no relief"):
        shift_between(np.ones_like(relief), relief, PIXEL)
