from __future__ import annotations

import numpy as np
import pytest

from driver.virtual.microscope.inversion import material_points
from meshes.arrays import FloatArray


def wave(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Strains up to 5 %: u = a sin(y), v = b sin(x + 2y), w = x y."""
    a, b = 0.05, 0.02
    value = np.column_stack([a * np.sin(y), b * np.sin(x + 2 * y), x * y])
    zero, phase = np.zeros_like(x), np.cos(x + 2 * y)
    slopes = [[zero, a * np.cos(y)], [b * phase, 2 * b * phase], [y, x]]
    return value, np.moveaxis(np.array(slopes), -1, 0)


def test_the_material_point_is_found_to_rounding_in_a_motion_of_large_strains() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-2, 2, (2, 30, 40))
    motion = wave(x.ravel(), y.ravel())[0].T.reshape(3, 30, 40)
    found = material_points(wave, x + motion[0], y + motion[1])
    for value, truth in zip(found, (x, y, motion[2]), strict=True):
        np.testing.assert_allclose(value, truth, atol=1e-10)


def test_a_motion_that_folds_the_face_is_refused() -> None:
    def folding(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        slopes = np.zeros((x.size, 3, 2))
        slopes[:, 0, 0] = -2 * np.sign(x)
        return np.column_stack([-2 * np.abs(x), 0 * x, 0 * x]), slopes

    # x − 2|x| never exceeds 0.
    with pytest.raises(ArithmeticError, match="could not be inverted"):
        material_points(folding, np.array([0.5]), np.array([0.0]))
