"""Motions of arrays that are far from the reference, or that cannot be found."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from driver.dic.correlation import Correlation, correlate
from meshes.arrays import FloatArray

SHAPE, MIDDLE, AROUND = (110, 140), np.array([55.0, 70.0]), 140
ROW, COL = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
RELIEF = ndimage.gaussian_filter(
    np.random.default_rng(1).normal(size=(SHAPE[0] + 2 * AROUND, SHAPE[1] + 2 * AROUND)), 2.5
)
INNER = np.zeros(SHAPE, dtype=bool)
INNER[30:80, 40:100] = True


def gradient(degrees: float, stretch: float = 0.0) -> FloatArray:
    """Deformation gradient of a turn from rows to columns and a stretch."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return (1 + stretch) * np.array([[c, -s], [s, c]])


def image(shift: tuple[float, float], F: FloatArray, seed: int) -> FloatArray:
    """The relief, of 1, after x = m + F (X − m) + shift; noise 0.05."""
    moved = np.stack([ROW, COL], axis=-1) - MIDDLE - shift
    places = moved @ np.linalg.inv(F).T + MIDDLE + AROUND
    seen = ndimage.map_coordinates(RELIEF / RELIEF.std(), np.moveaxis(places, -1, 0), order=5)
    return np.asarray(seen + np.random.default_rng(seed).normal(0.0, 0.05, SHAPE))


def error(found: Correlation, shift: tuple[float, float], F: FloatArray) -> float:
    """Root mean square of u, v less the truth at the pixels that were compared [px]."""
    at = found.system.pixels
    X = np.column_stack([at.rows, at.cols])
    wrong = found.at_pixels(0)[:, :2] - ((X - MIDDLE) @ F.T + MIDDLE + shift - X)
    return float(np.sqrt(np.mean(wrong[found.compared[0]] ** 2)))


STILL = image((0.0, 0.0), np.eye(2), 0)


@pytest.mark.parametrize("degrees", [12.0, -20.0, 45.0, 90.0, 180.0])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (9.0, -14.0)])
def test_a_turn_by_any_angle_is_found_in_one_step(
    degrees: float, shift: tuple[float, float]
) -> None:
    F = gradient(degrees)
    found = correlate(STILL, image(shift, F, 1), mask=INNER)
    assert found.converged.all()
    assert error(found, shift, F) < 0.03
    assert found.sigma == pytest.approx(0.05, rel=0.05)


@pytest.mark.parametrize("shift", [(33.0, 5.0), (-8.0, 45.0)])
def test_a_shift_of_a_third_of_the_field_is_found_in_one_step(shift: tuple[float, float]) -> None:
    found = correlate(STILL, image(shift, np.eye(2), 1))
    assert found.converged.all() and error(found, shift, np.eye(2)) < 0.03


def test_pixels_that_come_and_go_at_the_border_keep_no_image_from_an_end() -> None:
    for F in (gradient(0.0, 0.1), gradient(10.0)):
        found = correlate(STILL, image((0.0, 0.0), F, 1))
        assert found.converged.all(), found.reason
        assert error(found, (0.0, 0.0), F) < 0.04


def test_a_motion_that_is_not_found_has_no_chi_and_is_found_from_a_start() -> None:
    F, shift = gradient(0.0, 0.3), (2.0, -3.0)
    far = image(shift, F, 1)
    lost = correlate(STILL, far)
    assert not lost.converged.any() and np.isnan(lost.chi).all()
    assert "its motion was not found; try images in between" in lost.reason[0]
    # Known to 4 % of the stretch.
    guess = (np.stack([ROW, COL], axis=-1) - MIDDLE) * 0.26
    found = correlate(STILL, far, start=guess, mask=INNER)
    assert found.converged.all() and found.chi == pytest.approx(1.0, abs=0.01)
    assert error(found, shift, F) < 0.03


def test_a_start_has_the_unit_of_the_pixels() -> None:
    shift = (12.0, -7.0)
    found = correlate(STILL, image(shift, np.eye(2), 1), pixel=0.11, start=0.11 * np.array(shift))
    assert found.converged.all()
    assert found.at_pixels(0)[:, :2].mean(axis=0) / 0.11 == pytest.approx(shift, abs=0.01)
