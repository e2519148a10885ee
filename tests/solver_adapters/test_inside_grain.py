"""Factors on the critical stress inside a grain."""

from __future__ import annotations

import numpy as np

from solver_adapters.inside_grain import band_factor, mode_factor, standardised

ETA = np.linspace(-1.0, 1.0, 20_001)


def test_points_of_a_uniform_bar_run_from_minus_one_to_one() -> None:
    y = 3.0 + 4.0 * (np.arange(1000) + 0.5) / 1000
    eta = standardised(y, np.full(1000, 0.2))
    np.testing.assert_allclose(eta, (y - 5.0) / 2.0, rtol=1e-5)


def test_the_weights_of_points_are_their_volumes() -> None:
    once = standardised(np.array([0.0, 1.0, 1.0]), np.ones(3))
    np.testing.assert_allclose(
        standardised(np.array([0.0, 1.0]), np.array([1.0, 2.0])), once[:2], rtol=1e-12
    )


def test_modes_are_without_mean_and_orthogonal() -> None:
    xi = np.zeros_like(ETA)
    slope, bend = (np.log(mode_factor(modes, ETA, xi)) for modes in ((1, 0, 0), (0, 1, 0)))
    assert abs(np.mean(slope)) < 1e-4 and abs(np.mean(bend)) < 1e-4
    assert abs(np.mean(slope * bend)) < 1e-4


def test_a_band_has_its_height_in_its_middle_half_of_it_at_its_edges_and_none_far_off() -> None:
    found = np.log(band_factor((-0.4, 0.1, 0.2), np.array([0.1, 0.3, -0.1, 0.9])))
    np.testing.assert_allclose(found, [-0.4, -0.2, -0.2, 0.0], atol=1e-12)


def test_the_imaginary_part_carries_the_derivative_of_a_band() -> None:
    eta, band, step = np.array([-0.1, 0.2, 0.3]), np.array([-0.4, 0.1, 0.2]), 1e-6
    for k, unit in enumerate(np.eye(3)):
        exact = band_factor(list(band + 1e-30j * unit), eta).imag / 1e-30
        high, low = (band_factor(list(band + sign * step * unit), eta) for sign in (1, -1))
        np.testing.assert_allclose(exact, (high - low) / (2 * step), rtol=1e-7, err_msg=str(k))
