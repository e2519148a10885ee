"""Repeats that are images of a test are told by the strain between them."""

from __future__ import annotations

import numpy as np
import pytest

from driver.experiment.images.reference import build_reference
from driver.experiment.images.repeat_stretch import RepeatStretch
from tests.driver.experiment.images.test_reference import (
    BOUNDS,
    COL,
    ORIGIN,
    PIXEL,
    ROW,
    SIGMA,
    repeats,
    surface,
)


def stretch(stack: np.ndarray) -> RepeatStretch:
    found = build_reference(stack, None, PIXEL, ORIGIN, BOUNDS).stretch
    assert found is not None
    return found


@pytest.mark.parametrize("shifted", [False, True])
def test_repeats_that_stood_still_or_moved_as_a_whole_are_not_stretched(shifted: bool) -> None:
    moves = np.array([(0.0, 0.0), (0.8, -0.8), (-1.3, 1.3), (0.5, -0.5), (0.1, 0.2), (0.0, 0.4)])
    found = [stretch(repeats(6, seed, moves if shifted else None)) for seed in range(20)]
    assert not any(one.told for one in found)
    if not shifted:
        values = np.array([one.value / one.sigma for one in found])
        assert np.std(values) == pytest.approx((5 / 6) ** 0.5, rel=0.15)  # about their mean


def test_images_of_a_test_are_told_with_the_strain_between_them() -> None:
    strains = np.array([0.0, 0.005, 0.01, 0.015])
    noise = SIGMA * np.random.default_rng(2).normal(size=(4, *ROW.shape))
    stack = np.array([surface(ROW, COL / (1 + e)) for e in strains]) + noise
    found = stretch(stack)
    # Slopes of a smoothed mean are up to a quarter too small.
    np.testing.assert_allclose(found.value, strains - strains.mean(), rtol=0.3, atol=0.002)
    assert found.told.startswith("images.repeats: found repeat 3 1.")
    assert "% longer along Y than repeat 0 (± 0." in found.told
