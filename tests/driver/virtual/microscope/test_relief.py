from __future__ import annotations

import numpy as np
import pytest

from driver.virtual.microscope.relief import Relief, Waves


def test_the_relief_is_its_formula_point_by_point() -> None:
    rng = np.random.default_rng(3)
    relief = Relief.random(rng, (-2.0, 2.0, 0.0, 3.0), 0.02, 0.4, 5.0, 0.003)
    assert relief.dots.shape == (60, 2)
    x, y = rng.uniform((-2, 0), (2, 3), (200, 2)).T
    # The same sum over all dots, written out.
    squared = ((x[:, None] - relief.dots[:, 0]) ** 2 + (y[:, None] - relief.dots[:, 1]) ** 2) / 0.16
    dots = 0.02 * (np.maximum(1 - squared, 0) ** 2).sum(axis=1)
    np.testing.assert_allclose(relief(x, y), dots + 0.003 * relief.waves(x, y), atol=1e-15)
    np.testing.assert_array_equal(relief(x[None], y[None])[0], relief(x, y))


def test_waves_have_unit_rms_and_no_length_out_of_their_band() -> None:
    waves = Waves.random(np.random.default_rng(4), 0.8, 4.0)
    lengths = 2 * np.pi / np.linalg.norm(waves.vectors, axis=1)
    assert lengths.min() >= 0.8 and lengths.max() <= 4.0
    x, y = np.random.default_rng(5).uniform(0, 400, (2, 40000))
    # Mean square of 40 independent waves of amplitude √(2/40): 1 to a per cent.
    assert np.mean(waves(x, y) ** 2) == pytest.approx(1.0, abs=0.02)


def test_a_face_without_dots_is_only_polished() -> None:
    relief = Relief.random(np.random.default_rng(6), (0.0, 1.0, 0.0, 1.0), 0.02, 0.4, 0.0, 0.003)
    x, y = np.zeros((2, 3, 4))
    np.testing.assert_array_equal(relief(x, y), 0.003 * relief.waves(x, y))
